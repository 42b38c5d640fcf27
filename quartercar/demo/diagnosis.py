"""The last step of the demo: a record of the rig hides a cause, and the diagnosis finds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lpvid.codec import Encoded
from lpvid.report import Section

if TYPE_CHECKING:
    from lpvid.diagnosis.diagnosis import Diagnosis
    from lpvid.diagnosis.task import DiagnosisTask

HIDDEN = (("coil-lag", 0.5), ("coulomb-friction", 1.0), ("gas-stiffness", 1.5), ("asymmetry", 0.3))
"""causes of which the seed hides one, with strengths in units of the rig's"""
DURATION = 15.0
"""of each record [s]"""


@dataclass(frozen=True, eq=False)
class HiddenCause(Encoded):
    """What was hidden and what was found.

    Attributes
    ----------
    hidden : str
        The rig's cause.
    task : DiagnosisTask
    found : Diagnosis
    """

    JSON = ("hidden", "named", "verdict", ("diagnosis", "found"))

    hidden: str
    task: DiagnosisTask
    found: Diagnosis

    @property
    def named(self) -> tuple[str, ...]:
        """What the diagnosis names."""
        return tuple(c.name for c in self.found.causes)

    @property
    def verdict(self) -> str:
        """One sentence."""
        if self.named != (self.hidden,):
            stated = ", ".join(self.named) or self.found.verdict
            return f"The rig hid {self.hidden} from Guo's law; the diagnosis states {stated}."
        return (f"The rig hid {self.hidden} from Guo's law; the diagnosis names it, and the extended model removes "
                f"{self.found.gain_percent:.1f} % of the squared free-run error on a record it has not seen.")

    def lines(self) -> list[str]:
        """For the terminal.

        Returns
        -------
        list of str
            The verdict and the first six lines of the diagnosis.
        """
        return [self.verdict, *repr(self.found).splitlines()[:6]]

    @cached_property
    def section(self) -> Section:
        """For the report: the verdict, the parameters found, loops before and after, where the baseline is most wrong.

        Drawn where it is first asked for, and kept where this is sent to another process.
        """
        from lpvid.plot import diagnosis as draw
        from lpvid.report import Item, PageFigure, Paragraph
        from lpvid.report.diagnosis import before_after

        shown = [replace(s, origin="virtual") for s in before_after(self.found, self.task)]
        items: list[Item] = [Paragraph(self.verdict, strong=True)]
        items += [Paragraph(f"{c.name}: {', '.join(map(str, c.parameters))}.") for c in self.found.causes]
        drawn = draw.loops(shown[-1:], bool(self.named))
        if drawn is not None:
            items.append(
                PageFigure.of(
                    drawn,
                    "Force over velocity of the held-out record, virtual and simulated, before "
                    "and after the extension.",
                )
            )
        items.append(PageFigure.of(draw.close_up(shown[-1:], bool(self.named)), "Where the baseline is most wrong."))
        return Section("A hidden cause", tuple(items))


def hide_and_find(seed: int = 0, report_progress: Callable[[str], None] = lambda text: None) -> HiddenCause:
    """Hide a cause in a damper that otherwise follows Guo's law, and diagnose it.

    Parameters
    ----------
    seed : int
        Of the rig, and of what it hides.
    report_progress : callable
        Receives what is being done.

    Returns
    -------
    HiddenCause
        The same for the same seed.
    """
    from lpvid.diagnosis.facade import run_task
    from lpvid.diagnosis.task import prepare_task
    from quartercar.rig import EXPERIMENTS, Rig, RigDamper, effect

    name, strength = HIDDEN[int(np.random.default_rng([seed, 1]).integers(len(HIDDEN)))]
    rig = Rig(damper=RigDamper.static(), effects=(effect(name, strength),))
    test = replace(EXPERIMENTS["test-3"], duration=DURATION)
    task = prepare_task([rig.run(test, seed, 0)], "guo", "quartercar", [rig.run(test, seed, 1)])
    found = HiddenCause(name, task, run_task(task, None, report_progress))
    report_progress(f"drawing {found.section.title.lower()}")
    return found
