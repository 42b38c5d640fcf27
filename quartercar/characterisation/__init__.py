"""Characterisation: from raw records of a damper to numbers and figures of a dynamometer's page, without a model."""

from quartercar.characterisation.characterisation import Characterisation, characterise
from quartercar.characterisation.settings import CharacteriseSettings
from quartercar.characterisation.tables import write_tables
from quartercar.characterisation.tolerance import Tolerance

__all__ = ["Characterisation", "CharacteriseSettings", "Tolerance", "characterise", "write_tables"]
