"""LipschitzObserver: an observer for a plant with a nonlinearity of which only a Lipschitz constant is known."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.analysis.robust_gain import RobustGain, robust_gain
from lpvid.analysis.uncertain_blocks import Lipschitz
from lpvid.errors import InputError
from lpvid.lmi.affine import block, combined, given, he
from lpvid.lmi.program import Program
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial
from lpvid.synthesis.design_grid import check_back_off, check_rates, columns, design_axes, is_affine, tensor, varies
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.matrix_function import MatrixFunction
from lpvid.synthesis.matrix_function import block as function_block
from lpvid.synthesis.plant_functions import assembled, named, plant_functions
from lpvid.synthesis.shaped_loop import moves
from lpvid.synthesis.shaped_program import INTERIOR_POINT, SignalCoordinates, size_and_condition

STRICT = 1e-7
"""margin of the inequalities, in scaled coordinates"""


@dataclass(frozen=True, eq=False)
class LipschitzEstimate:
    """An observer with a verified bound of its error for every nonlinearity of the class.

    Parameters
    ----------
    observer : LPVStateSpace or None
        From the plant's known inputs, its measurements and the value φ(q̂) of the nonlinearity at the estimate, to the
        estimates of z and of q: the nonlinearity stands outside, as ``connect`` or a user's own code closes it.
    error : LPVStateSpace or None
        From the disturbances and the difference of the nonlinearity to the errors of z and q.
    gain : RobustGain or None
        Verified for `error` in feedback with any such difference: what to quote.
    promised : float or None
        By the design inequality.
    why, mend : str
    seconds : float
    """

    observer: LPVStateSpace | None
    error: LPVStateSpace | None
    gain: RobustGain | None
    promised: float | None
    why: str = ""
    mend: str = ""
    seconds: float = 0.0

    @property
    def solved(self) -> bool:
        """There is an observer with a verified bound."""
        return self.observer is not None

    def __repr__(self) -> str:
        if self.gain is None:
            return f"infeasible: {self.why}\n  mend: {self.mend}"
        return f"observer for a Lipschitz nonlinearity, promised {self.promised:.6g}\n{self.gain!r}"


@dataclass(frozen=True, eq=False)
class LipschitzObserver:
    """ẋ̂ = A x̂ + B u + E φ(q̂) + L(p)(y − C2 x̂), q̂ = H x̂, for ẋ = A x + B u + E φ(q) + B1 w, q = H x.

    φ is known or not, as long as |φ(q, t) − φ(q̂, t)| ≤ ℓ|q − q̂|. With V = eᵀP(p)e and Y = P L

        [ He(PA − YC2) + Ṗ + τℓ²HᵀH   PE   PB1 − YD21   C1ᵀ  ]
        [ ⋆                           −τI  0            0    ]
        [ ⋆                           ⋆    −γI          D11ᵀ ] ≺ 0,      τ > 0
        [ ⋆                           ⋆    ⋆            −γI  ]

    is linear in P, Y, τ and γ (the S-procedure with the constraint of `lpv.Lipschitz`; Rajamani, IEEE TAC 43 (1998)
    397-401, has P alone and no w). What is reported is the bound of `lpv.robust_gain` for the finished error.

    Parameters
    ----------
    nonlinear : sequence of str
        Inputs of the plant through which φ acts (E).
    arguments : sequence of str
        Performance signals that are the argument q (H).
    constant : float
        ℓ.
    lyapunov : Basis, optional
        Functions of P(p) and, one degree more where they move, of Y(p).
    points : int
    back_off : float
        Factor above the least bound at which the gain is then made small.

    Examples
    --------
    >>> LipschitzObserver("friction", "speed", 2.0).constant
    2.0
    """

    nonlinear: tuple[str, ...] | str
    arguments: tuple[str, ...] | str
    constant: float
    lyapunov: Basis | None = None
    points: int = 7
    back_off: float = 1.05

    def __post_init__(self) -> None:
        for field in ("nonlinear", "arguments"):
            value = getattr(self, field)
            object.__setattr__(self, field, (value,) if isinstance(value, str) else tuple(value))
        _checks.positive(self.constant, "a Lipschitz constant")
        check_back_off(self.back_off)

    def solve(self, plant: GeneralizedPlant) -> LipschitzEstimate:
        """The observer for a plant in continuous time.

        Parameters
        ----------
        plant : GeneralizedPlant
            In continuous time, with the arguments q of the nonlinearity among its outputs.

        Returns
        -------
        LipschitzEstimate
            The observer, its error system and the verified gain; without a gain, why and what would mend it.

        Raises
        ------
        InputError
            A discrete plant, signals that it does not have, arguments that inputs reach directly.
        """
        started = time.perf_counter()
        problem = _Parts.of(self, plant)
        least = problem.solved(self, None)
        method = "no gain makes the error decay for every such nonlinearity"
        if least is None:
            return LipschitzEstimate(None, None, None, None, method, f"a smaller constant than {self.constant:g}, or "
                                     f"more measurements than {', '.join(plant.measurements)}",
                                     time.perf_counter() - started)
        gamma, law = problem.solved(self, self.back_off * least[0]) or least  # of least size, a little above the least
        observer, error = problem.built(law)
        blocks = Lipschitz(tuple(f"{n}_difference" for n in problem.phi), tuple(f"{n}_error" for n in problem.q),
                           bound=self.constant)
        gain = robust_gain(error, blocks, None, self.lyapunov)
        if gain.certificate is None:
            return LipschitzEstimate(None, None, None, gamma, "the promise could not be verified",
                                     "raise back_off or points", time.perf_counter() - started)
        return LipschitzEstimate(observer, error, gain, gamma, seconds=time.perf_counter() - started)


@dataclass(frozen=True, eq=False)
class _Parts:
    """A plant sorted for the design: E, H and the rest, in scaled coordinates at the points of a grid."""

    plant: GeneralizedPlant
    phi: tuple[str, ...]
    q: tuple[str, ...]
    lyapunov: Basis
    gain: Basis
    points: np.ndarray

    @classmethod
    def of(cls, design: LipschitzObserver, plant: GeneralizedPlant) -> _Parts:
        if plant.sample_time is not None:
            raise InputError("an observer for a Lipschitz nonlinearity is designed in continuous time",
                             got=f"a period of {plant.sample_time:g} s", mend="lpv.to_continuous")
        phi = tuple(_checks.known_name(n, plant.disturbances, "input of the nonlinearity") for n in design.nonlinear)
        q = tuple(_checks.known_name(n, plant.performance, "argument of the nonlinearity") for n in design.arguments)
        if not set(plant.disturbances) - set(phi) or not set(plant.performance) - set(q):
            raise InputError("besides the nonlinearity a disturbance and a signal to estimate are needed",
                             got=f"{', '.join(plant.disturbances)}; {', '.join(plant.performance)}")
        lyapunov = (design.lyapunov or Polynomial((), 0)).bound(plant.box)
        check_rates(lyapunov, plant.box, None)
        m = plant.at(plant.box.grid(2))
        rows = [plant.performance.index(n) for n in q]
        if m.D11[:, rows].any() or m.D12[:, rows].any():
            raise InputError("inputs reach the argument of the nonlinearity directly", got=", ".join(q),
                             mend="take a signal of the states alone as argument")
        seen = [plant.disturbances.index(n) for n in phi]
        if m.D21[:, :, seen].any() or m.D11[:, :, seen].any():
            raise InputError("the nonlinearity reaches a measurement or estimated signal directly",
                             got=", ".join(phi), mend="measure states, not their derivatives")
        affine = not lyapunov.names and is_affine(plant.system.basis) and not varies(m.C2) and not varies(m.D21)
        gain = Polynomial(plant.box.names, 1 + (lyapunov.degree or 0)).bound(plant.box)
        return cls(plant, phi, q, lyapunov, gain, tensor(design_axes(plant.box, design.points, affine)))

    def solved(self, design: LipschitzObserver, bound: float | None) -> tuple[float, MatrixFunction] | None:
        """(γ, L) of least γ, or of P and Y of least size at a bound."""
        raw = self.plant.at(self.points)
        c = SignalCoordinates.of(raw, False)
        m, root = c.scaled(raw), np.sqrt(c.pace)
        n, ny = self.plant.order, len(self.plant.measurements)
        phi = [self.plant.disturbances.index(x) for x in self.phi]
        w = [i for i in range(m.B1.shape[2]) if i not in phi]
        q = [self.plant.performance.index(x) for x in self.q]
        z = [i for i in range(m.C1.shape[1]) if i not in q]
        program = Program()
        p = [program.unknowns.symmetric(n) for _ in range(self.lyapunov.size)]
        y = [program.unknowns.matrix(n, ny) for _ in range(self.gain.size)]
        tau, level = program.unknowns.scalar(), program.unknowns.scalar() if bound is None else given(bound)
        program.require(tau, margin=STRICT)
        psi, weights = columns(self.plant.box, self.lyapunov, self.points), columns(self.plant.box, self.gain,
                                                                                    self.points)
        for k, point in enumerate(self.points):
            at, pk, yk = m.point(k), combined(p, psi[k]), combined(y, weights[k])
            h, e = at.C1[q] / root, at.B1[:, phi] / root
            b1, d21, c1 = at.B1[:, w] / root, at.D21[:, w], at.C1[z] / root
            flow = (pk @ at.A) * (1 / c.pace) - (yk @ at.C2) * (1 / root)
            direct, nw, nz = at.D11[z][:, w], len(w), len(z)
            program.require(pk, margin=STRICT)
            drift = moves(self.plant.box, self.lyapunov, point, None) or [np.zeros(len(p))]
            for step in drift:
                state = -he(flow) - combined(p, step / c.pace) - tau.times(design.constant**2 * h.T @ h)
                push, kick = -(pk @ e), -(pk @ b1) + yk @ d21
                apart = np.zeros((len(phi), nw)), np.zeros((len(phi), nz))
                program.require(block([
                    [state, push, kick, c1.T], [push.T, tau.times(np.eye(len(phi))), *apart],
                    [kick.T, np.zeros((nw, len(phi))), level.times(np.eye(nw)), direct.T],
                    [c1, np.zeros((nz, len(phi))), direct, level.times(np.eye(nz))]]), margin=STRICT)
        if bound is None:
            program.minimise(level)
        else:
            program.minimise(size_and_condition(program, above=[combined(p, x) for x in psi],
                                  below=[combined(y, x) for x in weights]))
        for found in program.solve(solvers=INTERIOR_POINT):
            gamma = float(found[level][0, 0]) if bound is None else bound
            values = np.array([found[x] for x in p])
            here = np.tensordot(psi, values, axes=1)
            if gamma <= 0 or np.linalg.eigvalsh(here).min() <= 0:
                continue
            gains = np.tensordot(weights, np.array([found[x] for x in y]), axes=1)
            law = root * c.states[:, None] * np.linalg.solve(here, gains) / c.measurements
            return gamma, MatrixFunction(self.gain, np.tensordot(np.linalg.pinv(weights), law, axes=1))
        return None

    def built(self, law: MatrixFunction) -> tuple[LPVStateSpace, LPVStateSpace]:
        """The observer, and the error that it leaves."""
        plant, f = self.plant, plant_functions(self.plant)
        d, out = plant.disturbances, plant.performance
        phi, w = [d.index(x) for x in self.phi], [i for i, x in enumerate(d) if x not in self.phi]
        ny, nz, n = len(plant.measurements), len(out), plant.order
        every, rows = list(range(n)), list(range(ny))
        e, b1, d21 = f["B1"][every, phi], f["B1"][every, w], f["D21"][rows, w]
        state = f["A"] - law @ f["C2"]
        observer = [[state, f["B2"] - law @ f["D22"], e, law], [f["C1"], f["D12"], np.zeros((nz, len(phi) + ny))]]
        error = function_block([[state, e, b1 - law @ d21],
                                [f["C1"], np.zeros((nz, len(phi))), f["D11"][list(range(nz)), w]]])
        signals = {s.name: s for s in (*plant.system.inputs, *plant.system.outputs)}
        inputs = (*(signals[x] for x in (*plant.controls,)), *(Signal(f"{x}_estimate", signals[x].unit)
                                                              for x in self.phi),
                  *(signals[x] for x in plant.measurements))
        differences = tuple(Signal(f"{x}_difference", signals[x].unit) for x in self.phi)
        return (self._system(function_block(observer), inputs, named(plant, out, "_estimate")),
                self._system(error, (*differences, *named(plant, [d[i] for i in w])), named(plant, out, "_error")))

    def _system(self, whole: MatrixFunction, inputs: tuple[Signal, ...], outputs: tuple[Signal, ...]) -> LPVStateSpace:
        return assembled(whole, self.plant.order, self.plant, inputs, outputs)
