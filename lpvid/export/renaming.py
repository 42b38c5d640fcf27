"""renamed: the same model with its signals and scheduling variables under other names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lpvid.export.serialise import model_from_dict


def renamed(model: Any, names: Mapping[str, str]) -> Any:
    """The model with its signals and scheduling variables under other names; what is not named keeps its own.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, QuasiLPVModel, ComplianceModel or LFTModel
    names : mapping of str to str
        Old name to new name.

    Returns
    -------
    model
        Of the same kind, with the metadata as they were.

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso([[-0.5, 0]], [[1.0, 2.0]], Polynomial("U", degree=1), 0.01)
    >>> renamed(model, {"U": "current", "u1": "velocity"}).box.names
    ('current',)
    """
    def walk(value: Any, key: str = "") -> Any:
        if isinstance(value, Mapping):
            return {k: walk(v, k) for k, v in value.items() if k != "metadata"}
        if isinstance(value, (list, tuple)):
            return [walk(v, key) for v in value]
        return names.get(value, value) if key in ("name", "names") and isinstance(value, str) else value

    return model_from_dict({**walk(model.to_dict()), "metadata": dict(model.metadata)})
