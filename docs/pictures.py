"""Pictures of the documentation, from computations: `python docs/pictures.py [NAME…]` makes those of the explanations.

`python docs/pictures.py --all` makes every picture again: these, the five source pages with theirs, and `images/`; a
quarter of an hour of processor time.

Every legend names whether data are measured or virtual, and whether a figure is free-run or one-step. The site's build
calls `draw_missing`, which makes only those that are not there or older than this file.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import lpvid as lpv
from lpvid.condition import split_tail
from lpvid.plot.colours import BLUE, GREEN, INK, MUTED, ORANGE, VERMILION
from lpvid.plot.style import label, look, panels
from quartercar.rig import EXPERIMENTS, Rig, effect

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path(__file__).resolve().parent / "generated" / "pictures"
WIDTH = 7.2
"""inch: narrower than in reports, so that lettering stays legible on a phone"""
ORDER_FOUR = {"input": "velocity", "output": "force", "basis": lpv.Polynomial("current", degree=1)}


def free_run_and_one_step() -> Figure:
    """A model with too late an input: excellent in one-step prediction, poor in free run."""
    run = Rig().run(replace(EXPERIMENTS["test-1"], duration=20.0), seed=7)
    training, held_out = split_tail(run)
    late = lpv.identify(training, lpv.ARX(na=2, nb=2, nk=2, **ORDER_FOUR)).model
    figures = lpv.validate(late, held_out).overall
    free, step = lpv.simulate(late, held_out), lpv.predict(late, held_out, 1)
    window = slice(800, 1200)
    t = held_out.times[window]
    with look():
        figure, axes = panels(2, 1, width=WIDTH, height=2.2, sharex=True)
        for ax, found, esr, name, colour in (
            (axes[0, 0], step, figures.one_step.esr, "one-step prediction", GREEN),
            (axes[1, 0], free, figures.free_run.esr, "free run", VERMILION),
        ):
            ax.plot(t, held_out["force"][window], color=INK, linewidth=1.4, label="virtual rig, held-out")
            ax.plot(t, found.output[window, 0], color=colour, label=f"{name}: ESR {esr:.4f}")
            ax.set_ylabel(label("force", "N"))
            ax.legend(loc="upper right", ncols=2)
        axes[1, 0].set_xlabel(label("time", "s"))
    return figure


def frozen_poles() -> Figure:
    """Two matrices with all poles at 0 and a model that grows when it alternates between them."""
    a, b = np.array([[0.0, 2.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [2.0, 0.0]])
    scale = 0.9
    p = np.linspace(-1.0, 1.0, 201)
    frozen = [np.abs(np.linalg.eigvals(scale * (0.5 * (a + b) + 0.5 * q * (b - a)))).max() for q in p]

    def sizes(course: np.ndarray) -> np.ndarray:
        state, found = np.ones(2), []
        for q in course:
            found.append(np.linalg.norm(state))
            state = scale * (0.5 * (a + b) + 0.5 * q * (b - a)) @ state
        return np.array(found)

    with look():
        figure, axes = panels(1, 2, width=WIDTH, height=2.8)
        axes[0, 0].plot(p, frozen, color=BLUE)
        axes[0, 0].axhline(1.0, color=MUTED, linestyle="--")
        axes[0, 0].set(
            xlabel="p, standing still",
            ylabel="largest pole modulus",
            ylim=(0, 1.1),
            title="Every frozen pole is inside",
        )
        steps = np.arange(20)
        for course, name, colour in (
            (np.full(20, -1.0), "p = −1", GREEN),
            (np.zeros(20), "p = 0", BLUE),
            (np.where(steps % 2, -1.0, 1.0), "p = 1, −1, 1, …", VERMILION),
        ):
            axes[0, 1].semilogy(steps, np.maximum(sizes(course), 1e-6), "o-", ms=3, color=colour, label=name)
        axes[0, 1].set(xlabel="sample", ylabel="size of the state", title="And still it grows while p moves")
        axes[0, 1].legend()
    return figure


def realisations() -> Figure:
    """One transfer function, three state-space forms, one moving scheduling variable."""
    tf = lpv.LPVTransferFunction.siso(
        a=[[-1.2, 0.3], [0.5, -0.2]],
        b=[[0, 0], [0.4, 0.1], [0.1, -0.3]],
        basis=lpv.Polynomial("p", degree=1),
        sample_time=1.0,
    )
    rng = np.random.default_rng(2)
    with look():
        figure, axes = panels(1, 2, width=WIDTH, height=2.8)
        for ax, period in zip(axes[0], (200, 6), strict=True):
            p = np.sin(2 * np.pi * np.arange(400) / period)
            record = lpv.Record({"u1": np.repeat(rng.normal(size=50), 8), "p": p}, sample_time=1.0)
            exact = lpv.simulate(tf, record, "zero").output[:, 0]
            ax.plot(exact[:80], color=INK, linewidth=1.6, label="transfer function")
            for form, colour, style in (
                ("controllable", VERMILION, "-"),
                ("observable", BLUE, "-"),
                ("augmented", ORANGE, ":"),
            ):
                found = lpv.simulate(lpv.realize(tf, form=form).model, record, "zero").output[:, 0]
                share = np.sum((found - exact) ** 2) / np.sum((exact - exact.mean()) ** 2)
                ax.plot(found[:80], color=colour, linestyle=style, label=f"{form}: ESR {share:.2g}")
            ax.set(xlabel="sample", title=f"period of p: {period} samples")
            ax.legend(fontsize=7.5)
    return figure


def verified_gain() -> Figure:
    """Certified and reached gain against the speed of the scheduling."""
    eye = np.eye(2)
    model = lpv.LPVStateSpace(
        [-eye, 0 * eye],
        [[[1], [0]], [[0], [1]]],
        [[[0, -1]], [[1, 0]]],
        np.zeros((2, 1, 1)),
        lpv.Polynomial("d", degree=1),
        None,
        lpv.Scheduling(("d",), (-1,), (1,)),
    )
    rates = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
    gains = lpv.l2_gains(model, rates, trajectories=True)
    with look():
        figure, ((ax,),) = panels(1, 1, width=WIDTH, height=3.0)
        ax.loglog(
            rates,
            [g.upper for g in gains],
            "o-",
            color=BLUE,
            label="certified: no motion of d up to this rate exceeds it",
        )
        ax.loglog(
            rates,
            [max(g.lower, 1e-4) for g in gains],
            "s--",
            color=VERMILION,
            label="reached: an input and a motion of d attain it",
        )
        ax.set(
            xlabel="bound on |dd/dt| [1/s]", ylabel="gain [1]", title="The frozen gain of this model is zero at every d"
        )
        ax.legend(loc="lower right")
    return figure


def diagnosis_residual() -> Figure:
    """What a law without dry friction gets wrong, before and after friction is part of it."""
    from quartercar.dampers import Guo, fit
    from quartercar.effects import CATALOGUE
    from quartercar.rig import RigDamper

    rig = Rig(damper=RigDamper.static(), effects=(effect("coulomb-friction"),))
    record = rig.run(replace(EXPERIMENTS["test-3"], duration=10.0), seed=1)
    few = [e for e in CATALOGUE if e.name in ("coulomb-friction", "gas-stiffness", "coil-lag", "asymmetry")]
    found = lpv.diagnose(record, "guo", few)
    law = fit(Guo(degree=1, span=(0.0, 2.5), current_range=(0.0, 2.5)), record).damper
    without = lpv.simulate(law, record).output[:, 0]
    names = ", ".join(f"{c.name} {c.parameters[0]}" for c in found.causes) or found.verdict
    measured = record["force"]
    with look():
        figure, axes = panels(1, 2, width=WIDTH, height=2.8)
        extended = found.extended.predict(record) if found.extended is not None else without
        speed = 1e3 * record["velocity"]
        for force, colour, title in (
            (measured - without, MUTED, "baseline"),
            (measured - extended, GREEN, f"with {names}"),
        ):
            axes[0, 0].plot(speed, force, ".", ms=1.5, color=colour, label=title)
        axes[0, 0].set(xlabel=label("velocity", "mm/s"), ylabel=label("free-run error", "N"), xlim=(-150, 150))
        axes[0, 0].legend(fontsize=7.5, markerscale=6)
        rows = [("baseline", found.before.esr_held_out), ("with the cause", found.after.esr_held_out)]
        axes[0, 1].bar([r[0] for r in rows], [r[1] for r in rows], color=[MUTED, GREEN], width=0.5)
        axes[0, 1].set(ylabel="free-run ESR, held-out blocks")
    return figure


PICTURES: dict[str, Callable[[], Figure]] = {
    f.__name__: f for f in (free_run_and_one_step, frozen_poles, realisations, verified_gain, diagnosis_residual)
}


def draw(name: str, folder: Path = FOLDER) -> Path:
    """Make one picture."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    PICTURES[name]().savefig(path, dpi=130)
    return path


def draw_missing(folder: Path = FOLDER) -> None:
    """Make those that are not there, or that are older than this file."""
    changed = Path(__file__).stat().st_mtime
    for name in PICTURES:
        path = folder / f"{name}.png"
        if not path.exists() or path.stat().st_mtime < changed:
            draw(name, folder)


SOURCES = ("make_000.py", "make_001.py", "make_002.py", "make_003.py", "make_004.py --full")
"""of `docs/sources`"""


def draw_everything() -> None:
    """All pictures of the documentation, each by the script that owns it."""
    here = Path(__file__).resolve().parent
    for name in PICTURES:
        print(draw(name))
    for script in SOURCES:
        subprocess.run([sys.executable, *script.split()], cwd=here / "sources", check=True)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "quartercar", "demo", "--out", folder], cwd=here.parent, check=True)
        shutil.copy(Path(folder) / "overview.png", here / "images" / "overview.png")
        example = here.parent / "examples" / "characterise_damper.py"
        subprocess.run([sys.executable, str(example), folder], cwd=here.parent, check=True)
        shutil.copy(Path(folder) / "characteristics.png", here / "images" / "characterise.png")


if __name__ == "__main__":
    if sys.argv[1:] == ["--all"]:
        draw_everything()
        sys.exit()
    unknown = [n for n in sys.argv[1:] if n not in PICTURES]
    if unknown:
        sys.exit(f"no picture {unknown[0]}; there are {', '.join(PICTURES)}")
    for chosen in sys.argv[1:] or PICTURES:
        print(draw(chosen))
