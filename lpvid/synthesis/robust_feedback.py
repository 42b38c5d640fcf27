"""RobustFeedback: a controller for an uncertain LPV plant, by turns of analysis and synthesis (D-K iteration)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

from lpvid import _checks
from lpvid.analysis.robust_gain import RobustGain, robust_gain
from lpvid.analysis.uncertain_blocks import Block, Dynamic, Lipschitz, Parametric, bank
from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.attach_weights import weigh
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.output_feedback import OutputFeedback
from lpvid.synthesis.progress import stage
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.sub_plant import channels_of

SETTLED = 0.01
"""share by which a turn must lower the certified bound for another one: the back-off of the synthesis in between"""
SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625)
"""of the uncertainty, the largest first, at which a loop is looked at until one is certified"""
STRICT = 1e-8
"""share of its trace that makes a multiplier strictly positive, so that it has a stable factor with stable inverse"""


@dataclass(frozen=True, eq=False)
class RobustDesign:
    """A controller with the verified figures of its loop for every uncertainty of the given kinds.

    Parameters
    ----------
    controller : LPVStateSpace or None
        From the plant's measurements to its controls.
    closed_loop : LPVStateSpace or None
        With the channels of the uncertainty open, as `lpv.robust_gain` takes it.
    gain : RobustGain or None
        Of that loop, certified: what to quote.
    nominal : RobustGain or None
        The same for the controller designed without the uncertainty.
    turns : tuple of float
        Certified bound after each turn; infinite where there was none.
    why, mend : str
    seconds : float
    """

    controller: LPVStateSpace | None
    closed_loop: LPVStateSpace | None
    gain: RobustGain | None
    nominal: RobustGain | None
    turns: tuple[float, ...] = ()
    why: str = ""
    mend: str = ""
    seconds: float = 0.0

    @property
    def solved(self) -> bool:
        """There is a controller with a certified bound."""
        return self.controller is not None

    def __repr__(self) -> str:
        if self.gain is None:
            return f"not certified: {self.why}\n  mend: {self.mend}"
        before = "none could be certified" if self.nominal is None or not np.isfinite(self.nominal.upper) else \
            f"at most {self.nominal.upper:.6g}"
        return (f"robust controller, {len(self.turns)} turns\n{self.gain!r}\n"
                f"  designed without the uncertainty: {before}")


@dataclass(frozen=True, eq=False)
class RobustFeedback:
    """Output feedback with the least certified gain w → z for every p = Δ(q) of some norm-bounded blocks.

    ::

                     ┌─── Δ <──┐                      w̃_p ──>│ √(γ)/d │──> p
                   p │         │ q
                     └─>┌───┐──┘                        q ──>│ √γ b d │──> z̃_q
                   w ──>│ P │──> z
              ┌─── u ──>└───┘──> y ──┐
              └────────── K <────────┘

    Turn by turn (Doyle 1985; Packard & Doyle, Automatica 29 (1993) 71-109; for LPV systems with storage functions
    Pfifer & Seiler 2016): `lpv.robust_gain` bounds the gain γ of the loop and gives the multipliers |d|², over the
    filters of its `poles`; a stable d with stable inverse is their spectral factor; `design` then lowers the gain of
    the plant above, of which the last controller keeps γ. Every bound below γ is one of the uncertain loop, with the
    same multipliers. A loop that is certified for part of the uncertainty only is first made robust to more of it.
    Neither turn moves the other's unknowns, so that the result is a local optimum. What is reported is the bound of
    `lpv.robust_gain` for the loop with the controller as returned.

    Parameters
    ----------
    blocks : Block or sequence of Block
        `Parametric`, `Dynamic` or `Lipschitz`; their signals are disturbances and performance signals of the plant.
    design : OutputFeedback
        Of each turn, with its Lyapunov basis.
    turns : int
        At most.
    poles : sequence of float
        Of the multipliers' filters [1/s]; empty for constant multipliers.

    Examples
    --------
    >>> RobustFeedback(Dynamic("p", "q", 0.3), turns=2).turns
    2
    """

    blocks: Block | Sequence[Block]
    design: OutputFeedback = field(default_factory=OutputFeedback)
    turns: int = 4
    poles: Sequence[float] = ()

    def __post_init__(self) -> None:
        blocks = (self.blocks,) if isinstance(self.blocks, Block) else tuple(self.blocks)
        for block in blocks:
            if not isinstance(block, (Parametric, Dynamic, Lipschitz)):
                raise InputError("robust synthesis needs blocks that are bounded in norm", got=type(block).__name__,
                                 mend="Parametric, Dynamic or Lipschitz; a sector of slopes a to b is its middle slope "
                                      "in the plant and Lipschitz with half the difference")
        if not blocks:
            raise InputError("robust synthesis needs blocks of uncertainty", got="none")
        object.__setattr__(self, "blocks", blocks)
        poles = tuple(_checks.positive(p, "a pole of the filters", "1/s") for p in self.poles)
        object.__setattr__(self, "poles", poles)
        _checks.count(self.turns, "turns", at_least=1)

    def solve(self, plant: GeneralizedPlant) -> RobustDesign:
        """The controller of lowest certified gain.

        Parameters
        ----------
        plant : GeneralizedPlant
            With p among its disturbances and q among its performance signals.

        Returns
        -------
        RobustDesign

        Raises
        ------
        InputError
            Signals of a block that the plant does not have in that place; no signals left for the gain.
        """
        started = time.perf_counter()
        w, z = _others(plant, self.blocks)  # type: ignore[arg-type]
        bare = channels_of(plant, w, z)
        found = self.design.solve(bare)
        if found.controller is None:
            return RobustDesign(None, None, None, None, (), f"without uncertainty: {found.why}", found.mend,
                                time.perf_counter() - started)
        best: tuple[LPVStateSpace, LPVStateSpace, RobustGain] | None = None
        nominal: RobustGain | None = None
        bounds: list[float] = []
        for turn in range(self.turns + 1):
            controller = found.controller
            if controller is None:
                break
            stage(f"robust synthesis: analysis {turn + 1} of at most {self.turns + 1}")
            loop = close_loop(plant, controller)
            share, gain = self._analysed(loop)
            whole = self._certified(loop, gain if share == 1.0 else None)
            nominal = nominal or whole
            lowered = best is None or whole.upper < (1 - SETTLED) * best[2].upper
            bounds.append(whole.upper)
            if np.isfinite(whole.upper) and (best is None or whole.upper < best[2].upper):
                best = controller, loop, whole
            if gain is None or turn == self.turns or (best is not None and not lowered):
                break
            stage(f"robust synthesis: controller {turn + 2} of at most {self.turns + 1}")
            found = self._synthesised(plant, gain, min(1.0, 2 * share))
        seconds = time.perf_counter() - started
        if best is None:
            return RobustDesign(None, None, None, nominal, tuple(bounds), "no controller of any turn has a loop that "
                                "is certified for all of the uncertainty", "smaller bounds, further poles of the "
                                "multipliers, more turns, or a lower performance requirement", seconds)
        return RobustDesign(*best, nominal, tuple(bounds), seconds=seconds)

    def _analysed(self, loop: LPVStateSpace) -> tuple[float, RobustGain | None]:
        """The largest share of the uncertainty for which the loop is certified."""
        for share in SHARES:
            blocks = [replace(b, bound=share * b.bound) for b in self._commuting()]
            gain = robust_gain(loop, blocks, poles=self.poles or None)
            if gain.certificate is not None:
                return share, gain
        return 0.0, None

    def _certified(self, loop: LPVStateSpace, wider: RobustGain | None) -> RobustGain:
        """The bound for the blocks as they are given, or for the wider class of the turns where that is lower."""
        own = robust_gain(loop, tuple(self.blocks), poles=self.poles or None)  # type: ignore[arg-type]
        return wider if wider is not None and wider.upper < own.upper else own

    def _commuting(self) -> list[Dynamic | Lipschitz]:
        """The blocks as those whose multipliers are |d|² alone, constant where Δ may vary with time."""
        def plain(b: Block) -> Dynamic | Lipschitz:
            assert isinstance(b, (Parametric, Dynamic, Lipschitz))
            still = self.poles and (isinstance(b, Dynamic) or (isinstance(b, Parametric) and not b.moving))
            return (Dynamic if still else Lipschitz)(b.inputs, b.outputs, b.bound)

        return [plain(b) for b in self.blocks]  # type: ignore[union-attr]

    def _synthesised(self, plant: GeneralizedPlant, gain: RobustGain, share: float) -> Synthesis:
        """The controller for the plant with the multipliers of an analysis as weights."""
        assert gain.certificate is not None
        inputs, outputs = {}, {}
        root = float(np.sqrt(gain.certificate.gamma))
        for block, parts in zip(self._commuting(), gain.certificate.multipliers, strict=True):
            ahead, back = _factor(parts[0], self.poles if isinstance(block, Dynamic) else (),
                                  plant.sample_time)
            inputs |= {n: _times(back, root) for n in block.inputs}
            outputs |= {n: _times(ahead, root * share * block.bound) for n in block.outputs}
        return self.design.solve(weigh(plant, inputs, outputs))


def _others(plant: GeneralizedPlant, blocks: Sequence[Block]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Disturbances and performance signals that belong to no block."""
    p, q = ({n for b in blocks for n in getattr(b, of)} for of in ("inputs", "outputs"))
    for names, own, what in ((p, plant.disturbances, "disturbance"), (q, plant.performance, "performance signal")):
        for n in sorted(names):
            _checks.known_name(n, own, what)
        if not set(own) - names:
            raise InputError(f"no {what} is left for a gain", got=", ".join(own))
    return (tuple(n for n in plant.disturbances if n not in p), tuple(n for n in plant.performance if n not in q))


def _factor(multiplier: np.ndarray, poles: Sequence[float], sample_time: float | None
            ) -> tuple[LPVStateSpace | float, LPVStateSpace | float]:
    """A stable d with |d|² = H*SH over the bank of filters, and its stable inverse (Youla 1961)."""
    s = multiplier + STRICT * np.trace(multiplier) * np.eye(len(multiplier))
    if len(s) == 1 or not poles:
        root = float(np.sqrt(s[0, 0]))
        return root, 1 / root
    a, b, c, d = bank(poles, sample_time)
    cost, cross, effort = c.T @ s @ c, c.T @ s @ d, d.T @ s @ d
    if sample_time is None:
        x = solve_continuous_are(a, b, cost, effort, s=cross)
        gain, size = np.linalg.solve(effort, b.T @ x + cross.T), effort
    else:
        x = solve_discrete_are(a, b, cost, effort, s=cross)
        size = effort + b.T @ x @ b
        gain = np.linalg.solve(size, b.T @ x @ a + cross.T)
    root = float(np.sqrt(size[0, 0]))
    one = np.ones((1, 1))
    return (LPVStateSpace.still(a, b, root * gain, root * one, sample_time),
            LPVStateSpace.still(a - b @ gain, b / root, -gain, one / root, sample_time))


def _times(system: LPVStateSpace | float, factor: float) -> LPVStateSpace | float:
    if not isinstance(system, LPVStateSpace):
        return factor * system
    return system.replace(C=factor * system.C, D=factor * system.D)
