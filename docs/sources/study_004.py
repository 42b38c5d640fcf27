"""The computations behind the page of source 004 (Díaz Salas 2011), on the virtual rig.

Training: replicate 0 of tests 1-3 and the seven constant currents of test 6. Held-out: other replicates and roads of
all eight experiments, as in `tests/benchmarks/thesis_study.py`. Every ESR is of the free run.

Expected before the first run: (a) the canonical form, re-estimated, is below 0.04 in the mean over experiments, as the
thesis states; (b) in each family the variant with the current is better than the one without, since seven of the
eight experiments move between currents or hold one that the mean law does not have; (c) a model with one linear
input from velocity is worse at 1.2 A than the one with three zones; (d) v_high rises with the current, m_1 ≈ m_3,
c_1 ≈ −c_3, m_2 is the largest slope; (e) no critical current within 0 … 2.5 A.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

import lpvid as lpv
from lpvid.identification.zone_regression import ZoneRegression, regress_zones
from quartercar.dampers import FitSettings, Guo, Guo5, Guo6, Guo7, Guo15, Narx2, WangKamath, fit
from quartercar.rig import EXPERIMENTS, Rig, default_records, effect

CHANNELS = {"input": "velocity", "output": "force"}
AFFINE = lpv.Polynomial("current", degree=1)
STRETCH = 2560
"""samples (5 s) of every training record that the damper laws are fitted to: they have at most 15 parameters"""
SETTINGS = FitSettings(starts=4, polished=2)
LONG = 600.0
"""s: duration of tests 4 and 5 in the source; the quick mode takes the rig's 60 s"""


@dataclass(frozen=True)
class Row:
    """One model on every experiment: held-out free-run ESR and √SSE [N]; None where it diverges."""

    family: str
    model: str
    table: str
    esr: Mapping[str, float | None]
    root_sse: Mapping[str, float | None]

    @property
    def mean(self) -> float | None:
        """Mean ESR over experiments."""
        found = [e for e in self.esr.values() if e is not None]
        return float(np.mean(found)) if len(found) == len(self.esr) else None


def held_out(full: bool) -> dict[str, list[lpv.Record]]:
    """Runs by experiment that no fit sees; `full`: all replicates, tests 4 and 5 at 600 s with a warming damper."""
    if not full:
        kept = default_records(part="held-out") + default_records(1, "training", ["test-6"])
        return {name: [r for r in kept if r.name.startswith(name)] for name in EXPERIMENTS}
    warm, cold, found = Rig(effects=(effect("thermal-fade"),)), Rig(), {}
    for name, plan in EXPERIMENTS.items():
        long = name in ("test-4", "test-5")
        rig, seed = (warm, 0) if long else (cold, 1 if name == "test-6" else 0)
        shown = replace(plan, duration=LONG) if long else plan
        first = 1 if name in ("test-1", "test-2", "test-3") else 0
        found[name] = [rig.run(shown, seed, k) for k in range(first, plan.replicates)]
    return found


def judge(family: str, name: str, table: str, model: object, kept: Mapping[str, Sequence[lpv.Record]]) -> Row:
    """Free run along everything that was held out."""
    esr: dict[str, float | None] = {}
    root: dict[str, float | None] = {}
    for test, runs in kept.items():
        figures = lpv.validate(model, runs).overall.free_run  # type: ignore[arg-type]
        esr[test] = figures.esr
        count = sum(r.n_samples for r in runs)
        root[test] = None if figures.rmse is None else float(figures.rmse * np.sqrt(count))
    return Row(family, name, table, esr, root)


def laws(training: Sequence[lpv.Record]) -> list[tuple[str, str, str, Callable[[], object]]]:
    """(family, model, table of the source, how it is fitted), without and with the current."""
    short = [r.slice(0, min(STRETCH, r.n_samples)) for r in training]
    span = {"span": (0.0, 2.5), "current_range": (0.0, 2.5)}
    both = {"settings": SETTINGS}
    return [
        ("Wang-Kamath", "without current", "B.1", lambda: fit(WangKamath(), short[::2], **both).damper),
        ("Wang-Kamath", "with current", "B.2", lambda: fit(WangKamath(degree=1), short[::2], **both).damper),
        ("NARX (2,2,2)", "without current", "B.3", lambda: fit(Narx2(method="one-step"), short, **both).damper),
        ("NARX (2,2,2)", "with current", "B.4", lambda: fit(Narx2(degree=1, method="one-step"), short, **both).damper),
        ("Guo", "without current", "B.6", lambda: fit(Guo(), short, **both).damper),
        ("Guo", "15 parameters", "B.5", lambda: fit(Guo15(**span), short, **both).damper),
        ("Guo", "7 parameters", "B.7", lambda: fit(Guo7(**span), short, **both).damper),
        ("Guo", "6 parameters", "B.8", lambda: fit(Guo6(**span), short, **both).damper),
        ("Guo", "5 parameters", "B.9", lambda: fit(Guo5(**span), short, **both).damper),
    ]


@dataclass(frozen=True)
class Chain:
    """The thesis's own model, step by step, and the linear one that it replaces."""

    zones: ZoneRegression
    linear: lpv.LPVTransferFunction
    by_level: lpv.LPVTransferFunction
    transfer_function: lpv.LPVTransferFunction
    form: lpv.LPVStateSpace
    canonical: lpv.LPVStateSpace

    def models(self) -> list[tuple[str, str, str, object]]:
        """As `laws`, identified already."""
        return [
            ("linear", "one LTI model of velocity", "Fig. 3.4", self.linear),
            ("LPV", "zones by level (3.14)-(3.22)", "C.1", self.by_level),
            ("LPV", "transfer function, zones fitted along", "–", self.transfer_function),
            ("LPV", "its canonical form (3.23)", "C.1", self.form),
            ("LPV", "canonical form, re-estimated", "C.1", self.canonical),
        ]


def identify_chain(training: Sequence[lpv.Record]) -> Chain:
    """Regress zones by level, identify, realise, re-estimate."""
    zones = regress_zones([r for r in training if r.name.startswith("test-6")])
    linear = lpv.identify(training, lpv.ARX(4, 4, 1, **CHANNELS)).model
    level = lpv.identify(training, lpv.ARX(4, 4, 1, stage=zones.stage, basis=AFFINE, **CHANNELS)).model
    plain = lpv.identify(training, lpv.ARX(4, 4, 1, stage="three-zone", basis=AFFINE, **CHANNELS)).model
    realised = lpv.realize(plain, "controllable")
    return Chain(zones, linear, level, plain, realised.model, lpv.refit_form(realised, training).model)


def compare_all(
    chain: Chain, training: Sequence[lpv.Record], kept: Mapping[str, Sequence[lpv.Record]]
) -> tuple[list[Row], dict[str, object]]:
    """All rows, and the models by "family, model"; after each row, how long the others may take at this row's pace."""
    rows, models = [], {}
    listed = [*laws(training), *((f, n, t, (lambda m=m: m)) for f, n, t, m in chain.models())]
    hours = sum(r.n_samples * r.sample_time for runs in kept.values() for r in runs) / 3600
    print(f"{len(listed)} models along {hours:.2f} h of held-out records", file=sys.stderr)
    first = time.perf_counter()
    for k, (family, name, where, make) in enumerate(listed, 1):
        begun = time.perf_counter()
        model = models[f"{family}, {name}"] = make()
        rows.append(judge(family, name, where, model, kept))
        now = time.perf_counter()
        left = (now - first) / k * (len(listed) - k)
        print(
            f"{family}, {name}: mean ESR {rows[-1].mean}, {now - begun:.0f} s; about {left / 60:.0f} min to go",
            file=sys.stderr,
        )
    return rows, models


@dataclass(frozen=True)
class LineOverCurrent:
    """A slope, an intercept or v_high of every level against its polynomial in the current (Table C.1)."""

    name: str
    unit: str
    coefficients: tuple[float, ...]
    r_squared: tuple[float, ...]
    """of first and second degree"""


def regressions(found: ZoneRegression) -> list[LineOverCurrent]:
    """First-degree lines through the seven levels, with R² of first and second degree."""
    levels, lines = np.array(found.levels), np.array(found.lines)
    listed = [("v_high", "m/s", np.array(found.limits))]
    listed += [(f"m_{z + 1}", "N·s/m", lines[:, z, 0]) for z in range(3)]
    listed += [(f"c_{z + 1}", "N", lines[:, z, 1]) for z in range(3)]
    rows = []
    for name, unit, values in listed:
        fits = [np.polynomial.polynomial.polyfit(levels, values, degree) for degree in (1, 2)]
        spread = np.sum((values - values.mean()) ** 2)
        left = [np.sum((values - np.polynomial.polynomial.polyval(levels, f)) ** 2) for f in fits]
        rows.append(LineOverCurrent(name, unit, tuple(fits[0].tolist()), tuple(float(1 - e / spread) for e in left)))
    return rows
