"""Settings: what a characterisation reads off, and which way it shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from lpvid.errors import InputError
from lpvid.toolkit import checks

SPEEDS = (0.05, 0.1, 0.13, 0.26, 0.3, 0.52, 0.6, 1.05)
"""Speeds at which damper forces are usually quoted [m/s]: VDA's .052 … 1.05 and round values in use beside them."""
CENTRE = 0.1
"""Share of the stroke, about its middle, over which a peak-velocity point is taken: dynamometers' usual 10 %."""
CREEP = 0.01
"""Speed up to which a run counts as creep [m/s]: the usual limit of a gas and friction test on a dynamometer."""
HISTOGRAM = 0.25
"""Half width of the velocity histogram [m/s]."""
Rebound = Literal["positive", "negative"]


@dataclass(frozen=True)
class CharacteriseSettings:
    """What to read off, and how to show it.

    Attributes
    ----------
    speeds : tuple of float
        Speeds of the force table [m/s].
    rebound : {"positive", "negative"}
        Sign in which rebound (extension) forces are shown; records are positive in extension and tension.
    sample_rate : float, optional
        Resample to this rate [Hz], anti-aliased; left out, data above 1024 Hz are decimated to about 500 Hz.
    raw : bool
        Keep the data's own rate. Switching times are read from the data as measured in any case.
    delays : mapping of str to float
        Known delay of a sensor and its anti-alias filter by role or channel [s]; taken off before anything is read.
    specimen : str
        "" for one specimen, "file" for one per file, else a regular expression on the file's name whose first group
        (or whole match) names the specimen.

    Examples
    --------
    >>> CharacteriseSettings().speeds[:3], CharacteriseSettings(rebound="negative").sign
    ((0.05, 0.1, 0.13), -1)
    """

    speeds: tuple[float, ...] = SPEEDS
    rebound: Rebound = "positive"
    sample_rate: float | None = None
    raw: bool = False
    delays: Mapping[str, float] = field(default_factory=dict)
    specimen: str = ""

    def __post_init__(self) -> None:
        if not self.speeds:
            raise InputError("characterise needs at least one speed", mend="e.g. --speeds 0.1,0.3")
        speeds = tuple(sorted({checks.positive(v, "a speed", "m/s") for v in self.speeds}))
        object.__setattr__(self, "speeds", speeds)
        checks.one_of(self.rebound, ("positive", "negative"), "rebound")
        for name, delay in self.delays.items():
            if checks.real(delay, f"the delay of '{name}'") < 0:
                raise InputError(f"the delay of '{name}' must not be negative", got=f"{delay:g} s",
                                 why="a sensor is never early", mend="name the sensors that are late")
        if self.sample_rate is not None:
            checks.positive(self.sample_rate, "sample_rate", "Hz")
        if self.specimen and self.specimen != "file":
            _pattern(self.specimen)

    @property
    def sign(self) -> int:
        """1 where rebound is shown positive, −1 where negative."""
        return 1 if self.rebound == "positive" else -1

    def specimen_of(self, name: str) -> str:
        """The specimen that a record of this name is of.

        Parameters
        ----------
        name : str

        Returns
        -------
        str
            "" where there is one specimen.

        Raises
        ------
        InputError
            A name that the expression does not match.

        Examples
        --------
        >>> CharacteriseSettings(specimen=r"(S\\d+)_").specimen_of("S07_10mm")
        'S07'
        """
        if not self.specimen:
            return ""
        if self.specimen == "file":
            return name
        found = _pattern(self.specimen).search(name)
        if found is None:
            raise InputError(f"--specimen '{self.specimen}' does not match the record '{name}'",
                             mend="a regular expression whose first group names the specimen, e.g. '(S[0-9]+)_'; or "
                                  "'file' for one specimen per file")
        return found.group(1) if found.re.groups else found.group(0)


def _pattern(text: str):
    import re

    try:
        return re.compile(text)
    except re.error as error:
        raise InputError("--specimen is no regular expression", got=f"'{text}'", why=str(error),
                         mend="e.g. '(S[0-9]+)_', or 'file'") from None
