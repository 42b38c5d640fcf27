"""What --passive costs in free run, and what it buys in a car.

::

    python tests/benchmarks/passive_study.py [DATA]

For the rig's default records, and for mr_damper_random and mr_damper_sines where DATA holds them: held-out free-run ESR
of the demo's structure (order 4, tanh stage, current filter, a constant) unconstrained and passive, the certificate and
the time. Then the same two models of the rig as dampers of a quarter car on ISO C and over the bump, at currents held
from 0 to 2.5 A and under a current that jumps at random: the least of the energy that the damper has received, and for
the certified model the least of received − stored + initially stored, which is zero or more.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import lpvid as lpv
from lpvid.errors import NumericalError
from quartercar.dampers.blackbox.held import Held
from quartercar.dampers.blackbox.lpv import LpvArx
from quartercar.demo.run import experiment_figures, rig_data, structure
from quartercar.parameters import MEGANE
from quartercar.roads.ride_roads import Bump, IsoRoad
from quartercar.vehicle.nonlinear import Coil, QuarterCar
from quartercar.vehicle.passivity_balance import ride_passivity

CURRENTS = (0.0, 0.5, 1.0, 1.75, 2.5)
ROADS = (IsoRoad("C", 20.0, 10.0), Bump())


def studied(name: str, training: list, held_out: list, inner: lpv.ARX, rate: float | None = None
            ) -> lpv.Identification:
    """One row: cost, certificate, time."""
    begun = time.perf_counter()
    found = lpv.identify(training, lpv.Passive(inner), held_out=held_out, sample_rate=rate)
    ended = time.perf_counter()
    assert found.held_out is not None
    before, after = found.unconstrained_figures[1].overall.free_run, found.held_out.overall.free_run
    certificate = lpv.PassivityCertificate.from_dict(found.model.metadata["passive"])
    again = lpv.verify(certificate, found.model)
    where = "between grid points" if again.between_grid else "on a grid"
    print(f"{name:<10}held-out free-run ESR {_esr(before)} -> {_esr(after)}; {certificate.verdict} ({where}), margin "
          f"{certificate.margin:.2g}, re-checked: {again.holds}; {ended - begun:.1f} s, the unconstrained fit included")
    print(f"          unconstrained, {lpv.passivity_margin(found.unconstrained)!r}", flush=True)
    return found


def _esr(run) -> str:
    return "diverges" if run.esr is None else f"{run.esr:.4f} (rmse {run.rmse:.4g} N)"


def rig() -> lpv.Identification:
    """The rig's records; experiments 7 and 8 are no part of the training."""
    training, held_out = rig_data(0)
    found = studied("rig", training, held_out, structure())
    assert found.held_out is not None
    free = found.unconstrained_figures[1]
    rows = experiment_figures(found.held_out, free, free)
    stated = ", ".join(f"{e.name} {e.plain_esr or np.inf:.4f} -> {e.esr or np.inf:.4f}" for e in rows)
    before, after = (np.mean([v or np.inf for v in column]) for column in
                     ([e.plain_esr for e in rows], [e.esr for e in rows]))
    print(f"          {stated}; mean {before:.4f} -> {after:.4f}", flush=True)
    return found


def measured(data: Path) -> None:
    """The two measured sets, each trained and tested as in real_data_comparison.py."""
    (whole,) = lpv.read(str(data / "mr_damper_random" / "estimation.csv"))
    cut = round(8 / whole.time_base.period)
    studied("random", [whole.slice(0, cut)], [whole.slice(cut, whole.n_samples)],
            replace(structure(), basis=lpv.Polynomial(("voltage",), 1)), 500.8)
    sines = lpv.read(str(data / "mr_damper_sines"))
    studied("sines", [r for r in sines if not r.name.endswith("0p75A")],
            [r for r in sines if r.name.endswith("0p75A")], replace(structure(), schedule_filter=None), 200.0)


def in_the_car(model: lpv.LPVTransferFunction, layout, name: str) -> None:
    """Least energy balance of a model as the damper of a car."""
    damper = LpvArx(stored=Held(model, layout).to_dict())
    for road in ROADS:
        profile = road.profile(model.sample_time, 0)
        rng = np.random.default_rng(0)
        jumping = np.repeat(rng.uniform(0.0, 2.5, profile.size // 8 + 1), 8)[: profile.size]
        cases = {f"{i:g} A": np.full(profile.size, i) for i in CURRENTS} | {"jumping": jumping}
        for label, command in cases.items():
            car = QuarterCar(MEGANE, damper, coil=Coil(highest=2.5))
            try:
                run = car.run(profile, model.sample_time, command)
            except NumericalError as error:
                print(f"{name:<14}{road.name:<34}{label:<9}{str(error).split(';')[0]}")
                continue
            found = ride_passivity(run)
            power = (run["damper_force"] - damper.conservative_force(np.zeros(1))[0]) * run["suspension_velocity"]
            received = np.cumsum(power) * run.sample_time
            storage = "no storage function" if found.lowest is None else f"received - stored >= {found.lowest:+.3g} J"
            print(f"{name:<14}{road.name:<34}{label:<9}received {received[-1]:9.4g} J, least {received.min():+9.3g} J, "
                  f"given back at a stretch {found.returned / max(received[-1], 1e-12):6.2%}; {storage}")


def main() -> None:
    """Every part in turn."""
    found = rig()
    if len(sys.argv) > 1:
        measured(Path(sys.argv[1]))
    for model, name in ((found.unconstrained, "unconstrained"), (found.model, "passive")):
        in_the_car(model, found.layout, name)


if __name__ == "__main__":
    main()
