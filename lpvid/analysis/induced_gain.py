"""What is known of an induced gain: certified from above, reached from below."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from lpvid.analysis.worst_case import WorstCase
from lpvid.codec import Coded, null
from lpvid.lmi.gain_certificate import GainCertificate
from lpvid.lmi.hull_certificate import HullCertificate

VERDICTS = ("certified", "certified on a grid only", "not certified", "unstable")


@dataclass(frozen=True, eq=False)
class Gain(Coded):
    """What is known of sup ‖z‖/‖w‖ over all inputs and all admissible trajectories of the scheduling.

    Parameters
    ----------
    verdict : str
        One of `VERDICTS`.
    upper : float
        Certified; infinite where nothing could be certified.
    lower : float
        Reached by `worst`; infinite for a frozen system that is unstable.
    worst : WorstCase or None
        A scheduling, held or moving, with which the gain is at least `lower`.
    certificate : GainCertificate or HullCertificate or None
        What `lpvid.verify` re-checks.
    inputs, outputs : tuple of str
    why, mend : str
        Why there is no certificate, and what can be done.
    seconds : float
    """

    JSON = ("verdict", "upper", "lower", "between_grid", "inputs", "outputs", "worst", "certificate", "why", "mend",
            "seconds")

    verdict: str
    upper: float = field(metadata=null(math.inf))
    lower: float = field(metadata=null(math.inf))
    worst: WorstCase | None
    certificate: GainCertificate | HullCertificate | None = field(metadata={"read": lambda data, _: _certificate(data)})
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    why: str = ""
    mend: str = ""
    seconds: float = 0.0

    @property
    def between_grid(self) -> bool:
        """`upper` is proven on the whole scheduling box or polytope."""
        return self.certificate is not None and self.certificate.between_grid

    def __repr__(self) -> str:
        lines = [f"{self.verdict}: {self.why or self.certificate.claim if self.certificate else self.why}"]
        if math.isfinite(self.lower):
            lines.append(f"  at least {self.lower:.6g}: {self.worst}" if self.worst else f"  at least {self.lower:.6g}")
        if self.certificate is not None:
            lines.append(f"  {self.certificate.kind} storage function, margin {self.certificate.margin:.3g}, "
                         "re-checked with numpy")
        if self.mend:
            lines.append(f"  mend: {self.mend}")
        return "\n".join(lines)


def _certificate(data: Mapping) -> GainCertificate | HullCertificate:
    kind = HullCertificate if data.get("schema") == HullCertificate.SCHEMA else GainCertificate
    return kind.from_dict(data)
