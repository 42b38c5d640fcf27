"""NoiseModel: how white innovations reach the output of an input-output model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError

KINDS = ("equation", "output", "armax", "box-jenkins")


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """What stands between white innovations e and the output y.

    ::

        equation      A y = B u + e
        output        y = A⁻¹B u + e                                   (e need not be white)
        armax         A y = B u + C e,          C e = e(k) + Σ_{i=1}^{nc} c_i(p) e(k−i)
        box-jenkins   y = A⁻¹B u + D⁻¹C e,      C, D with constant coefficients

    Ljung 1999, section 4.2, with A and B depending on the scheduling. Every output has its own C and D.

    Parameters
    ----------
    kind : {"equation", "output", "armax", "box-jenkins"}
    c : (nc, n_outputs, M) array, optional
        Coefficients c_1 … c_nc over the model's basis, or over the constant alone (M = 1). In a model with
        ``lagged=True`` c_i is taken at p(k−i).
    d : (nd, n_outputs) array, optional
        Coefficients d_1 … d_nd of D (box-jenkins).

    Examples
    --------
    >>> NoiseModel("box-jenkins", c=[[[0.3]]], d=[[-0.9]])
    NoiseModel box-jenkins: nc=1, nd=1
    """

    kind: str = "equation"
    c: np.ndarray | None = None
    d: np.ndarray | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        _checks.one_of(self.kind, KINDS, "the kind of a noise model")
        c = np.zeros((0, 1, 1)) if self.c is None or np.size(self.c) == 0 else self.c
        d = np.zeros((0, 1)) if self.d is None or np.size(self.d) == 0 else self.d
        set_(self, "c", _checks.finite(_checks.frozen_array(c, "c of a noise model", ndim=3), "c of a noise model"))
        set_(self, "d", _checks.finite(_checks.frozen_array(d, "d of a noise model", ndim=2), "d of a noise model"))
        if self.kind in ("equation", "output") and (self.nc or self.nd):
            raise InputError(f"a noise model of kind '{self.kind}' has no coefficients",
                             got=f"{self.nc} c, {self.nd} d")
        if self.kind == "armax" and self.nd:
            raise InputError("an ARMAX noise model has no D", got=f"{self.nd} coefficients", mend="use box-jenkins")
        if self.kind == "box-jenkins" and self.c.shape[2] != 1:  # type: ignore[union-attr]
            raise InputError("C of a Box-Jenkins model has constant coefficients",
                             got=f"{self.c.shape[2]} functions of p")  # type: ignore[union-attr]

    @property
    def nc(self) -> int:
        """Order of C."""
        return len(self.c)  # type: ignore[arg-type]

    @property
    def nd(self) -> int:
        """Order of D."""
        return len(self.d)  # type: ignore[arg-type]

    @property
    def vector(self) -> np.ndarray:
        """(q,) coefficients: c by output, lag and function, then d by output and lag."""
        assert self.c is not None and self.d is not None
        return np.concatenate([self.c.transpose(1, 0, 2).ravel(), self.d.T.ravel()])

    def with_vector(self, vector: np.ndarray) -> NoiseModel:
        """The same noise model with other coefficients, in the order of `vector`.

        Parameters
        ----------
        vector : (k,) array
            Coefficients of C, then of D, output by output.

        Returns
        -------
        NoiseModel
        """
        assert self.c is not None and self.d is not None
        nc, ny, m = self.c.shape
        c = np.asarray(vector[: self.c.size], dtype=float).reshape(ny, nc, m).transpose(1, 0, 2)
        d = np.asarray(vector[self.c.size:], dtype=float).reshape(self.d.shape[::-1]).T
        return NoiseModel(self.kind, c, d)

    def names(self, labels: tuple[str, ...], outputs: tuple[str, ...]) -> tuple[str, ...]:
        """A readable name of every coefficient in the order of `vector`, e.g. ``noise c1[current]``.

        Parameters
        ----------
        labels : tuple of str
            Functions of the model's basis.
        outputs : tuple of str
            Names of the outputs, which stand in front where there are several.

        Returns
        -------
        tuple of str
        """
        assert self.c is not None and self.d is not None
        functions = labels if self.c.shape[2] == len(labels) else ("1",)
        to = [f"{o}:" if len(outputs) > 1 else "" for o in outputs]
        return (*(f"{t}noise c{i + 1}[{f}]" for t in to[: self.c.shape[1]] for i in range(self.nc) for f in functions),
                *(f"{t}noise d{i + 1}" for t in to[: self.d.shape[1]] for i in range(self.nd)))

    def check(self, n_outputs: int, n_functions: int) -> None:
        """Refuse coefficients that do not fit a model of these sizes.

        Parameters
        ----------
        n_outputs, n_functions : int
            Outputs of the model, and functions of its basis.

        Raises
        ------
        InputError
            c or d has another number of outputs, or c neither one nor `n_functions` functions.
        """
        assert self.c is not None and self.d is not None
        if self.nc:
            _checks.shaped(self.c, (None, n_outputs, None), "c of a noise model")
            if self.c.shape[2] not in (1, n_functions):
                raise InputError(f"c of a noise model must be constant or over the model's {n_functions} functions",
                                 got=f"shape {self.c.shape}")
        if self.nd:
            _checks.shaped(self.d, (None, n_outputs), "d of a noise model")

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            What `from_dict` reads; arrays as lists.
        """
        assert self.c is not None and self.d is not None
        data: dict = {"kind": self.kind}
        if self.kind in ("armax", "box-jenkins"):
            data["c"] = self.c.tolist()
        if self.kind == "box-jenkins":
            data["d"] = self.d.tolist()
        return data

    @classmethod
    def from_dict(cls, data: Mapping | None) -> NoiseModel:
        """Inverse of `to_dict`; None, as in files of models without one, is equation noise.

        Parameters
        ----------
        data : mapping
            What `to_dict` returned.

        Returns
        -------
        NoiseModel
            With the same values.
        """
        if data is None:
            return cls()
        return cls(data["kind"], data.get("c"), data.get("d"))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, NoiseModel) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash((self.kind, self.vector.tobytes()))

    def __repr__(self) -> str:
        orders = {"armax": f": nc={self.nc}", "box-jenkins": f": nc={self.nc}, nd={self.nd}"}
        return f"NoiseModel {self.kind}{orders.get(self.kind, '')}"
