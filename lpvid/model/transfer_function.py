"""LPVTransferFunction: a discrete polynomial-scheduled input-output model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid import _checks
from lpvid.codec import ADDED, VERBATIM
from lpvid.errors import InputError
from lpvid.model.input_stage import InputStage
from lpvid.model.lpv_model import LPVModel
from lpvid.model.noise_model import NoiseModel
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.signals import Signal
from lpvid.scheduling import Basis, Scheduling
from lpvid.scheduling.basis import checked_basis


@dataclass(frozen=True, eq=False)
class LPVTransferFunction(LPVModel):
    r"""Discrete LPV input-output model with coefficients linear in a basis of the scheduling variables.

    ::

        y(k) + Σ_{i=1}^{na} a_i(p) y(k−i) = Σ_j b_j(p) u(k−j) + Σ_j c_j(p(k−j)) + e(k)

        a_i(p) = Σ_m a[i−1, :, :, m] φ_m(p)        b_j(p) = Σ_m b[j, :, :, m] φ_m(p)

    With ``lagged=False`` (Díaz Salas 2011 (3.5)-(3.7)) every a_i, b_j is taken at p(k), the time of the output; with
    ``lagged=True`` a_i is taken at p(k−i) and b_j at p(k−j), the parametrisation of Tóth, Abbas & Werner 2012 whose
    observer form is exact and causal. The affine terms c_j are always taken at p(k−j).

    Parameters
    ----------
    a : (na, n_outputs, n_outputs, M) array
        Output coefficients; the leading 1 is left out.
    b : (n_lags, n_outputs, n_filter_inputs, M) array
        Input coefficients from lag 0 on; zeros make a delay.
    basis : Basis
        The M functions φ_m, over ``scheduling.names``.
    sample_time : float
        Sampling period [s].
    scheduling : Scheduling, optional
        Names, box and rate bounds of p; left out, −1 to 1 of each of the basis's variables, at any rate.
    c : (n_affine, n_outputs, M) array, optional
        Affine terms from lag 0 on.
    lagged : bool
        Coefficients at p(k−i) rather than p(k).
    inputs, outputs : tuple of Signal or of str, optional
        Measured inputs and outputs.
    input_stage : InputStage, optional
        Static map from the measured inputs to the filter's inputs.
    scheduling_stage : SchedulingStage, optional
        Causal filter from the logged scheduling to the p of every formula here (a coil's lag).
    noise_covariance : (n_outputs, n_outputs) array, optional
        Covariance of the innovations e (of the output error where ``noise`` is of that kind).
    metadata : mapping
        What else belongs to the model (training records, polarity, version); JSON values only.
    noise : NoiseModel
        How e reaches the output; as equation error, as written above, when left out.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso(a=[[-1.2, 0.3], [0.5, -0.2]], b=[[0, 0], [0.4, 0.1], [0.1, -0.3]],
    ...                                  basis=Polynomial("p", degree=1), sample_time=1.0)
    >>> model.na, model.n_lags, model.frozen_poles([0.0]).round(4)
    (2, 3, array([0.6+0.3742j, 0.6-0.3742j]))
    """

    kind = "lpv-transfer-function"
    JSON = ("kind", "a", "b", "c", "basis", "sample_time", "lagged", "scheduling", "inputs", "outputs", "input_stage",
            "scheduling_stage", "noise_covariance", "noise", "metadata")

    a: np.ndarray
    b: np.ndarray
    basis: Basis
    sample_time: float
    scheduling: Scheduling | None = None
    c: np.ndarray | None = None
    lagged: bool = False
    inputs: tuple[Signal, ...] = ()
    outputs: tuple[Signal, ...] = ()
    input_stage: InputStage | None = None
    scheduling_stage: SchedulingStage | None = None
    noise_covariance: np.ndarray | None = None
    metadata: Mapping = field(default_factory=dict, metadata=VERBATIM)
    noise: NoiseModel = field(default_factory=NoiseModel, metadata=ADDED)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        checked_basis(self.basis)
        m = self.basis.size
        b = _checks.finite(_checks.frozen_array(self.b, "b", ndim=4), "b")
        ny, nu = b.shape[1], b.shape[2]
        a = _checks.frozen_array(self.a, "a")
        a = _checks.frozen_array(a.reshape(0, ny, ny, m), "a") if a.size == 0 else a
        c = np.zeros((0, ny, m)) if self.c is None else self.c
        set_(self, "a", _checks.finite(_checks.shaped(a, (None, ny, ny, m), "a"), "a"))
        set_(self, "b", _checks.shaped(b, (None, ny, nu, m), "b"))
        set_(self, "c", _checks.finite(_checks.shaped(_checks.frozen_array(c, "c"), (None, ny, m), "c"), "c"))
        set_(self, "sample_time", _checks.positive(self.sample_time, "sample_time", "s"))
        self._settle(ny, nu, f"b of shape {b.shape}")
        self.noise.check(ny, m)

    @classmethod
    def siso(cls, a: Sequence, b: Sequence, basis: Basis, sample_time: float, *, c: Sequence = (),
             lagged: bool = False, scheduling: Scheduling | None = None, **signal_names) -> LPVTransferFunction:
        """Single-input single-output model from lists of coefficient rows over the basis.

        Parameters
        ----------
        a : (na, M) nested sequence
        b : (n_lags, M) nested sequence, from lag 0 on
        c : (n_affine, M) nested sequence, from lag 0 on

        Returns
        -------
        LPVTransferFunction
            With one input and one output.
        """
        checked_basis(basis)
        m = basis.size
        arrays = {name: _checks.frozen_array(x, name) for name, x in (("a", a), ("b", b), ("c", c))}
        shaped = [_checks.shaped(x, (None, m), f"{name} (lags by basis functions)") if x.size else x.reshape(0, m)
                  for name, x in arrays.items()]
        return cls(shaped[0][:, None, None, :], shaped[1][:, None, None, :], basis, sample_time, scheduling,
                   shaped[2][:, None, :], lagged, **signal_names)

    # -- sizes --------------------------------------------------------------------------------------------------
    @property
    def na(self) -> int:
        """Number of output lags."""
        return self.a.shape[0]

    @property
    def n_lags(self) -> int:
        """Number of input lags, lag 0 included: max over channels of nb + nk."""
        return self.b.shape[0]

    @property
    def n_affine(self) -> int:
        """Number of affine lags, lag 0 included."""
        assert self.c is not None
        return self.c.shape[0]

    @property
    def n_outputs(self) -> int:
        """Number of outputs."""
        return self.b.shape[1]

    @property
    def n_filter_inputs(self) -> int:
        """Number of inputs of the linear part, after the input stage."""
        return self.b.shape[2]

    @property
    def order(self) -> int:
        """Order of the input-output equation: max(na, highest input lag)."""
        return max(self.na, self.n_lags - 1, 0)

    @property
    def memory(self) -> int:
        """Past outputs that a free run depends on: na of each."""
        return self.na * self.n_outputs

    @property
    def start(self) -> int:
        """Measured samples a free run starts from: max(na, nb + nk − 1), affine lags included."""
        assert self.c is not None
        back = [self.na, self.n_lags - 1, self.n_affine - 1]
        reach = self.basis.lags[1]
        return max([0, *back]) + (max(reach, 0))

    # -- frozen behaviour ----------------------------------------------------------------------------------------
    def coefficients(self, p: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients with the scheduling frozen at `p` of shape (n_scheduling,).

        Parameters
        ----------
        p : (n_scheduling,) array
            In the units of the variables.

        Returns
        -------
        a : (na, ny, ny) array
        b : (n_lags, ny, nu) array
        c : (n_affine, ny) array
        """
        phi = self.basis.evaluate(_point(p, self.box))[0]
        assert self.c is not None
        return self.a @ phi, self.b @ phi, self.c @ phi

    def companion(self, p: Sequence[float] | np.ndarray) -> np.ndarray:
        return block_companion(self.coefficients(p)[0])

    def forcing(self, reach: float, state: float = 0.0) -> float:
        assert self.c is not None
        return float(reach * np.abs(self.b).sum() + np.abs(self.c).sum())

    @classmethod
    def array_shapes(cls, values: Mapping) -> dict[str, tuple[int, ...]]:
        outputs, m = len(values["outputs"]), values["basis"].size
        stage, inputs = values["input_stage"], values["inputs"]
        width = len(inputs if stage is None else stage.signals(inputs))
        return {"a": (-1, outputs, outputs, m), "b": (-1, outputs, width, m), "c": (-1, outputs, m)}

    def __repr__(self) -> str:
        inputs = ", ".join(map(str, self.inputs))
        outputs = ", ".join(map(str, self.outputs))
        used = np.flatnonzero(np.any(self.b != 0.0, axis=(1, 2, 3)))
        first = int(used[0]) if used.size else 0
        return (f"LPVTransferFunction {inputs} -> {outputs}: na={self.na}, input lags {first}..{self.n_lags - 1}, "
                f"basis {{{', '.join(self.basis.labels)}}}, {1 / self.sample_time:.6g} Hz"
                + (", coefficients at p(k-i)" if self.lagged else "")
                + ("" if self.noise.kind == "equation" else f", {self.noise.kind} noise"))


def _point(p: Mapping[str, float] | Sequence[float] | np.ndarray, box: Scheduling) -> np.ndarray:
    if isinstance(p, Mapping):
        for name in p:
            _checks.known_name(name, box.names, "scheduling variable")
        missing = [name for name in box.names if name not in p]
        if missing:
            raise InputError("a scheduling point has a value for every variable", got=", ".join(map(str, p)) or "none",
                             mend=f"add {', '.join(missing)}")
        p = [p[name] for name in box.names]
    try:
        point = np.atleast_1d(np.asarray(p, dtype=float))
    except (TypeError, ValueError):
        raise InputError("a scheduling point holds numbers", got=type(p).__name__,
                         mend=f"one for each of {', '.join(box.names)}") from None
    return _checks.finite(_checks.shaped(point, (len(box.names),), "a scheduling point"), "a scheduling point")[None, :]


def block_companion(a: np.ndarray) -> np.ndarray:
    """Block companion matrix of y(k) + Σ a_i y(k−i) = 0 for `a` of shape (na, ny, ny), in observer form.

    Parameters
    ----------
    a : (na, ny, ny) array
        Coefficients of lags 1 … na.

    Returns
    -------
    (na·ny, na·ny) array
        Its eigenvalues are the poles.
    """
    na, ny = a.shape[0], a.shape[1]
    matrix = np.zeros((na * ny, na * ny))
    if na:
        matrix[:, :ny] = -a.reshape(na * ny, ny)
        matrix[: (na - 1) * ny, ny:] = np.eye((na - 1) * ny)
    return matrix
