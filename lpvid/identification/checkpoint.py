"""A long estimate's state on disk: what stands there is not computed again after an interruption."""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

META = "meta"
FORMAT = 2
"""of what is kept: 2 has prints of training rows, where the one before had first samples. Another one is no state."""


class Checkpoint:
    """One file that is always whole: written beside, then moved into place.

    Parameters
    ----------
    path : path
    about : object
        What the state belongs to, as JSON: structure, data and their version. A state of anything else is no state.
    """

    def __init__(self, path: str | os.PathLike, about: object) -> None:
        self.path = Path(path)
        self.key = hashlib.sha256(json.dumps([FORMAT, about], sort_keys=True, default=str).encode()).hexdigest()

    def load(self) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
        """Plain data and arrays; None where there is no state, or one of something else, or a damaged one.

        Returns
        -------
        (dict, dict of arrays) or None
        """
        try:
            with np.load(self.path, allow_pickle=False) as found:
                meta = json.loads(str(found[META]))
                arrays = {n: found[n] for n in found.files if n != META}
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return None
        return (meta, arrays) if meta.pop("key", None) == self.key else None

    def save(self, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        """Replace the state.

        Parameters
        ----------
        meta : mapping
            Plain data for JSON.
        arrays : mapping of str to array
            By names that `load` gives back.
        """
        part = self.path.with_name(self.path.name + ".part.npz")
        part.parent.mkdir(parents=True, exist_ok=True)
        content: dict[str, Any] = {META: np.array(json.dumps({**meta, "key": self.key})), **arrays}
        np.savez(part, **content)
        part.replace(self.path)

    def remove(self) -> None:
        """The work is done."""
        self.path.unlink(missing_ok=True)
