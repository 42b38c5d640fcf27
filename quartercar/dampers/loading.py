"""load_damper: the damper in any file that holds one, written by `quartercar fit`, `lpvid identify` or by hand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lpvid.errors import InputError
from lpvid.model.designed import role_of
from quartercar.dampers.contract import Damper

MEND = "give a file that `quartercar fit` or `lpvid identify` wrote"


def load_damper(path: str | Path, like: Damper | None = None) -> Damper:
    """The damper in a file.

    Parameters
    ----------
    path : str or Path
        A damper that `quartercar fit` wrote; a model.json or state_space.json of `lpvid identify`; a parameter set as
        `read_parameters` takes it.
    like : Damper, optional
        For a parameter set: what serves for what it leaves out.

    Returns
    -------
    Damper
        Of an identified model an `Identified`.

    Raises
    ------
    InputError
        A file that cannot be read or holds something else, a model that is no damper; one line with a mend.

    Examples
    --------
    >>> import tempfile, lpvid
    >>> from lpvid.scheduling import Polynomial, Scheduling
    >>> from lpvid.model.signals import Signal
    >>> model = lpvid.LPVTransferFunction.siso([[-0.5, 0.0]], [[800.0, 300.0]], Polynomial("voltage", degree=1), 0.002,
    ...     scheduling=Scheduling(("voltage",), (0.0,), (2.0,), units=("V",)), inputs=(Signal("velocity", "m/s"),),
    ...     outputs=(Signal("force", "N"),))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     damper = load_damper(lpvid.save(model, f"{folder}/model.json"))
    >>> damper.reads, damper.current_range, damper.current_unit, damper.static_force(0.1, 1.0).round(6)
    (('velocity', 'current'), (0.0, 2.0), 'V', array([220.]))
    """
    from quartercar.dampers.published import read_parameters

    path = Path(path)
    if path.suffix.lower() != ".json" and not path.is_dir():
        raise InputError(f"'{path}' is no model file", got=path.suffix or "no extension", mend=MEND)
    if not _has_schema(path):
        return read_parameters(path, like)
    from lpvid.export.serialise import load

    return _damper_of(load(path), path)


def _has_schema(path: Path) -> bool:
    """Whether a JSON object states what it holds; a file that cannot be read is left to the reader that states why."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return True
    return not isinstance(data, dict) or "schema" in data


def _damper_of(found: Any, path: Path) -> Damper:
    if isinstance(found, Damper):
        return found.replace(metadata={"label": path.stem, **found.metadata})
    what = type(found).__name__
    if getattr(found, "demands", None) is not None or role_of(found):
        raise InputError(f"'{path}' holds a {role_of(found) or 'controller'}, no damper", got=what,
                         mend=f"{MEND}; a controller goes to --controller")
    from lpvid.effects.extended import ExtendedModel

    if isinstance(found, ExtendedModel):
        raise InputError(f"'{path}' holds a law with causes added to it, which a car cannot step", got=what,
                         mend="extended_lpv.json beside it, where the causes have an LPV form")
    from quartercar.dampers.blackbox.identified import Identified

    damper = Identified.of(found, f"'{path}'")
    return damper.replace(metadata={"label": path.stem, **damper.metadata})
