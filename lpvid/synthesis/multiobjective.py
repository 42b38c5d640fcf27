"""Output feedback with several objectives and pole regions under one Lyapunov matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.lmi.affine import Affine, block, combined
from lpvid.lmi.program import Program
from lpvid.model.hull import Hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial
from lpvid.synthesis.assumptions import fault_of
from lpvid.synthesis.criteria import H2, CovarianceCriterion, Criterion, HInfinity, Region
from lpvid.synthesis.design_grid import check_rates, columns, design_axes, is_affine, moving_basis, tensor, varies
from lpvid.synthesis.figures import Figure
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.loop_check import LoopStorage
from lpvid.synthesis.matrix_function import MatrixFunction
from lpvid.synthesis.matrix_function import block as function_block
from lpvid.synthesis.moderated import SLACK
from lpvid.synthesis.moving_feedback import moving_feedback
from lpvid.synthesis.moving_objectives import moving_objectives
from lpvid.synthesis.plant_functions import assembled, named, plant_functions
from lpvid.synthesis.polytope import Polytope, refuse_beside_hull
from lpvid.synthesis.preconditioning import Preconditioned, balancing, preconditioned, unconditioned
from lpvid.synthesis.projected_feedback import constant_feedback
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.shaped_design import ShapedProblem, check_criteria, listed, settle
from lpvid.synthesis.shaped_loop import ShapedLoop
from lpvid.synthesis.shaped_program import APART, Shaped, Shaping, SignalCoordinates
from lpvid.synthesis.sub_plant import channels_of
from lpvid.synthesis.variance_feedback import VarianceFeedback, regulated_plant, suits

VARYING = ("both", "controls", "measurements")


@dataclass(frozen=True, eq=False)
class MultiObjective:
    """Full-order controller x_K⁺ = A_K x_K + B_K y, u = C_K x_K + D_K y for mixed H2/H-infinity and pole regions.

    Scherer, Gahinet & Chilali 1997, with 𝐗 = [X, I; I, Y], 𝐀 = [AX + B2Ĉ, A + B2D̂C2; Â, YA + B̂C2],
    𝐁 = [B1 + B2D̂D21; YB1 + B̂D21], 𝐂 = [C1X + D12Ĉ, C1 + D12D̂C2], 𝐃 = D11 + D12D̂D21: all criteria share X and Y.
    Constant, they let the scheduling move arbitrarily fast; with `lyapunov` one of them moves, within the rate bounds
    of the plant's box (`moving_objectives`, `moving_feedback`). One H-infinity bound alone is `OutputFeedback`.

    Parameters
    ----------
    criteria : HInfinity, H2, GeneralizedH2 or a sequence of them
        Those without a bound of their own are minimised (their weighted sum).
    regions : Region or sequence of Region
        Where the frozen poles of the closed loop must lie.
    feedthrough : bool
        Allow D_K. An H2 criterion in continuous time forbids it.
    points : int
        Grid points per scheduling variable, where corners are not enough.
    back_off : float
        Factor above the lowest level at which the controller is then made well conditioned.
    lyapunov : Basis, optional
        Functions of the matrix that moves; in continuous time their variables need rate bounds.
    varying : {"both", "controls", "measurements"}
        Which matrix moves, X or Y. With "both" in continuous time the controller reads the rates too, as further
        scheduling variables ``<name>_rate``. In discrete time "both" designs with a slack matrix of either side, and
        keeps the lower figures; an H2 criterion there needs "controls".
    hull : Hull, optional
        A polytope in which the scheduling stays, in place of its box, as for `OutputFeedback`.

    Examples
    --------
    >>> from lpvid.synthesis.criteria import HalfPlane
    >>> MultiObjective([HInfinity("road", "grip", bound=1.2), H2("road", "comfort")], regions=HalfPlane(1.0)).regions
    (HalfPlane(decay=1.0),)
    """

    criteria: Criterion | Sequence[Criterion] = (HInfinity(),)
    regions: Region | Sequence[Region] = ()
    feedthrough: bool = True
    points: int = 7
    back_off: float = 1.02
    lyapunov: Basis | None = None
    varying: str = "controls"
    hull: Hull | None = None

    def __post_init__(self) -> None:
        _checks.one_of(self.varying, VARYING, "varying")
        object.__setattr__(self, "criteria", listed(self.criteria, Criterion, "the criteria"))
        object.__setattr__(self, "regions", listed(self.regions, Region, "the regions"))
        object.__setattr__(self, "lyapunov", moving_basis(self.lyapunov))
        if self.regions and self.lyapunov is not None:
            raise InputError("pole regions need constant Lyapunov matrices", got="lyapunov and regions",
                             mend="leave one of the two out")
        refuse_beside_hull(self.hull, self.lyapunov, "one gain alone may have both (OutputFeedback)")
        if not _checks.real(self.back_off, "back_off") >= 1:
            raise InputError("back_off must be at least 1", got=self.back_off, why="it multiplies the least gain",
                             mend="1.02 stops 2 % above it")

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The controller for a plant, with the figures of its closed loop.

        Parameters
        ----------
        plant : GeneralizedPlant
            Continuous or discrete.

        Returns
        -------
        Synthesis
            Of several inequalities and coordinates the first that is solved or refuted, else the lowest figures.
        """
        criteria, regions = tuple(self.criteria), tuple(self.regions)  # type: ignore[arg-type]
        first: list[Synthesis] = []
        if (len(criteria) == 1 and isinstance(criteria[0], HInfinity) and not regions and self.feedthrough
                and self.lyapunov is None):
            other = _by_output_feedback(plant, criteria[0], self.back_off - 1, self.points, self.hull)
            if other is not None and (other.controller is None or other.certificate is not None or plant.box.names):
                return other
            first += [] if other is None else [other]
        return self.by_change_of_variables(plant, first)

    def by_change_of_variables(self, plant: GeneralizedPlant, first: Sequence[Synthesis] = ()) -> Synthesis:
        """As `solve`, without the projected inequalities for a single bound of the gain.

        Parameters
        ----------
        plant : GeneralizedPlant
            Continuous or discrete.
        first : sequence of Synthesis
            Of the same design, by other inequalities.

        Returns
        -------
        Synthesis
        """
        criteria, regions = tuple(self.criteria), tuple(self.regions)  # type: ignore[arg-type]
        found = list(first)
        polytope = None if self.hull is None else Polytope.full_order(self.hull, plant)
        axes = design_axes(plant.box, self.points, polytope is not None
                           or (is_affine(plant.system.basis) and _steady(plant)))
        points = tensor(axes) if polytope is None else polytope.vertices
        check_criteria(plant, criteria, regions, points)
        fault = fault_of(plant, plant.at(points), points, between=polytope is None)
        variance = any(isinstance(c, CovarianceCriterion) for c in criteria)
        direct = self.feedthrough and (plant.sample_time is not None or not variance)
        if fault is not None:
            return settle(self._stated(plant, criteria, regions, points, direct, unconditioned(plant)), fault)
        if self.lyapunov is not None:
            return self._moving(plant, criteria, direct)
        for attempt in self._attempts(plant, criteria, regions, points, direct):
            found.append(attempt())
            if found[-1].verdict in ("solved", "infeasible"):
                return found[-1]
        return _lowest(found)

    def _attempts(self, plant: GeneralizedPlant, criteria: tuple[Criterion, ...], regions: tuple[Region, ...],
                  points: np.ndarray, direct: bool) -> Iterator[Callable[[], Synthesis]]:
        """The same design by several inequalities and in several coordinates, those first that are solved best."""
        variance = any(isinstance(c, CovarianceCriterion) for c in criteria)
        if len(criteria) == 1 and not regions and isinstance(criteria[0], H2) and suits(plant, criteria[0], points):
            yield lambda: self._by_variance(plant, criteria, points)
        for of in (unconditioned, partial(regulated_plant, points=points) if variance else None,
                   partial(preconditioned, points=points)):
            if of is not None:
                yield lambda of=of: settle(self._stated(plant, criteria, regions, points, direct, of(plant)))

    def _moving(self, plant: GeneralizedPlant, criteria: tuple[Criterion, ...], direct: bool) -> Synthesis:
        """The lowest figures of what may move, and of a constant X and Y."""
        assert self.lyapunov is not None
        check_rates(self.lyapunov, plant.box, plant.sample_time)
        basis, axes = self.lyapunov.bound(plant.box), design_axes(plant.box, self.points, False)
        if plant.sample_time is None:
            found = [moving_objectives(plant, criteria, basis, axes, varying=self.varying, direct=direct,
                                       back_off=self.back_off)]
        else:
            found = [moving_feedback(plant, basis, axes, turned=turned, strictly_proper=not direct, criteria=criteria,
                                     back_off=self.back_off - 1)
                     for turned in {"controls": (False,), "measurements": (True,)}.get(self.varying, (False, True))
                     if not turned or not any(isinstance(c, CovarianceCriterion) for c in criteria)]
        if not found:
            raise InputError("in discrete time an H2 criterion needs the X of the controls to move", got=self.varying,
                             mend="varying=\"controls\"")
        return _lowest([*found, replace(self, lyapunov=None).solve(plant)])

    def _by_variance(self, plant: GeneralizedPlant, criteria: tuple[Criterion, ...], points: np.ndarray
                     ) -> Synthesis:
        """One H2 criterion, without the controller's own dynamics among the unknowns."""
        assert isinstance(criteria[0], H2)
        search = VarianceFeedback(plant, criteria[0], points)
        plain = self._stated(plant, criteria, (), points, False, unconditioned(plant))
        return settle(plain, answers=lambda share: (
            (self._stated(plant, criteria, (), points, False, ready), shaped)
            for ready, shaped in search.answers(share)))

    def _stated(self, plant: GeneralizedPlant, criteria: tuple[Criterion, ...], regions: tuple[Region, ...],
                points: np.ndarray, direct: bool, ready: Preconditioned) -> _MultiobjectiveProblem:
        raw = ready.plant.at(points)
        coordinates = SignalCoordinates.of(raw, plant.sample_time is not None, ready.balanced)
        polytope = None if self.hull is None else Polytope.of(self.hull, plant.box)
        return _MultiobjectiveProblem(plant, criteria, regions, self.back_off, points, direct, ready, coordinates,
                                      coordinates.scaled(raw), polytope=polytope)


@dataclass(frozen=True, eq=False)
class _MultiobjectiveProblem(ShapedProblem):
    """One plant with several objectives, in scaled coordinates of a preconditioned plant."""

    points: np.ndarray
    direct: bool
    ready: Preconditioned
    coordinates: SignalCoordinates
    matrices: PlantMatrices

    @property
    def method(self) -> str:
        over = "" if self.polytope is None else f" on {self.polytope.text}"
        return f"output feedback, {len(self.criteria)} criteria and {len(self.regions)} regions under one X and Y{over}"

    @property
    def remedy(self) -> str:
        return (f"raise the bounds or widen the regions, lower the weights on {', '.join(self.plant.performance)}, or "
                "measure more")

    @property
    def basis(self) -> Basis:
        """Functions of the hatted unknowns."""
        return self.plant.system.basis

    @property
    def storage(self) -> Basis | None:
        return Polynomial((), 0)

    def storage_of(self, shaped: Shaped) -> None:
        return None

    def build(self, program: Program, scale: float) -> Shaping:
        n, nu, ny = self.plant.order, len(self.plant.controls), len(self.plant.measurements)
        new = program.unknowns
        x, y = new.symmetric(n), new.symmetric(n)
        hats = [[new.matrix(*shape) for _ in range(self.basis.size)] for shape in ((n, n), (n, ny), (nu, n))]
        through = [new.matrix(nu, ny) if self.direct else _zero(nu, ny) for _ in range(self.basis.size)]
        phi = columns(self.plant.box, self.basis, self.points)
        s = np.sqrt(self.ready.sizes)  # X = diag(s) x diag(s), and Y alike: unknowns near the identity
        coupling = np.diag(1 / self.ready.sizes)
        lyapunov, loops, below = block([[x, coupling], [coupling, y]]), [], []
        for k in range(len(phi)):
            m = self.matrices.point(k)
            first, second = _over_states(m, s), _over_states(m, 1 / s)
            ah, bh, ch, dh = (combined(h, phi[k]) for h in (*hats, through))
            dynamics = block([[first.A @ x + first.B2 @ ch, m.A / s / s[:, None] + first.B2 @ dh @ second.C2],
                              [ah, y @ second.A + bh @ second.C2]])
            loops.append(ShapedLoop(lyapunov, None, dynamics,
                                    block([[first.B1 + first.B2 @ dh @ m.D21], [y @ second.B1 + bh @ m.D21]]),
                                    block([[first.C1 @ x + m.D12 @ ch, second.C1 + m.D12 @ dh @ second.C2]]),
                                    m.D11 + m.D12 @ dh @ m.D21, self.plant.sample_time is not None,
                                    self.coordinates.pace))
            below += [ah, bh, ch, dh] if self.direct else [ah, bh, ch]
        size, room = _apart(program, x, y, coupling, below)
        return Shaping(tuple(loops), size, {"X": (x,), "Y": (y,), "A": tuple(hats[0]), "B": tuple(hats[1]),
                                            "C": tuple(hats[2]), "D": tuple(through)}, room)

    def controller(self, shaped: Shaped) -> LPVStateSpace:
        turn, sizes = self._balanced(shaped)
        s, back = np.sqrt(self.ready.sizes), np.linalg.inv(turn)
        hat = {name: MatrixFunction(self.basis, shaped.values(name)) for name in "ABCD"}
        plant = _scaled(self.ready.plant, self.coordinates, turn)
        far = sizes**2 - 1
        if far.min(initial=1.0) <= 1e-10:
            raise np.linalg.LinAlgError("I − XY is singular")
        m, d, x = np.diag(np.sqrt(far)), hat["D"], np.diag(sizes)  # M = m and N = −m, as X = Y = diag(sizes)
        right, left = np.diag(1 / np.sqrt(far)), -np.diag(1 / np.sqrt(far))
        into, out = s[:, None] * back.T, turn.T * s
        c = (hat["C"] @ into - d @ plant["C2"] @ x) @ right
        b = left @ (out @ hat["B"] - x @ plant["B2"] @ d)
        a = left @ (out @ hat["A"] @ into - x @ plant["A"] @ x - x @ plant["B2"] @ d @ plant["C2"] @ x
                    + m @ (b @ plant["C2"] @ x) - x @ plant["B2"] @ c @ m) @ right
        a, b, c, d = _without_through(a, b, c, d, plant["D22"])
        scale, seen = self.coordinates.controls, self.coordinates.measurements
        unseen = np.diag(1 / seen)
        whole = function_block([[a, b @ unseen], [np.diag(scale) @ c, np.diag(scale) @ d @ unseen]])
        return assembled(whole, len(sizes), self.plant, named(self.plant, self.plant.measurements),
                         named(self.plant, self.plant.controls))

    def _balanced(self, shaped: Shaped) -> tuple[np.ndarray, np.ndarray]:
        """T, over the preconditioned states, in which X = Y = diag(σ), and σ."""
        s = np.sqrt(self.ready.sizes)
        scaled = self.coordinates.states
        x, y = (s[:, None] * shaped.values(name)[0] * s for name in "XY")
        turn, sizes = balancing(x, y)
        return scaled[:, None] * turn, sizes

    def blocks_of(self, shaped: Shaped) -> LoopStorage:
        """V = Σ x²/σ + σ (x_K − √(σ² − 1)/σ·x)² in the coordinates in which X = Y = diag(σ)."""
        turn, sizes = self._balanced(shaped)
        n = len(sizes)
        follow = np.diag(np.sqrt(np.maximum(sizes**2 - 1, 0.0)) / sizes)
        mix = np.block([[self.ready.turn @ turn, np.zeros((n, n))], [follow, np.eye(n)]])
        first, second = np.diag(1 / sizes)[None], np.diag(sizes)[None]
        return LoopStorage(first, second, 0 * first[:, None], 0 * second[:, None], mix)

    def close(self, controller: LPVStateSpace) -> LPVStateSpace:
        return close_loop(self.plant, controller)


def _lowest(found: Sequence[Synthesis]) -> Synthesis:
    """Of the same design in several coordinates the one of lowest verified figures; else a proof that there is none."""
    kept = [s for s in found if s.controller is not None]
    if kept:
        return min(kept, key=lambda s: sum(f["verified"] / max(min(o.figures[i]["verified"] for o in kept), 1e-300)
                                           for i, f in enumerate(s.figures)))
    return next((s for s in found if s.verdict == "infeasible"), found[0])


def _by_output_feedback(plant: GeneralizedPlant, criterion: HInfinity, back_off: float, points: int,
                        hull: Hull | None) -> Synthesis | None:
    """One bound of a gain alone is what the projected inequalities decide with fewer unknowns; None where they fail."""
    check_criteria(plant, (criterion,), (), plant.box.grid(2))
    part = channels_of(plant, criterion.disturbances or plant.disturbances, criterion.performance or plant.performance)
    share = min(max(back_off - 2 * SLACK, 0.0), 1.0)
    found = constant_feedback(part, criterion.bound, share, points, hull)
    if found.verdict in ("infeasible", "unstabilisable", "undetectable"):
        return found
    if found.verdict != "solved" or found.gamma_verified is None:
        return None
    figure = Figure(
        "H-infinity",
        criterion.description(plant),
        found.gamma or found.gamma_verified,
        found.gamma_verified,
        found.gamma_lower,
        found.between_grid,
        found.certificate,
        found.region,
    )
    return replace(found, notes=(str(figure), *found.notes), figures=(figure.to_dict(),))


def _apart(program: Program, x: Affine, y: Affine, coupling: np.ndarray, below: Sequence[Affine]
           ) -> tuple[Affine, Affine]:
    """(1, 1) t, which bounds the norms of the matrices, and s − 1 of the coupling [X, sI; sI, Y] ⪰ 0.

    Where X = Y = diag(σ), A_K = (Σ² − I)^-½ E (Σ² − I)^-½ with E made of these matrices, and σ ≥ s: its size, the speed
    of the controller, is at most ‖E‖/(s² − 1). So the least t/(s − 1) is looked for, which no unit or weight enters.
    """
    n, t, s = x.shape[0], program.unknowns.scalar(), program.unknowns.scalar()
    program.require(block([[x, s.times(coupling)], [s.times(coupling), y]]))
    program.require(APART - s)
    for matrix in (x, y):
        program.require(t.times(np.eye(n)) - matrix)
    for matrix in below:
        rows, width = matrix.shape
        program.require(block([[t.times(np.eye(rows)), matrix], [matrix.T, t.times(np.eye(width))]]))
    return t, s - 1.0


def _zero(rows: int, width: int) -> Affine:
    from scipy import sparse

    return Affine(np.zeros((rows, width)), sparse.csr_array((rows * width, 0)))


def _over_states(m: PlantMatrices, s: np.ndarray) -> PlantMatrices:
    """A plant over x' = x / s."""
    return replace(m, A=m.A * s / s[:, None], B1=m.B1 / s[:, None], B2=m.B2 / s[:, None], C1=m.C1 * s, C2=m.C2 * s)


def _scaled(plant: GeneralizedPlant, c: SignalCoordinates, turn: np.ndarray) -> dict[str, MatrixFunction]:
    """What the recovery needs of a plant, over states x' = `turn`⁻¹x and with scaled controls and measurements."""
    blocks, x, u, y = plant_functions(plant), turn, *map(np.diag, (c.controls, c.measurements))
    into = {"A": (np.linalg.inv(x), x), "B2": (np.linalg.inv(x), u), "C2": (np.linalg.inv(y), x),
            "D22": (np.linalg.inv(y), u)}
    return {name: left @ blocks[name] @ right for name, (left, right) in into.items()}


def _without_through(a: MatrixFunction, b: MatrixFunction, c: MatrixFunction, d: MatrixFunction, d22: MatrixFunction
                     ) -> tuple[MatrixFunction, MatrixFunction, MatrixFunction, MatrixFunction]:
    """The controller that reads y where the design's read y − D22 u."""
    if not d22.coefficients.any():
        return a, b, c, d
    around = d @ d22 + np.eye(d.shape[0])
    still = around.still
    if still is None:
        raise InputError("feedthroughs of plant and controller that both vary form a loop",
                         mend="design with feedthrough=False, or delay the control in the measurement")
    back = np.linalg.inv(still)
    c, d = back @ c, back @ d
    return a - b @ d22 @ c, b - b @ d22 @ d, c, d


def _steady(plant: GeneralizedPlant) -> bool:
    """What multiplies an unknown that varies must not vary itself, for corners to be enough."""
    m = plant.at(plant.box.grid(2))
    return not any(varies(part) for part in (m.B2, m.D12, m.C2, m.D21))
