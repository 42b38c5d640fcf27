"""Worst-case gain of an uncertain LPV system, by integral quadratic constraints."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid import _checks
from lpvid.analysis.certificates import Range, Rate
from lpvid.analysis.frozen import pole_margins
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.analysis.gain import rated
from lpvid.analysis.gain_bounds import storage_bases
from lpvid.analysis.robust_certificate import RobustCertificate, Uncertain, places, recheck_robust, uncertain
from lpvid.analysis.uncertain_blocks import PSD, Block, Dynamic
from lpvid.codec import Coded, null
from lpvid.errors import InputError
from lpvid.lmi.affine import Affine, block, block_diagonal, combined
from lpvid.lmi.certificate import diagonal, grid
from lpvid.lmi.certificate_common import verdict_of
from lpvid.lmi.driven import Driven, Matrices
from lpvid.lmi.frame import Frame, frame_of
from lpvid.lmi.program import Program
from lpvid.lmi.readings import box_of
from lpvid.lmi.storage import Storage
from lpvid.lmi.storage_search import SOLVERS, sample
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Scheduling

MARGIN = 1e-7
"""of the inequalities, in balanced coordinates; what is reported is checked apart from it"""
RAISED = (1e-6, 1e-4, 1e-3, 5e-3, 2e-2)
"""shares above the solver's bound at which its matrices are checked"""
DRAWS = 40
"""uncertainties drawn at every point and frequency for the lower bound"""
FREQUENCIES = 25


@dataclass(frozen=True, eq=False)
class RobustGain(Coded):
    """What is known of sup ‖z‖/‖w‖ over all uncertainties and all admissible trajectories of the scheduling.

    Parameters
    ----------
    verdict : str
        "certified", "certified on a grid only" or "not certified".
    upper : float
        Certified; infinite where nothing could be certified.
    lower : float
        Reached at a fixed scheduling and frequency, without uncertainty or by one that was drawn; infinite where an
        admissible uncertainty was found with which the loop is unstable. Constants are tried, and of a single `Dynamic`
        block the worst system; delays that destabilise are not sought.
    certificate : RobustCertificate or None
        What `lpvid.verify` re-checks.
    why, mend : str
    seconds : float
    """

    verdict: str
    upper: float = field(metadata=null(math.inf))
    lower: float = field(metadata=null(math.inf))
    certificate: RobustCertificate | None
    why: str = ""
    mend: str = ""
    seconds: float = 0.0

    def __repr__(self) -> str:
        lines = [f"{self.verdict}: {self.why or (self.certificate.claim if self.certificate else '')}"]
        if self.certificate is None:
            lines.append(f"  at least {self.lower:.6g}, by an uncertainty that was drawn or by none"
                         if math.isfinite(self.lower) else "  an uncertainty was found with which the loop is unstable")
        else:
            lines.append(f"  at least {self.lower:.6g}, by an uncertainty that was drawn; margin "
                         f"{self.certificate.margin:.3g}, re-checked with numpy")
        return "\n".join(lines + ([f"  mend: {self.mend}"] if self.mend else []))


def robust_gain(system: LPVStateSpace, blocks: Block | Sequence[Block], rate: Rate = None, basis: Basis | None = None,
                *, range: Range = None, poles: Sequence[float] | None = None) -> RobustGain:
    """Bounds of the induced L2 (ℓ2) gain of a system in feedback with uncertainties p = Δ(q).

    ::

             ┌─── Δ <──┐
           p │         │ q        w, z: the system's other inputs and outputs
             └─>┌───┐──┘
           w ──>│ G │──> z        G(p(t)) with its scheduling, at most at the given rates
                └───┘

    Parameters
    ----------
    system : LPVStateSpace
        G, stable for every fixed scheduling without uncertainty.
    blocks : Block or sequence of Block
        `Parametric`, `Dynamic`, `Sector`, `Lipschitz`, `Delay`, each with the names of its signals.
    rate, basis, range
        As for `l2_gain`; without a basis the storage function is a constant, then of degree 1 where rates allow it.
    poles : sequence of float, optional
        Of the filters in the constraints [1/s]: frequencies at which the uncertainty matters. Left out, one at the
        median speed of the system. More tighten the bound, and cost.

    Returns
    -------
    RobustGain

    Raises
    ------
    InputError
        Blocks that do not fit the system, a system that is unstable without uncertainty.

    Examples
    --------
    >>> from lpvid.analysis.uncertain_blocks import Parametric
    >>> from lpvid.scheduling import Polynomial
    >>> lag = LPVStateSpace([[[-1.0]]], [[[1.0, 1.0]]], [[[1.0], [1.0]]], np.zeros((1, 2, 2)), Polynomial((), 0), None,
    ...                     inputs=("p", "w"), outputs=("q", "z"))
    >>> found = robust_gain(lag, Parametric("p", "q", 0.5))      # 1/(s + 1 − δ): 2 for δ = ½
    >>> round(found.upper, 3), round(found.lower, 3), found.verdict
    (2.0, 2.0, 'certified')
    """
    started = time.perf_counter()
    blocks = (blocks,) if isinstance(blocks, Block) else tuple(blocks)
    if not blocks or not all(isinstance(b, Block) for b in blocks):
        raise InputError("a worst case needs blocks of uncertainty", got=[type(b).__name__ for b in blocks] or "none",
                         mend="lpv.Parametric(\"p\", \"q\", bound) or another block, or l2_gain without any")
    asked = rated(system.box, rate, range)
    also = () if basis is None else tuple(n for n in basis.names if n in system.box.names)
    bare = uncertain(system, blocks, poles or (1.0,), also)
    box = box_of(bare.whole.readings, asked)
    nominal = _Nominal(bare.base, blocks)
    points = grid(box, {0: 1, 1: 9, 2: 4}.get(len(box.names), 2))
    _refuse_unstable(nominal, points, box)
    if poles is None:
        a = nominal.matrices(points)[0]
        poles = (float(np.median(np.abs(np.linalg.eigvals(a)))) if a.shape[1] else 1.0,)
    for pole in poles:
        _checks.positive(pole, "a pole of the filters", "1/s")
    whole = uncertain(system, blocks, poles, also)
    best: RobustCertificate | None = None
    for trial in storage_bases(whole.whole, box, basis, highest=1):
        found = _certified(whole, box, trial, nominal, points)
        if found is not None and (best is None
                                  or (found.between_grid, -found.gamma) > (best.between_grid, -best.gamma)):
            best = found
        elif best is not None and basis is None:
            break
    lower = _lower(bare, points, nominal)
    seconds = time.perf_counter() - started
    if best is None:
        return RobustGain("not certified", math.inf, lower, None, "no storage function and multipliers were found that "
                          "bound the gain for every uncertainty", "smaller bounds, further poles of the filters, a "
                          "rate bound with basis=…, or a narrower range", seconds)
    return RobustGain(verdict_of(best.between_grid), best.gamma,
                      min(lower, best.gamma), best, seconds=seconds)


@dataclass(frozen=True, eq=False)
class _Nominal:
    """The system with p = 0, or p = q for blocks that follow, as `frame_of` takes it."""

    base: Driven
    blocks: tuple[Block, ...]

    @property
    def order(self) -> int:
        return self.base.order

    @property
    def sample_time(self) -> float | None:
        return self.base.sample_time

    def matrices(self, points: np.ndarray) -> Matrices:
        """A, B, C, D from w to z at N points."""
        a, b, c, d = self.base.matrices(points)
        p, w, q, z = places(self.base, self.blocks)
        k = diagonal(*(np.eye(len(x.inputs)) if x.follows else np.zeros((len(x.inputs), len(x.outputs)))
                       for x in self.blocks))
        loop = np.linalg.solve(np.eye(len(p)) - k @ d[:, q][:, :, p], np.broadcast_to(k, (len(a), *k.shape)))
        u, v = loop @ c[:, q], loop @ d[:, q][:, :, w]
        return (a + b[:, :, p] @ u, b[:, :, w] + b[:, :, p] @ v, c[:, z] + d[:, z][:, :, p] @ u,
                d[:, z][:, :, w] + d[:, z][:, :, p] @ v)


_range = range  # an argument of the public function bears its name


def _refuse_unstable(nominal: _Nominal, points: np.ndarray, box: Scheduling) -> None:
    level = pole_margins(nominal.matrices(points)[0], nominal.sample_time is not None)
    if level.max() >= 0:
        at = points[int(level.argmax())]
        where = ", ".join(f"{n} = {v:.4g}" for n, v in zip(box.names, at, strict=True)) or "every time"
        raise InputError("the system is not stable without uncertainty", got=f"a pole beyond the limit at {where}",
                         mend="stabilise it, or narrow the range")


def _certified(system: Uncertain, box: Scheduling, basis: Basis, nominal: _Nominal, points: np.ndarray
               ) -> RobustCertificate | None:
    """The least bound whose matrices pass the re-check, on the whole box if possible."""
    frame = _framed(system, frame_of(nominal, points))  # type: ignore[arg-type]
    found: RobustCertificate | None = None
    for storage, parts, gamma, solver in _proposals(system, box, basis, frame):
        for share in RAISED:
            level = gamma * (1 + share)
            check = recheck_robust(system, storage, parts, level)
            if check.holds and (found is None or check.between_grid > found.between_grid):
                found = RobustCertificate(level, storage.matrices, parts, system.blocks, system.poles, basis, box,
                                          system.base.sample_time, system.whole.digest, system.inputs, system.outputs,
                                          check.margin, check.between_grid, solver)
            if check.holds and check.between_grid:
                return found
        if found is not None:
            return found
    return found


def _framed(system: Uncertain, frame: Frame) -> Frame:
    """Coordinates of the system's states with the filters' own."""
    states = diagonal(frame.states, np.eye(system.whole.order - system.base.order))
    return Frame(states, frame.time, frame.gain)


def _proposals(system: Uncertain, box: Scheduling, basis: Basis, frame: Frame
               ) -> Iterator[tuple[Storage, tuple[tuple[np.ndarray, ...], ...], float, str]]:
    program, whole, np_ = Program(), system.whole, system.uncertain
    n, discrete = whole.order, whole.sample_time is not None
    p = [program.unknowns.symmetric(n) for _ in _range(basis.size)]
    parts: list[list[Affine]] = []
    for b in system.blocks:
        own = []
        for kind, size in b.unknowns(system.poles):
            own.append(program.unknowns.symmetric(size) if kind == PSD else program.unknowns.antisymmetric(size))
            if kind == PSD:
                program.require(own[-1], margin=MARGIN)
        parts.append(own)
    multiplier = block_diagonal([b.multiplier(own, system.poles) for b, own in zip(system.blocks, parts, strict=True)])
    level = program.unknowns.scalar()
    template = Storage(np.zeros((basis.size, n, n)), basis, box, whole.sample_time)
    points, shifts = sample(whole, template, 1.0, 2)
    a, b, c, d = whole.matrices(points)
    inverse, root, rows = np.linalg.inv(frame.states), math.sqrt(frame.gain), system.filtered
    a, b, c = frame.time * inverse @ a @ frame.states, frame.time * inverse @ b, c @ frame.states
    b, d = b.copy(), d.copy()
    b[:, :, np_:] /= root
    d[:, :, np_:] /= root
    c[:, rows:] /= root
    d[:, rows:] /= root
    psi = template.psi(points)
    moved = _moved(template, points, shifts, discrete, frame.time)
    nw = b.shape[2] - np_
    for k in _range(len(points)):
        both, seen, out = (np.hstack([x, y]) for x, y in ((a[k], b[k]), (c[k, :rows], d[k, :rows]),
                                                          (c[k, rows:], d[k, rows:])))
        now, eye = combined(p, psi[k]), np.eye(n, both.shape[1])
        program.require(now, margin=MARGIN)
        supply = level.times(np.diag(np.r_[np.zeros(n + np_), np.ones(nw)]))
        constraint = seen.T @ multiplier @ seen
        for step in moved[k]:
            if discrete:
                flow = both.T @ combined(p, step) @ both - eye.T @ now @ eye
            else:
                cross = eye.T @ now @ both
                flow = cross + cross.T + eye.T @ combined(p, step) @ eye
            program.require(block([[supply - flow - constraint, out.T], [out, level.times(np.eye(len(out)))]]),
                            margin=MARGIN)
    program.minimise(level)
    for found in program.solve(solvers=SOLVERS):
        gamma = float(found[level][0, 0]) * frame.gain
        if not 0 < gamma < 1e8 * frame.gain:
            continue
        matrices = frame.outside(np.array([found[x] for x in p]))
        values = tuple(tuple(_clean(found[x], kind) for x, (kind, _) in zip(own, b.unknowns(system.poles), strict=True))
                       for own, b in zip(parts, system.blocks, strict=True))
        yield Storage(matrices, basis, box, whole.sample_time), values, gamma, found.solver


def _moved(template: Storage, points: np.ndarray, shifts: np.ndarray, discrete: bool, time: float) -> list[np.ndarray]:
    """For each point the functions one sample later, or their derivatives at the corners of the rates."""
    basis, box = template.basis, template.box
    if discrete:
        return [template.psi(template.scheduling_after(point[None], shifts)) for point in points]
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=len(template.moving))))
    found = []
    for point in points:
        slopes = np.array([basis.derivative(point[None, template.columns], box.names[i])[0] * (box.rate[i] or 0.0)
                           for i in template.moving]).reshape(len(template.moving), basis.size)
        found.append(corners @ slopes * time)
    return found


def _lower(system: Uncertain, points: np.ndarray, nominal: _Nominal) -> float:
    """What the worst case is at least: p = 0 is admissible, and so are the uncertainties that are drawn.

    A gain at one frequency counts whether or not the loop is stable: where it is not, the worst case is infinite.
    """
    if _destabilised(system, points):
        return math.inf
    discrete = nominal.sample_time is not None
    still = max(h_infinity_norm(m, discrete)[0] for m in zip(*nominal.matrices(points), strict=True))
    return max(still, _reached(system, points, nominal))


def _destabilised(system: Uncertain, points: np.ndarray) -> bool:
    """Whether the loop is unstable at a fixed scheduling with a constant that was drawn, or a worst `Dynamic`."""
    base, blocks = system.base, system.blocks
    a, b, c, d = (x[: len(points)] for x in base.matrices(points))
    p, _, q, _ = places(base, blocks)
    discrete = base.sample_time is not None
    c, b, d = c[:, q], b[:, :, p], d[:, q][:, :, p]
    if len(blocks) == 1 and isinstance(blocks[0], Dynamic):  # the small gain theorem is exact for a full block
        return any(h_infinity_norm(m, discrete)[0] * blocks[0].bound >= 1 for m in zip(a, b, c, d, strict=True))
    generator = np.random.default_rng(1)
    for _ in _range(DRAWS):
        delta = diagonal(*(_constant(x, generator) for x in blocks))
        try:
            loop = a + b @ np.linalg.solve(np.eye(len(p)) - delta @ d, delta @ c)
        except np.linalg.LinAlgError:
            return True
        if loop.shape[1] and pole_margins(loop, discrete).max() >= 0:
            return True
    return False


def _constant(block: Block, generator: np.random.Generator) -> np.ndarray:
    """(p, q) real gain that the block allows: at zero frequency; the real part of a `Dynamic` is no larger."""
    return np.real(block.draw(0j, generator))


def _reached(system: Uncertain, points: np.ndarray, nominal: _Nominal) -> float:
    """Largest gain at fixed scheduling and frequency of drawn uncertainties."""
    generator = np.random.default_rng(0)
    a = nominal.matrices(points)[0]
    discrete = system.base.sample_time is not None
    poles = np.abs(np.linalg.eigvals(a)).ravel() if a.shape[1] else np.ones(1)
    poles = poles[poles > 1e-9 * poles.max()]
    omega = np.r_[0.0, np.linspace(0, np.pi, FREQUENCIES)[1:] if discrete
                  else np.geomspace(poles.min() / 10, 10 * poles.max(), FREQUENCIES)]
    best = 0.0
    m = [x[: len(points)] for x in system.base.matrices(points)]
    p, w, q, z = places(system.base, system.blocks)
    for frequency in omega:
        s = np.exp(1j * frequency) if discrete else 1j * frequency
        try:
            g = m[2] @ np.linalg.solve(s * np.eye(system.base.order) - m[0], m[1].astype(complex)) + m[3]
        except np.linalg.LinAlgError:
            continue
        for _ in _range(DRAWS):
            delta = diagonal(*(b.draw(s, generator) for b in system.blocks))
            inner = np.eye(len(p)) - delta @ g[:, q][:, :, p]
            try:
                closed = np.linalg.solve(inner, delta @ g[:, q][:, :, w])
            except np.linalg.LinAlgError:  # a pole of the loop on the limit
                return math.inf
            loop = g[:, z][:, :, w] + g[:, z][:, :, p] @ closed
            best = max(best, float(np.linalg.norm(loop, 2, axis=(1, 2)).max()))
    return best


def _clean(matrix: np.ndarray, kind: str) -> np.ndarray:
    """Exactly symmetric and safely positive, or exactly antisymmetric."""
    if kind != PSD:
        return 0.5 * (matrix - matrix.T)
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    floor = 1e-12 * max(values.max(initial=0.0), 1e-12)
    found = vectors * np.maximum(values, floor) @ vectors.T
    return 0.5 * (found + found.T)
