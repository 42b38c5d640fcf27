"""Loop shaping: weights give the loop its shape, one more design makes it robust (McFarlane & Glover), over the box."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.attach_weights import Weight, _named
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import connect
from lpvid.synthesis.joining import gain
from lpvid.synthesis.output_feedback import OutputFeedback
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.synthesizing import Design, synthesize

GENEROUS = 0.25
"""margin above which the shape is kept about as drawn (McFarlane & Glover 1992: below it, draw another)"""


@dataclass(frozen=True, eq=False)
class ShapedDesign:
    """A controller W_pre K W_post with the perturbation that its loop withstands.

    Parameters
    ----------
    synthesis : Synthesis
        Of K for the shaped plant.
    controller : LPVStateSpace or None
        From the measurements to the controls of the plant, weights included.
    margin : float
        ε = 1/γ, verified: 0 where there is no controller. In the loop of K with the shaped plant every causal
        perturbation of gain below ε from (y, u) to disturbances on both keeps it stable; for a plant that does not vary
        that is a perturbation of its normalised coprime factors, or a distance ε in the gap metric.
    plant : GeneralizedPlant
        The shaped plant with disturbances ``….push`` and ``….noise``.
    """

    synthesis: Synthesis
    controller: LPVStateSpace | None
    margin: float
    plant: GeneralizedPlant

    def __repr__(self) -> str:
        if self.controller is None:
            return repr(self.synthesis)
        advice = "the shape is kept" if self.margin >= GENEROUS else "draw a flatter shape near crossover"
        return (f"robust to perturbations of gain {self.margin:.3g} on both sides of the shaped plant ({advice})\n"
                f"  controller of {self.controller.order} states, weights included\n{self.synthesis!r}")


def loop_shaping(system: LPVStateSpace, pre: Mapping[str, Weight] | None = None,
                 post: Mapping[str, Weight] | None = None, design: Design | None = None) -> ShapedDesign:
    """Robust stabilisation of W_post G W_pre: least γ = ‖[I; K](I − G_s K)⁻¹[I  G_s]‖ over the scheduling.

    ::

        u.push ──(+)──>[W_pre]──>[ G ]──>[W_post]──(+)──┬─> y.cost       controller = W_pre K W_post
                  ^                        y.noise ──^  │
             ┌────┴─────────> u.cost                    │
             └──────────────────[ K ]<──────────────────┘

    The weights are the design: high gain where disturbances are to be rejected, low gain beyond the bandwidth, about
    one decade per decade through it. K restores what the phase lacks (McFarlane & Glover, IEEE TAC 37 (1992) 759-769).

    Parameters
    ----------
    system : LPVStateSpace
        G, without weights and disturbances; all of its inputs are controls, all outputs are measured.
    pre, post : mapping of name to weight, optional
        In front of inputs and behind outputs: systems of one input and output, or factors.
    design : Design, optional
        `OutputFeedback()` if left out; with `lyapunov=…` for slow scheduling, or a `FixedStructure`.

    Returns
    -------
    ShapedDesign

    Raises
    ------
    InputError
        Unknown signals, a design of another kind.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> integrator = LPVStateSpace([[[0.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), None,
    ...                            inputs=("force",), outputs=("speed",))
    >>> round(loop_shaping(integrator).margin, 2)                # 1/√2 for an integrator
    0.7
    """
    pre, post = dict(pre or {}), dict(post or {})
    inputs, outputs = [s.name for s in system.inputs], [s.name for s in system.outputs]
    for name in pre:
        _checks.known_name(name, inputs, "input of the system")
    for name in post:
        _checks.known_name(name, outputs, "output of the system")
    if set(inputs) & set(outputs):
        raise InputError("inputs and outputs of a system need different names",
                         got=", ".join(sorted(set(inputs) & set(outputs))), mend="rename one")
    core = system.replace(inputs=tuple(Signal(f"{s.name}.plant", s.unit) for s in system.inputs),
                          outputs=tuple(Signal(f"{s.name}.plant", s.unit) for s in system.outputs))
    blocks = [core]
    for s in system.inputs:
        n = s.name
        blocks.append(gain([[1.0, 1.0], [1.0, 0.0]], [Signal(n), Signal(f"{n}.push")],
                           [Signal(f"{n}.shaped"), Signal(f"{n}.cost")]))
        blocks.append(_named(pre.get(n, 1.0), Signal(f"{n}.shaped"), Signal(f"{n}.plant", s.unit)))
    for s in system.outputs:
        n = s.name
        blocks.append(_named(post.get(n, 1.0), Signal(f"{n}.plant", s.unit), Signal(f"{n}.shaped")))
        blocks.append(gain([[1.0, 1.0], [1.0, 1.0]], [Signal(f"{n}.shaped"), Signal(f"{n}.noise")],
                           [Signal(n), Signal(f"{n}.cost")]))
    whole = connect(blocks, [*inputs, *(f"{n}.push" for n in inputs), *(f"{n}.noise" for n in outputs)],
                    [*outputs, *(f"{n}.cost" for n in (*outputs, *inputs))])
    plant = GeneralizedPlant(whole, tuple(inputs), tuple(outputs))
    found = synthesize(plant, OutputFeedback() if design is None else design)
    if found.controller is None or not found.gamma_verified:
        return ShapedDesign(found, None, 0.0, plant)
    return ShapedDesign(found, _complete(found.controller, system, pre, post), 1 / found.gamma_verified, plant)


def _complete(controller: LPVStateSpace, system: LPVStateSpace, pre: Mapping[str, Weight],
              post: Mapping[str, Weight]) -> LPVStateSpace:
    """W_pre K W_post from the outputs to the inputs of the system."""
    core = controller.replace(inputs=tuple(Signal(f"{s.name}.shaped") for s in controller.inputs),
                              outputs=tuple(Signal(f"{s.name}.shaped") for s in controller.outputs))
    blocks = [core, *(_named(post.get(s.name, 1.0), s, Signal(f"{s.name}.shaped")) for s in system.outputs),
              *(_named(pre.get(s.name, 1.0), Signal(f"{s.name}.shaped"), s) for s in system.inputs)]
    return connect(blocks, [s.name for s in system.outputs], [s.name for s in system.inputs])
