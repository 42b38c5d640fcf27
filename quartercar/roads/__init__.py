"""Roads: profiles of elevation (`profiles`), and roads at a speed for a ride (`ride_roads`).

>>> from quartercar import roads
>>> roads.iso_roughness("C").exponent
2.0
"""

from __future__ import annotations

from quartercar.roads.profiles import (
    ISO_CLASSES,
    MILES_PER_HOUR,
    REFERENCE_WAVENUMBER,
    SURFACES,
    WONG,
    Roughness,
    Track,
    iso8608,
    iso_roughness,
    measured,
    profile,
    surface,
)

__all__ = ["ISO_CLASSES", "MILES_PER_HOUR", "REFERENCE_WAVENUMBER", "SURFACES", "WONG", "Roughness", "Track", "iso8608",
           "iso_roughness", "measured", "profile", "surface"]
