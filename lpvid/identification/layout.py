"""Where each parameter of a vector stands among a model's coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from lpvid import _checks
from lpvid.identification.state_space_layout import StateSpaceLayout
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction


class ModelLayout(Protocol):
    """What a result needs of a layout, whatever kind of model it belongs to."""

    @property
    def size(self) -> int:
        """Number of parameters."""
        ...

    def fill(self, model: Any, theta: np.ndarray) -> Any:
        """The model with these parameters in place of its own.

        Parameters
        ----------
        model : model
            Gives everything but the parameters.
        theta : (k,) array
            In the order of the layout.

        Returns
        -------
        model
        """
        ...

    def read(self, model: Any) -> np.ndarray:
        """(k,) parameters of a model of this layout.

        Parameters
        ----------
        model : model
            Of this layout.

        Returns
        -------
        (k,) array
        """
        ...

    def names(self, model: Any) -> tuple[str, ...]:
        """A readable name of every parameter.

        Parameters
        ----------
        model : model
            Of this layout.

        Returns
        -------
        tuple of str
        """
        ...


@dataclass(frozen=True, eq=False)
class ParameterLayout:
    """Parameters of an input-output model by place.

    Attributes
    ----------
    table : (k, 5) int array
        One row per parameter: part (0 a, 1 b, 2 c), lag index in that array, output, source signal, basis function.
        The parameters of the first output come first, then those of the second, and so on.
    """

    table: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "table", _checks.frozen_array(self.table, "a parameter layout", ndim=2, dtype=int))

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.table.shape[0]

    def fill(self, model: LPVTransferFunction, theta: np.ndarray) -> LPVTransferFunction:
        """The model with these parameters in place of its own; all other coefficients stay.

        Parameters
        ----------
        model : LPVTransferFunction
            With the lags of the layout.
        theta : (k,) array
            In the order of the table.

        Returns
        -------
        LPVTransferFunction
        """
        assert model.c is not None
        a, b, c = model.a.copy(), model.b.copy(), model.c.copy()
        part, lag, output, source, function = self.table.T
        for code, array in ((0, a), (1, b)):
            rows = part == code
            array[lag[rows], output[rows], source[rows], function[rows]] = theta[rows]
        rows = part == 2
        c[lag[rows], output[rows], function[rows]] = theta[rows]
        return model.replace(a=a, b=b, c=c)

    def read(self, model: LPVTransferFunction) -> np.ndarray:
        """(k,) parameters of a model of this layout.

        Parameters
        ----------
        model : LPVTransferFunction
            Of this layout.

        Returns
        -------
        (k,) array
        """
        assert model.c is not None
        arrays = (model.a, model.b, model.c)
        return np.array([arrays[p][i, o, f] if p == 2 else arrays[p][i, o, q, f] for p, i, o, q, f in self.table])

    def names(self, model: LPVTransferFunction) -> tuple[str, ...]:
        """A readable name of every parameter, e.g. ``a1[current]``; signals are named where there are several.

        Parameters
        ----------
        model : LPVTransferFunction
            Of this layout.

        Returns
        -------
        tuple of str
        """
        labels = model.basis.labels
        listed = []
        for part, lag, output, source, function in self.table:
            number = lag + 1 if part == 0 else lag
            signal = (model.outputs[source].name if part == 0 else model.filter_inputs[source].name) if part < 2 else ""
            several = model.n_outputs > 1 if part == 0 else model.n_filter_inputs > 1
            where = f"{{{signal}}}" if part < 2 and several else ""
            to = f"{model.outputs[output].name}:" if model.n_outputs > 1 else ""
            listed.append(f"{to}{'abc'[part]}{number}{where}[{labels[function]}]")
        return tuple(listed)

    def to_list(self) -> list[list[int]]:
        """Plain data for JSON.

        Returns
        -------
        list of list of int
            Rows of the table.
        """
        return self.table.tolist()


@dataclass(frozen=True, eq=False)
class ParameterCloud:
    """Estimated parameters with their covariance: a model to draw from.

    A model file carries it in ``metadata["parameters"]``, so that a stability report written later, elsewhere, still
    has the uncertainty of the poles.

    Attributes
    ----------
    model : LPVTransferFunction or LPVStateSpace
        At the estimate.
    layout : ModelLayout
        Places of the k parameters in it.
    covariance : (k, k) array
        Of the estimate.
    """

    model: Any
    layout: ModelLayout
    covariance: np.ndarray

    @classmethod
    def of(cls, model: LPVTransferFunction | LPVStateSpace) -> ParameterCloud | None:
        """The cloud that a model's metadata describes, or None when it has none.

        Parameters
        ----------
        model : LPVTransferFunction or LPVStateSpace
            As estimated, or as read from its file.

        Returns
        -------
        ParameterCloud or None
        """
        data = model.metadata.get("parameters")
        if not isinstance(data, Mapping) or "covariance" not in data:
            return None
        table = np.array(data["layout"])
        layout = (ParameterLayout(table) if isinstance(model, LPVTransferFunction)
                  else StateSpaceLayout(table, tuple(data["labels"])))
        return cls(model, layout, np.array(data["covariance"], dtype=float))

    @property
    def fault(self) -> str:
        """Why no model can be drawn from this covariance, in words; empty where one can.

        A covariance has no negative eigenvalue. One in units of the standard errors (diagonal 1) may show one of up to
        k ε times its largest, the rounding of its entries; more than that is none that a normal law can have.
        """
        variance = np.diag(self.covariance)
        if not np.all(np.isfinite(self.covariance)):
            return "the covariance of the parameters is not finite"
        if np.any(variance < 0):
            return "the covariance of the parameters has negative variances"
        alive = variance > 0
        scale = np.sqrt(variance[alive])
        unit = self.covariance[np.ix_(alive, alive)] / np.outer(scale, scale)
        values = np.linalg.eigvalsh(0.5 * (unit + unit.T))
        if values.size and values[0] < -values.size * np.finfo(float).eps * values[-1]:
            return "the covariance of the parameters is not positive semidefinite"
        return ""

    def draw(self, rng: np.random.Generator | int, count: int) -> list:
        """`count` models with parameters drawn from the normal law of the estimate.

        Parameters
        ----------
        rng : numpy.random.Generator or int
        count : int
            Number of models.

        Returns
        -------
        list of models
            Of the same kind as the estimate.
        """
        theta = self.layout.read(self.model)
        values, vectors = np.linalg.eigh(0.5 * (self.covariance + self.covariance.T))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        normal = _checks.generator(rng).standard_normal((count, theta.size))
        return [self.layout.fill(self.model, theta + root @ z) for z in normal]
