"""What a sampled damper holds: an lpvid model as plain data, with every number that its fit chose under a name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.identification.free_run_search import VectorLayout
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.state_space_layout import StateSpaceLayout
from lpvid.model.input_stage import InputStage
from lpvid.model.quasi import SelfScheduled
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from quartercar.dampers.parameter import Parameter

SHAPES = {"tanh": ("v0", "slope"),
          "three-zone": ("limit", "limit_slope", "upper", "upper_slope", "lower", "lower_slope")}
"""Names of the parameters of lpvid's input stages, in the order of their vectors."""

MATRICES = ("A", "B", "state_offset", "C", "D", "output_offset")
"""What of a state space is a parameter: all but the observer's gain, which no free run reads."""
Inner = LPVTransferFunction | LPVStateSpace | SelfScheduled
Places = ParameterLayout | StateSpaceLayout | VectorLayout


class Held:
    """An lpvid model and the places of its parameters, those of its input stage and current filter included.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, QuasiLPVModel or ComplianceModel
    layout : ParameterLayout, StateSpaceLayout or VectorLayout
        Which of its coefficients are parameters.
    """

    def __init__(self, model: Inner, layout: Places) -> None:
        self.model = model
        self.layout = layout
        reach = float(model.box.half_width[0]) if model.box.names else 0.0
        stage, lag = model.input_stage, model.scheduling_stage
        self._shape = np.zeros(0, int) if stage is None else np.flatnonzero(stage.scales(reach) > 0)
        self._lag = 0 if lag is None else lag.vector.size

    @classmethod
    def of(cls, data: Mapping) -> Held:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping
            Plain data: ``model``, and for a transfer function ``layout``.

        Returns
        -------
        Held
            Of a state space or a model that schedules itself every number is a parameter.

        Raises
        ------
        InputError
            More than one output or one that is no force; a model of another kind.
        """
        from lpvid.export.serialise import model_from_dict

        model = model_from_dict(data["model"])
        if len(model.outputs) != 1 or [s.name for s in model.outputs] != ["force"]:
            raise InputError("the model inside a damper gives one force", got=", ".join(s.name for s in model.outputs))
        if isinstance(model, LPVTransferFunction):
            return cls(model, ParameterLayout(np.asarray(data["layout"], dtype=int).reshape(-1, 5)))
        if isinstance(model, LPVStateSpace):
            return cls(model, layout_of(model))
        if not isinstance(model, SelfScheduled):
            raise InputError("the model inside a damper is a transfer function, a state space or schedules itself",
                             got=type(model).__name__)
        return cls(model, VectorLayout(model.vector.size))

    def to_dict(self) -> dict:
        """Plain data for JSON; the model without its metadata, which are the damper's.

        Returns
        -------
        dict
            Plain values by name.
        """
        model: Any = self.model
        layout = [] if isinstance(model, LPVStateSpace) else self.layout.to_list()  # of a state space: every entry
        return {"model": {**model.to_dict(), "metadata": {}}, "layout": layout}

    @property
    def vector(self) -> np.ndarray:
        """(P,) parameters: coefficients, then shape, then lag."""
        stage, lag = self.model.input_stage, self.model.scheduling_stage
        layout: Any = self.layout
        return np.concatenate([layout.read(self.model), np.zeros(0) if stage is None else stage.vector[self._shape],
                               np.zeros(0) if lag is None else lag.vector])

    def at(self, vector: np.ndarray) -> Inner:
        """The model at other parameters.

        Parameters
        ----------
        vector : (P,) array
            Parameters in the order of `vector`.

        Returns
        -------
        LPVTransferFunction, LPVStateSpace or SelfScheduled
            A copy.
        """
        size, stage, lag = self.layout.size, self.model.input_stage, self.model.scheduling_stage
        model: Any = self.layout.fill(self.model, np.asarray(vector[:size], dtype=float))  # type: ignore[arg-type]
        if stage is not None and self._shape.size:
            values = stage.vector.copy()
            values[self._shape] = vector[size: size + self._shape.size]
            model = model.replace(input_stage=stage.with_vector(values))
        if lag is not None:
            model = model.replace(scheduling_stage=lag.with_vector(np.asarray(vector[vector.size - self._lag:])))
        return model

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter with its unit; its default is the value that the fit gave it."""
        names = self.layout.names(self.model)  # type: ignore[arg-type]
        units = [_unit(n, self.model) for n in names]
        over = ", over the normalised current" if self.model.box.names else ""
        description = [f"of the model inside{over}"] * len(names)
        current = (self.model.box.units[0] or "1") if self.model.box.names else "1"
        stage, lag = self.model.input_stage, self.model.scheduling_stage
        if stage is not None:
            chosen = [_shape_names(stage)[int(k)] for k in self._shape]
            names = (*names, *(f"shape_{n}" for n in chosen))
            units += [_shape_unit(n, current) for n in chosen]
            description += ["of the shaped input"] * len(chosen)
        if lag is not None:
            chosen = _lag_names(lag)
            names = (*names, *(f"current_{n}" for n in chosen))
            units += ["s"] * len(chosen)
            description += ["of the filter on the current"] * len(chosen)
        rows = zip(names, units, description, self.vector, strict=True)
        return tuple(Parameter(n, u, s, float(v)) for n, u, s, v in rows)

    def spread(self, covariance: np.ndarray) -> np.ndarray:
        """(P, P) covariance from that of the coefficients; what is not known of shape and lag is NaN.

        Parameters
        ----------
        covariance : (C, C) array
            Of the coefficients, in the order of the layout; further rows and columns are not read.

        Returns
        -------
        (P, P) array
            In the order of `vector`.
        """
        out = np.full((self.vector.size, self.vector.size), np.nan)
        size = self.layout.size
        out[:size, :size] = covariance[:size, :size]
        return out


def layout_of(model: Inner) -> Places:
    """Every coefficient that is not structurally zero; of a state space every entry of its matrices.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
        One output.

    Returns
    -------
    ParameterLayout, StateSpaceLayout or VectorLayout
        Places of the coefficients that are parameters.
    """
    if isinstance(model, LPVTransferFunction):
        assert model.c is not None
        rows = [(part, lag, output, source, m) for part, array in ((0, model.a), (1, model.b))
                for lag, output, source, m in np.argwhere(np.broadcast_to(np.any(array != 0, axis=3)[..., None],
                                                                          array.shape))]
        rows += [(2, lag, output, 0, m) for lag, output, m in np.ndindex(*model.c.shape)]
        return ParameterLayout(np.array(rows, dtype=int).reshape(-1, 5))
    if isinstance(model, LPVStateSpace):
        return StateSpaceLayout.full(model, MATRICES)
    return VectorLayout(model.vector.size)


def _unit(name: str, model: Inner) -> str:
    """SI unit of a coefficient by its name: a_i pure, b_j force per input, the rest as the models define them.

    The states of a state space have no unit: only D and g have one.
    """
    if isinstance(model, LPVStateSpace):
        if name[0] == "g":
            return "N"
        if name[0] != "D":
            return ""
        place = name[1:name.index("[")]
        column = int(place.split(",")[1]) if "," in place else int(place[1])
        return {"m/s": "N*s/m", "m": "N/m"}.get(model.filter_inputs[column - 1].unit, "N")
    if name.startswith(("b", "kappa", "d")) and name != "displacement":
        source = name[name.index("{") + 1: name.index("}")] if "{" in name else model.inputs[0].name
        return {"velocity": "N*s/m", "displacement": "N/m"}.get(source, "N")
    return "N/m" if name == "displacement" else "N" if name.startswith(("c", "offset")) else ""


def _shape_names(stage: InputStage) -> Sequence[str]:
    return SHAPES[stage.to_dict()["kind"]]


def _shape_unit(name: str, current: str) -> str:
    speed = name in ("v0", "limit", "slope", "limit_slope")
    return ("m/s" if speed else "1") + (f"/{current}" if name.endswith("slope") else "")


def _lag_names(lag: SchedulingStage) -> list[str]:
    data = lag.to_dict()
    taus = ["tau"] if data["symmetric"] else ["tau_rise", "tau_fall"]
    return [*taus, "delay"] if data["with_delay"] else taus
