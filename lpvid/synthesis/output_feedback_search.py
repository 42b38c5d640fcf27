"""From the inequalities of output feedback to a controller whose closed loop was looked at, or a reason."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid.analysis.rated_certificate import RatedGainCertificate
from lpvid.lmi.gain_certificate import GainCertificate
from lpvid.lmi.hull_certificate import HullCertificate
from lpvid.lmi.program import available
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.balanced_plant import BalancedPlant, convex_axes
from lpvid.synthesis.controller_formula import ControllerFormula, FeedbackLaw, Variations
from lpvid.synthesis.controller_table import bounds_at, dense, loop_at, polynomial, smooth, table
from lpvid.synthesis.design_grid import distinct, tensor
from lpvid.synthesis.fast_states import FAST, fastest_pole, without_fast_states
from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.infeasibility import hopeless, obstacle
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.loop_certificate import certificate_of
from lpvid.synthesis.loop_check import frozen_gain
from lpvid.synthesis.moderated import NOISE, SLACK, Moderated
from lpvid.synthesis.polytope import MOST_DEGREE, Polytope, affine_controller
from lpvid.synthesis.progress import remember, stage, stop_at, stopped
from lpvid.synthesis.projected_search import ROOMY, conditioned, least_bound, roomy
from lpvid.synthesis.projection import MatrixPair, ProjectedInequalities
from lpvid.synthesis.regularised_plants import restrained, stirred
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.riccati import ROOM, central, least_gain

SOLVERS = ("CLARABEL", "MOSEK", "SDPA")
STEPS = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
"""multiples of the design's back-off that are tried"""
ROOMS = (1.0, 0.5, 0.25)
"""Shares of the room between the least bound and a requested one that a formula takes: `MOVING` allows the proof up to
5 % of its bound, which must fit below the request."""
SOLVED = 0.12
"""share above the least bound of any route up to which a verified gain is "solved"; beyond it is "backed-off" """
STIRRED = (1e-1, 1e-2, 1e-3)
"""Disturbances at the controls, or weights on measurements, where a plant's own leave its inequalities without answer:
shares of its own. On the example for which SLICOT gives 4.4825 shares of 7e-2, 7e-3 and 7e-4 have the least bounds
4.469, 4.464 and 4.463, and 1e-1 to 1e-3 end at a verified 4.479; smaller ones leave rounding no room."""
RICCATI = "by Riccati equations"
"""status of a pair whose bound the inequalities did not reach"""
NOTHING = 1e-8
"""Share of the plant's size, a solver's accuracy, below which a least bound counts as zero. Only infinite gains come
close to that; what is then requested is the least bound with the least of `NOISE` in every measurement and control."""
MISSED = 1e-3
"""share by which another route's least bound must be below that of the inequalities to take its place"""
MORE, AT_ONCE, APART = 30, 6, 0.15
"""design points that may be added, how many at a time, and how far from each other in half widths of the box."""
HALVED = 12
"""How often a cell of a controller's table may be halved: to 1/4096 of a twelfth of the box."""
LOST = 1e-2
"""share above the bound of the two blocks up to which another storage function may stand in for them: `hull_gain`
raises a solver's level by so much at most"""
SEGMENTS = {1: (12, 24, 48, 96), 2: (4, 8, 14), 3: (3, 5)}
"""Of the splines in each variable with which a controller is written down, by the number of variables."""


@dataclass(frozen=True, eq=False)
class FeedbackProblem:
    """A plant with everything that decides its output feedback.

    Parameters
    ----------
    plant : BalancedPlant
    variations : Variations
        Of X and Y.
    axes : tuple of arrays
        Grid at which the inequalities are imposed.
    corners : bool
        They then hold on the whole box, for the controller that is linear in between.
    strictly_proper : bool
    extra : (·, n_scheduling) array
        Further points at which the inequalities are imposed.
    solvers : tuple of str
    linear : mapping of name to array
        Variables along which the values given, those of `axes`, stand for all between them (`linear_axes`).
    polytope : Polytope, optional
        The scheduling set where that is no box: its vertices take the place of the grid of `axes`.
    """

    plant: BalancedPlant
    variations: Variations
    axes: tuple[np.ndarray, ...]
    corners: bool
    strictly_proper: bool
    extra: np.ndarray
    solvers: tuple[str, ...] = SOLVERS
    linear: Mapping[str, np.ndarray] = field(default_factory=dict)
    polytope: Polytope | None = None

    @property
    def points(self) -> np.ndarray:
        """(N, n_scheduling) design points."""
        if self.polytope is None:
            return np.vstack([tensor(self.axes), self.extra])
        if self.corners:
            return np.vstack([self.polytope.vertices, self.extra])
        return np.vstack([self.polytope.spread(max(map(len, self.axes))), self.extra])

    @property
    def looked(self) -> np.ndarray:
        """(N, n_scheduling) points at which the frozen closed loop is looked at."""
        box = self.plant.plant.box
        if self.polytope is not None:
            return self.polytope.looked
        return box.grid({0: 1, 1: 41, 2: 9}.get(len(box.names), 4))

    @property
    def free(self) -> tuple[str, ...]:
        """Variables with width along which all values must be looked at."""
        box = self.plant.plant.box
        return tuple(n for n, a in zip(box.names, self.axes, strict=True) if len(a) > 1 and n not in self.linear)

    @property
    def segments(self) -> tuple[int, ...]:
        """Numbers of splines in each free variable that are tried."""
        return SEGMENTS[min(max(len(self.free), 1), 3)]

    def dense(self, cells: int) -> np.ndarray:
        """(N, n_scheduling) points, so many cells along every free variable.

        Parameters
        ----------
        cells : int

        Returns
        -------
        (N, n_scheduling) array
        """
        if self.polytope is not None:
            return self.polytope.spread(cells)
        return dense(self.plant.plant.box, cells, self.linear)

    @property
    def projected(self) -> ProjectedInequalities:
        """The inequalities, once for points that are alike (the ends of a whole period)."""
        plant, points = self.plant.at(self.points), self.points
        x, y = self.variations.at(points, self.plant.units.time)
        blocks = [getattr(plant, f) for f in plant.__dataclass_fields__]
        apart = distinct([*blocks, x.values, x.slopes, y.values, y.slopes])
        return ProjectedInequalities(plant.point(apart), x.part(apart), y.part(apart), self.strictly_proper)

    @property
    def richer(self) -> str:
        """What a Lyapunov matrix with more freedom would need; empty where nothing moves."""
        if not self.plant.plant.box.half_width.any():
            return ""
        if self.polytope is not None:
            rates = ", or give rate bounds and a Lyapunov basis (lyapunov=)" if self.variations.basis is None else ""
            return f"{rates}, or design for a smaller hull"
        if self.variations.basis is None:
            return ", or give rate bounds and a Lyapunov basis (lyapunov=)"
        return ", or a richer Lyapunov basis (a higher degree, more of the variables), or lower rate bounds"

    @property
    def method(self) -> str:
        """In a few words."""
        v = self.variations
        kind = "one X and Y" if v.basis is None else f"{v.varying} over {', '.join(v.basis.labels)}"
        over = "" if self.polytope is None else f" on {self.polytope.text}"
        return f"output feedback, {kind}, {len(self.points)} point{'s' if len(self.points) != 1 else ''}{over}"


def search(problem: FeedbackProblem, wanted: float | None, back_off: float) -> Synthesis:
    """The controller of the least back-off whose closed loop keeps its bound at every point looked at.

    Where X(p), Y(p) lose the bound between the points of the grid, points are added there. Where the first solver's
    answers lead to no controller near the least bound, the next one leads.

    Parameters
    ----------
    problem : FeedbackProblem
        Plant, grid and what may vary.
    wanted : float or None
        A gain that is good enough; None for the least.
    back_off : float
        Share above the least bound; multiples of it are tried.

    Returns
    -------
    Synthesis
        "solved", "backed-off", "infeasible" or "numerical".
    """
    found = _refined(problem, wanted, back_off)
    rest = problem.solvers[1:]
    if found.verdict in ("numerical", "backed-off") and rest and not stopped() and available(rest):
        other = _refined(replace(problem, solvers=rest), wanted, back_off)
        found = _better(found, other, wanted)
    return found


def _refined(problem: FeedbackProblem, wanted: float | None, back_off: float) -> Synthesis:
    known: MatrixPair | None = None
    refused: dict[int, float] = {}
    while True:
        found = _search(problem, wanted, back_off, known, refused)
        if isinstance(found, Synthesis):
            return remember(found)
        points, known, refused = found
        problem = replace(problem, extra=np.vstack([problem.extra, points]))


def _better(one: Synthesis, other: Synthesis, wanted: float | None) -> Synthesis:
    """The lower verified gain, judged by the least bound of both, or by the one asked for as it was; a proof that there
    is none goes before a failure."""
    if one.controller is None and other.controller is None:
        return other if other.verdict == "infeasible" else one
    best = min((s for s in (one, other) if s.gamma_verified is not None), key=lambda s: s.gamma_verified or np.inf)
    least = min(s.infimum for s in (one, other) if s.infimum is not None)
    verified = best.gamma_verified or np.inf
    if wanted is not None:
        return replace(best, infimum=least)
    return replace(best, infimum=least, verdict="solved" if verified <= (1 + SOLVED) * least else "backed-off",
                   why=kept_near(verified, least))


def kept_near(verified: float, least: float) -> str:
    """A verified gain beside the least bound, in words.

    Parameters
    ----------
    verified, least : float

    Returns
    -------
    str
    """
    return (f"the closed loop keeps {verified:.6g}, {100 * (verified / least - 1):.2g} % above {least:.6g}, the least "
            "bound of any route")


def _search(problem: FeedbackProblem, wanted: float | None, back_off: float, known: MatrixPair | None,
            refused: Mapping[int, float]) -> Synthesis | tuple[np.ndarray, MatrixPair, dict[int, float]]:
    """A synthesis, or (·, n_scheduling) points at which the inequalities are wanted too, with the pair of these and the
    bounds that noise was found to cost (`Moderated.fewer`)."""
    verdict, why, mend = "", "", ""
    projected = problem.projected
    best = _least(projected, problem.solvers, known)
    if best is None or best.status == ROOMY:
        verdict, why, mend = obstacle(problem.plant.plant, projected, on_hull=problem.polytope is not None)
        if verdict == "infeasible":
            return Synthesis(verdict, why=why, mend=mend, method=problem.method)
    if best is None or best.status in (ROOMY, RICCATI):
        projected, best = _stirred(problem, projected, best)
    if best is None:
        return Synthesis(verdict, why=why, mend=mend, method=problem.method)
    weights = f"lower the weights on {', '.join(problem.plant.plant.performance)}"
    if wanted is not None and wanted < best.gamma:
        return Synthesis("infeasible", why=f"the gain cannot be brought below {wanted:.6g}: {best.gamma:.6g} is the "
                         "least that the inequalities admit", infimum=best.gamma, method=problem.method,
                         mend=f"ask for more than {best.gamma:.6g}, or {weights}{problem.richer}")
    target, note = _target(problem, projected, best)
    moderated = Moderated(projected, best, problem.solvers[:1], refused)
    rapid: Synthesis | None = None  # verified, with states that no sampled target can run
    over: Synthesis | None = None  # verified, above the bound that was asked for
    moving = problem.polytope is not None and not problem.corners
    if wanted is None:
        shares = [step * back_off for step in STEPS]
    else:  # on a polytope the fit of the controller costs some of the bound
        shares = [part * (wanted / best.gamma - 1 - SLACK) for part in (ROOMS if moving else ROOMS[:1])]
    shares = list(dict.fromkeys(max(s, 0.0) for s in shares))
    for share, later in itertools.zip_longest(shares, shares[1:]):
        if rapid is not None and (share > SOLVED or stopped()):
            break
        gamma = target * (1 + share)
        for formula in _formulas(problem, projected, best, gamma, moderated):
            missed = _missed(problem, formula) if rapid is None else problem.extra[:0]
            if len(missed):
                return missed, best, moderated.bounds
            # a polynomial that misses this bound may keep that of the next step, by a formula with less room
            most = (None if not moving else wanted if wanted is not None else
                    None if later is None else target * (1 + later))
            try:
                found = _written(problem, formula, most)
            except KeyboardInterrupt as error:  # what there is must be verified before it is returned
                stop_at(error)
                found = _written(problem, formula, most)
            if found is None:
                continue
            found = _slower(problem, formula, found, wanted, 1 + (back_off if rapid is None else share))
            verified = found.gamma_verified or np.inf
            kept = wanted is not None or verified <= (1 + SOLVED) * target
            found = replace(found, verdict="solved" if kept else "backed-off", infimum=min(best.gamma, verified),
                            solver=best.solver, method=problem.method, notes=(*note, *found.notes),
                            why=kept_near(verified, min(target, verified)))
            if moving and wanted is not None and verified > wanted:
                over = found if over is None or verified < (over.gamma_verified or np.inf) else over
                break
            too_fast = kept and wanted is None and _rapid(problem, formula, found)
            if rapid is None and not too_fast:
                return found
            if rapid is None:
                rapid = remember(found)
            elif not too_fast and _as_good(found, rapid, back_off):
                return found
            break
    if rapid is not None:
        return rapid
    if over is not None:
        return replace(over, verdict="backed-off", why=f"{over.why}; {wanted:.6g} was asked for",
                       mend="ask for more, or raise points")
    verdict, why, mend = obstacle(problem.plant.plant, projected, on_hull=problem.polytope is not None)
    if verdict == "infeasible" or best.status == ROOMY:  # the bound was that of an answer which keeps no inequality
        return Synthesis(verdict, why=why, mend=mend, method=problem.method)
    return Synthesis("numerical", why=f"the inequalities admit {best.gamma:.6g}, but no controller was found whose "
                     "closed loop keeps a bound near it", infimum=best.gamma, method=problem.method,
                     mend="raise back_off or points, or scale the signals to similar size")


def _least(
    projected: ProjectedInequalities, solvers: tuple[str, ...], known: MatrixPair | None = None
) -> MatrixPair | None:
    """The pair of least bound; for a plant that does not move, by the Riccati equations too where that is lower."""
    best = least_bound(projected, solvers=solvers, known=known, hopeless=lambda: hopeless(projected))
    if len(projected.plant.A) > 1 or projected.strictly_proper:
        return best
    judged = least_gain(projected.plant)
    if not 0 < judged < (np.inf if best is None else (1 - MISSED) * best.gamma):
        return best
    found = central(projected.plant, ROOM * judged)
    return best if found is None else MatrixPair(found.x[None], found.y[None], judged, "Riccati equations", RICCATI)


def _stirred(problem: FeedbackProblem, projected: ProjectedInequalities, best: MatrixPair | None
             ) -> tuple[ProjectedInequalities, MatrixPair | None]:
    """The inequalities of a plant with a disturbance at the controls, or a weight on the measurements, where those of
    the plant itself have no answer: those of the lowest bound, with it."""
    found = projected, best
    for size in STIRRED:
        for by_controls in (True, False):
            other = replace(projected, plant=stirred(projected.plant, size, by_controls=by_controls))
            try:
                pair = least_bound(other, solvers=problem.solvers[:1])
            except KeyboardInterrupt as error:
                if found[1] is None:
                    raise
                stop_at(error)
                return found
            least = np.inf if found[1] is None or found[1].status == ROOMY else found[1].gamma
            if pair is not None and pair.status != ROOMY and pair.gamma < (1 - MISSED) * least:
                found = other, pair
    return found


def _target(problem: FeedbackProblem, projected: ProjectedInequalities, best: MatrixPair
            ) -> tuple[float, tuple[str, ...]]:
    """The bound that is requested, and a remark where that is not the least."""
    if best.gamma > NOTHING * _size(projected.plant):
        return best.gamma, ()
    try:
        noisy = least_bound(replace(projected, plant=restrained(projected.plant, NOISE[-1])), solvers=problem.solvers)
    except KeyboardInterrupt as error:
        stop_at(error)
        noisy = None
    if noisy is None or noisy.gamma <= best.gamma:
        return max(best.gamma, 1e-300), ()
    return noisy.gamma, (f"the least bound is zero to a solver's accuracy; {noisy.gamma:.3g} is what moderate gains "
                         f"reach (noise and effort of {NOISE[-1]:g} in balanced units)",)


def moderate(problem: FeedbackProblem, bound: float) -> tuple[LPVStateSpace, ControllerFormula] | None:
    """The first controller, most moderate first, that keeps a bound which is known to be admitted; None for none.

    Parameters
    ----------
    problem : FeedbackProblem
        Plant, grid and what may vary.
    bound : float
        Gain w → z to keep.

    Returns
    -------
    LPVStateSpace
        The controller as written down.
    ControllerFormula
        What it was made of.
    """
    projected = problem.projected
    best = _least(projected, problem.solvers)
    if best is None or best.gamma * (1 + SLACK) > bound:
        return None
    moderated = Moderated(projected, best, problem.solvers[:1])
    for formula in _formulas(problem, projected, best, bound / (1 + SLACK) ** 2, moderated):
        try:
            kept = _kept(problem, formula)
        except np.linalg.LinAlgError:
            continue
        if kept is not None and kept[1] <= bound:
            return kept[0], formula
    return None


def _formulas(problem: FeedbackProblem, projected: ProjectedInequalities, best: MatrixPair, gamma: float,
              moderated: Moderated) -> Iterator[ControllerFormula]:
    """Controllers at a bound, the most moderate first: with noise and effort where the plant has none, if they fit."""
    for noisy, least in moderated.fitting(gamma):
        yield from _gentle(problem, noisy, least, gamma)
    yield from _gentle(problem, projected, best, gamma)
    found = central(projected.plant, gamma) if len(projected.plant.A) == 1 else None
    for pair in itertools.chain(roomy(projected, best, gamma, solvers=problem.solvers),
                                [] if found is None else [MatrixPair(found.x[None], found.y[None], gamma)]):
        formula = ControllerFormula.gentle(problem.plant, problem.variations, pair, gamma * (1 + SLACK), problem.points)
        if formula is not None:
            yield formula


def _gentle(problem: FeedbackProblem, projected: ProjectedInequalities, pair: MatrixPair, gamma: float
            ) -> Iterator[ControllerFormula]:
    """Controllers at a bound, each better conditioned than the last."""
    for found in conditioned(projected, pair, gamma, solvers=problem.solvers):
        formula = ControllerFormula.gentle(problem.plant, problem.variations, found, gamma * (1 + SLACK),
                                           problem.points)
        if formula is not None:
            yield formula


def _as_good(found: Synthesis, first: Synthesis, back_off: float) -> bool:
    """Whether a controller may take the place of the first: proven as well, its verified gain within the back-off."""
    return (found.verdict == "solved" and (found.certificate is not None or first.certificate is None)
            and (found.gamma_verified or np.inf) <= (1 + back_off) * (first.gamma_verified or 0.0))


def _rapid(problem: FeedbackProblem, formula: ControllerFormula, found: Synthesis) -> bool:
    """Whether the controller has states that `_slower` would do without: a larger bound may admit one that has none."""
    if not _may_be_slower(problem):
        return False
    controller = found.controller
    assert controller is not None
    poles = np.linalg.eigvals(np.array([controller.frozen(p)[0] for p in problem.points]))
    return bool(0 < FAST * fastest_pole(formula, problem.points) < np.abs(poles).max(initial=0.0))


def _may_be_slower(problem: FeedbackProblem) -> bool:
    return (problem.plant.plant.sample_time is None and not problem.variations.moving and not problem.strictly_proper
            and not stopped())


def _slower(problem: FeedbackProblem, formula: ControllerFormula, found: Synthesis, wanted: float | None,
            factor: float) -> Synthesis:
    """The controller without its states that are faster than the plant, where neither the verified gain nor the one
    with the scheduling held is more than a factor above what they are with them."""
    if not _may_be_slower(problem):
        return found
    allowed, held = wanted or factor * (found.gamma_verified or np.inf), factor * (found.gamma_lower or np.inf)
    try:
        stage("without the fast states of the controller")
        slow = without_fast_states(formula, problem.points, allowed, min(allowed, held), problem.corners)
        small = None if slow is None else _written(problem, slow, allowed)
    except KeyboardInterrupt as error:
        stop_at(error)
        return found
    if slow is None or small is None or (small.gamma_verified or np.inf) > allowed or (small.gamma_lower or 0.0) > held:
        return found
    pole = fastest_pole(formula, problem.points) / (2 * np.pi)
    note = (f"{len(slow.split) - slow.slow} state(s) of the controller, over {FAST:g} times faster than the plant's "
            f"fastest pole, {pole:.3g} Hz, stand for their static gain: the verified gain was "
            f"{found.gamma_verified:.6g} with them, it is {small.gamma_verified:.6g}")
    return replace(small, notes=(small.notes[0], note, *found.notes[1:]))


def _written(problem: FeedbackProblem, formula: FeedbackLaw, target: float | None = None) -> Synthesis | None:
    """The controller with its closed loop, if that keeps the formula's bound, or a target, wherever it is looked at."""
    plant = problem.plant.plant
    stage(f"writing down and verifying a controller for {formula.gamma:.4g}")
    try:
        found = _kept(problem, formula, target)
    except np.linalg.LinAlgError:
        return None
    if found is None:
        return None
    controller, bound = found
    reached = frozen_gain(loop_at(plant, controller, problem.looked), discrete=plant.sample_time is not None)
    if not reached <= bound * (1 + 1e-6):
        return None
    loop = close_loop(plant, controller)
    poles = np.abs(np.linalg.eigvals(formula.at(problem.points)[0][0])).max(initial=0.0)
    fastest = f"{poles:.3g}" if plant.sample_time is not None else f"at {poles / (2 * np.pi):.3g} Hz"
    note = f"the fastest pole of the controller is {fastest}"
    coupling = _conditioning(formula, problem) if isinstance(formula, ControllerFormula) else ()
    certificate = _certificate(problem, formula, loop, bound)
    if certificate is None and problem.polytope is not None:
        return None
    proven = certificate is not None and certificate.between_grid
    if certificate is not None:  # what is quoted is what the certificate lets others check
        bound = max(bound, certificate.gamma)
    if problem.polytope is not None:
        controller, loop = problem.polytope.marked(controller), problem.polytope.marked(loop)
    return Synthesis("solved", gamma=max(formula.gamma, bound), gamma_verified=bound, gamma_lower=reached,
                     controller=controller, closed_loop=loop, certificate=certificate,
                     between_grid=problem.corners or proven, notes=(note, *coupling))


def _certificate(problem: FeedbackProblem, formula: FeedbackLaw, loop: LPVStateSpace, bound: float
                 ) -> GainCertificate | RatedGainCertificate | HullCertificate | None:
    """Of the scheduling set: the formula's own storage function, or for a polytope another that keeps as much."""
    if problem.polytope is None:
        return certificate_of(formula, loop, bound)
    if not problem.corners:
        basis = formula.variations.basis
        assert basis is not None
        return problem.polytope.moving_proof(loop, lambda p: formula.storage(p).blocks(), basis, bound,
                                             states=formula.storage(problem.points[:1]).mix)
    own = problem.polytope.proof(loop, formula.storage(problem.points[:1]).matrices()[0], bound)
    if own is not None:
        return own
    other = problem.polytope.searched(loop)
    return other if other is not None and other.gamma <= bound * (1 + LOST) else None


def _missed(problem: FeedbackProblem, formula: ControllerFormula) -> np.ndarray:
    """Where the formula loses its bound between the design points: a few of the worst, apart from each other.

    None where it loses it at a design point, by rounding: further points would not mend that.
    """
    target = formula.gamma * (1 + SLACK)
    if problem.corners or len(problem.extra) >= MORE or not bounds_at(formula, problem.points).max() <= target:
        return problem.extra[:0]
    box = problem.plant.plant.box
    points = problem.dense(4 * problem.segments[0])
    bounds = bounds_at(formula, points)
    scale, chosen = np.where(box.half_width > 0, box.half_width, 1.0), np.empty((0, len(box.names)))
    for k in np.argsort(-bounds, kind="stable"):
        if bounds[k] <= target or len(chosen) >= AT_ONCE:
            break
        if np.all(np.abs((chosen - points[k]) / scale).max(axis=1, initial=0.0) > APART):
            chosen = np.vstack([chosen, points[k]])
    return chosen


def _kept(problem: FeedbackProblem, formula: FeedbackLaw, target: float | None = None
          ) -> tuple[LPVStateSpace, float] | None:
    """The controller written down finely enough that the closed loop keeps the bound, and the bound it keeps."""
    target = target or formula.gamma * (1 + SLACK)
    if problem.polytope is not None and not problem.corners:
        return _polynomial(problem, problem.polytope, formula, target)
    if problem.corners:
        controller = (table(formula, problem.axes, True) if problem.polytope is None
                      else affine_controller(formula, problem.polytope))
        bound = float(bounds_at(formula, problem.points, controller).max())
        return (controller, bound) if bound <= target else None
    for segments in problem.segments:
        points = np.vstack([problem.points, problem.dense(4 * segments)])
        if not bounds_at(formula, points).max() <= target:
            return None
        controller = smooth(formula, segments, problem.linear)
        if not bounds_at(formula, problem.points, controller).max() <= target:  # before a hundred times as many
            continue
        bound = float(bounds_at(formula, points, controller).max())
        if bound <= target:
            return controller, bound
    return _adapted(problem, formula, target) if len(problem.free) == 1 else None


def _polynomial(problem: FeedbackProblem, polytope: Polytope, formula: FeedbackLaw, most: float
                ) -> tuple[LPVStateSpace, float] | None:
    """The polynomial controller of least degree whose loop keeps the formula's bound at points of a polytope; else the
    one of the lowest bound, up to a given one."""
    points = np.vstack([problem.points, problem.dense(4 * problem.segments[0])])
    if not bounds_at(formula, points).max() <= formula.gamma * (1 + SLACK):
        return None
    best: tuple[LPVStateSpace, float] | None = None
    for degree in range(1, MOST_DEGREE.get(len(polytope.box.names), 3) + 1):
        controller = polynomial(formula, degree, points)
        bound = float(bounds_at(formula, points, controller).max())
        if bound <= min(most, np.inf if best is None else best[1]):
            best = controller, bound
        if bound <= formula.gamma * (1 + SLACK):
            break
    return best


def _adapted(problem: FeedbackProblem, formula: FeedbackLaw, target: float) -> tuple[LPVStateSpace, float] | None:
    """A table of the controller over the one free variable, halved wherever the loop loses the bound.

    For plants that are tables themselves, whose slope jumps, and for controllers that change fast at an end of the box.
    """
    plant = problem.plant.plant
    axes, moving = list(convex_axes(plant)), plant.box.names.index(problem.free[0])
    low, high = plant.box.lower[moving], plant.box.upper[moving]
    axes[moving] = np.union1d(axes[moving], np.linspace(low, high, SEGMENTS[1][0] + 1))
    for _ in range(HALVED):
        axis = axes[moving]
        shares = np.linspace(0, 1, 5)[:-1]
        axes[moving] = np.append((axis[:-1, None] + np.diff(axis)[:, None] * shares).ravel(), axis[-1])
        points, axes[moving] = np.vstack([problem.points, tensor(tuple(axes))]), axis
        controller = table(formula, tuple(axes), False)
        bounds = bounds_at(formula, points, controller)
        if bounds.max() <= target:
            return controller, float(bounds.max())
        if not bounds_at(formula, points).max() <= target:
            return None
        lost = np.searchsorted(axis, points[~(bounds <= target), moving], side="right") - 1
        cells = np.unique(np.clip(np.concatenate([lost, lost - 1]), 0, len(axis) - 2))
        axes[moving] = np.union1d(axis, 0.5 * (axis[cells] + axis[cells + 1]))
    return None


def _conditioning(formula: ControllerFormula, problem: FeedbackProblem) -> tuple[str, ...]:
    x, y = problem.variations.at(problem.points, 1.0)
    product = np.linalg.eigvals(x.at(formula.pair.x) @ y.at(formula.pair.y)).real
    return (f"eigenvalues of XY between {product.min():.3g} and {product.max():.3g} (1 is the limit of the coupling)",)


def _size(plant: PlantMatrices) -> float:
    """Order of magnitude of the plant's gain from w to z, in balanced units."""
    return float((np.linalg.norm(plant.B1, 2, axis=(1, 2)) * np.linalg.norm(plant.C1, 2, axis=(1, 2))
                  + np.linalg.norm(plant.D11, 2, axis=(1, 2))).max())
