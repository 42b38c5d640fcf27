"""What the reports of dampers, rides and the rig show, against answers from elsewhere."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.browser import BROWSER, axe_source, grave_findings
from matplotlib.text import Text

import lpvid as lpv
from lpvid.auditing import Audit, audit
from lpvid.plot.style import panels
from lpvid.record import Record
from lpvid.report import render
from quartercar.criteria import rms, weighted
from quartercar.dampers.laws.guo import Guo
from quartercar.parameters import MEGANE
from quartercar.plot.fan import force_velocity_fan
from quartercar.plot.ride_spectra import SIGNALS, estimates, spectra, third_octaves
from quartercar.plot.rides import _names
from quartercar.report.fit import _parameter_table
from quartercar.report.rig import rig_page
from quartercar.rig import Rig
from quartercar.rig.causes import effect
from quartercar.rig.plan import Plan, parse_plan
from quartercar.vehicle.linear import LinearCar
from quartercar.vehicle.nonlinear import QuarterCar

STEP = 1 / 500.0


@pytest.fixture(scope="module")
def ridden():
    """A linear car over a rough road, long enough for an average."""
    rng = np.random.default_rng(0)
    road = np.cumsum(rng.standard_normal(30_000)) * 3e-4
    road -= np.linspace(road[0], road[-1], road.size)
    return QuarterCar(MEGANE).run(road, STEP)


def test_gains_from_the_road_are_those_of_the_linear_car(ridden):
    """H1 of a linear car against C (jω − A)⁻¹ B + D, between 1 and 20 Hz, within the scatter of the average."""
    f, _, gains = estimates(ridden)
    system = LinearCar(MEGANE)
    shown = (f >= 1.0) & (f <= 20)
    s = 2j * np.pi * f[shown, None, None]
    relative = system.relative()
    response = relative.C @ np.linalg.solve(s * np.eye(4) - relative.A, relative.B[:, :1] + 0j) + relative.D[:, :1]
    expected = np.abs(s * response)[:, :, 0]  # its input is the road's speed
    for name, at in (("body_acceleration", "body_acceleration"), ("suspension_deflection", "suspension_deflection"),
                     ("tyre_load", "tyre_force")):
        true = expected[:, relative.outputs.index(at)]
        assert np.median(np.abs(gains[name][shown] / true - 1)) < 0.03
        assert np.max(np.abs(gains[name][shown] / true - 1)) < 0.25


def test_the_density_holds_the_mean_square(ridden):
    """Parseval: ∫S df is the variance; third octaves add up to the weighted rms of ISO 2631-1."""
    f, densities, _ = estimates(ridden)
    for name in SIGNALS:
        assert np.sum(densities[name]) * (f[1] - f[0]) == pytest.approx(np.var(ridden[name]), rel=0.1)
    _, bands = third_octaves(f, densities["body_acceleration"])
    whole = rms(weighted(ridden["body_acceleration"], STEP))
    assert np.sqrt(np.sum(bands**2)) == pytest.approx(whole, rel=0.05)


def test_units_of_spectra_are_those_of_print(ridden):
    labels = [ax.get_ylabel() for ax in spectra([("a", ridden)])]
    assert labels[:3] == ["PSD [(m/s²)²/Hz]", "PSD [N²/Hz]", "PSD [m²/Hz]"]
    assert labels[3:6] == ["gain [(m/s²)/m]", "gain [N/m]", "gain [m/m]"]


@pytest.mark.seconds
def test_names_of_laws_lie_on_neither_their_bars_nor_each_other():
    """Twelve laws close together, some beyond the frame: each name clear of its own bar, and of every other name."""
    figure, axes = panels(1, width=5.0, height=3.4)
    ax = axes[0, 0]
    rng = np.random.default_rng(5)
    points = [(f"law {k}", x, y, "black") for k, (x, y) in enumerate(rng.uniform(-3, 17, (12, 2)))]
    ax.set_xlim(-5, 15)
    ax.set_ylim(-5, 15)
    for _, x, y, _ in points:
        ax.errorbar(x, y, 1.0, 4.0, elinewidth=0.8)
    _names(ax, points)
    figure.canvas.draw()
    boxes = [Text.get_window_extent(text) for text in ax.texts]  # without the line to its point
    for k, (box, (_, _, y, _)) in enumerate(zip(boxes, sorted(points, key=lambda p: p[2]), strict=True)):
        own = ax.transData.transform((0.0, min(y, 15.0)))[1]
        assert not box.y0 + 1 < own < box.y1 - 1
        assert not any(box.overlaps(other) for other in boxes[:k])
        assert ax.get_window_extent().y0 <= box.y0 and box.y1 <= ax.get_window_extent().y1


def test_a_short_ride_has_no_spectra(ridden):
    short = SimpleNamespace(time=ridden.time[:3000], sample_time=STEP)
    assert estimates(short) is None and spectra([("a", short)]) is None


# -- dampers ----------------------------------------------------------------------------------------------------------
def swept(damper: Guo, current: float) -> lpv.Record:
    t = np.arange(1500) / 500
    x, v = 0.02 * np.sin(9 * t), 0.18 * np.cos(9 * t)
    bare = lpv.Record({"displacement": x, "velocity": v, "current": np.full(t.size, current), "force": 0 * t},
                      sample_time=1 / 500, units={"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"},
                      name=f"{current:g} A")
    return replace_force(bare, damper.simulate(bare).output[:, 0])


def replace_force(record: lpv.Record, force: np.ndarray) -> lpv.Record:
    channels = {n: record[n] for n in ("displacement", "velocity", "current")}
    return lpv.Record({**channels, "force": force}, sample_time=1 / 500, name=record.name,
                      units={"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"})


@pytest.mark.parametrize("polarity", [1, -1])
def test_a_fan_has_the_static_law_of_every_current(polarity):
    damper = Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0))
    records = [swept(damper, level) for level in (0.0, 1.0, 2.0)]
    records = [replace_force(r, polarity * r["force"]) for r in records]
    row = SimpleNamespace(damper=damper, name="guo")
    ax = force_velocity_fan([row], records, polarity)
    curves = [line for line in ax.lines if line.get_linewidth() == 1.8]
    assert len(curves) == 3
    for line, level in zip(curves, (0.0, 1.0, 2.0), strict=True):
        v = np.asarray(line.get_xdata())
        assert line.get_ydata() == pytest.approx(polarity * damper.static_force(v, level, 0.0), rel=1e-9, abs=1e-9)
    cloud = ax.collections[0].get_offsets()
    assert len(cloud) == sum(r.n_samples for r in records)


@pytest.mark.parametrize(("unit", "stated"), [("A", "at the lowest current, 0 A"), ("V", "at the lowest voltage, 0 V")])
def test_an_end_of_the_range_at_which_a_parameter_holds_has_its_unit(unit, stated):
    damper = Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0))
    row = SimpleNamespace(damper=damper, fit=None, parameters=[
        {"name": p.name, "value": 1.0, "std": None, "unit": p.unit} for p in damper.parameters])
    table = _parameter_table(row, "", "", unit)
    assert any(cells[0].endswith(stated) for cells in table.rows)


@pytest.mark.parametrize(("unit", "word"), [("A", "current"), ("V", "voltage")])
def test_the_colour_bar_of_a_fan_names_what_drives_the_damper(unit, word):
    damper = Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0))
    records = [swept(damper, level) for level in (0.0, 2.0)]
    records = [lpv.Record({n: r[n] for n in r.channels}, sample_time=1 / 500,
                          units={n: r.unit(n) for n in r.channels} | {"current": unit}) for r in records]
    ax = force_velocity_fan([SimpleNamespace(damper=damper, name="guo")], records, 1)
    assert ax.figure.axes[-1].get_ylabel() == f"{word} [{unit}]"


# -- the rig ----------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def on_the_rig() -> tuple[Plan, Audit, list[Record]]:
    plan = parse_plan('seed = 7\n[[experiments]]\npreset = "test-1"\nduration = 1.0\n')
    records = [Rig().run(replace(plan.experiments[0], duration=1.0), seed=7)]
    return plan, audit(records), records


def test_the_rig_says_what_was_run_and_what_was_on(on_the_rig, without_drawing):
    plan, audited, records = on_the_rig
    on = replace(plan, rig=replace(plan.rig, effects=(effect("coulomb-friction", strength=0.5),
                                                      effect("coil-lag", strength=0.0))))
    with without_drawing():  # its words alone; the next test looks at the drawn page
        pages = [rig_page(p, audited, records) for p in (plan, on)]
    titles = [s.title for s in pages[0].sections]
    assert titles[:3] == ["The plan", "Effects that are on", "Damper and sensors"] and "Findings" in titles
    assert "effects that are on: none" in pages[0].verdict and "seed 7" in pages[0].verdict
    assert "effects that are on: coulomb-friction." in pages[1].verdict
    table = pages[1].sections[1].items[0]
    assert [row[:2] for row in table.rows] == [("coulomb-friction", "0.5"), ("coil-lag", "0")]
    row = pages[0].sections[0].items[0].rows[0]
    assert row[0].startswith("test-1") and "speed 11.18 m/s" in row[1]
    assert row[2].startswith("icps: hold 0.02 s; low 0 A")


@pytest.mark.skipif(BROWSER is None or axe_source() is None, reason="no Chromium or no axe-core here")
@pytest.mark.parametrize("width", [
    pytest.param(1200, marks=pytest.mark.slow), pytest.param(390, marks=pytest.mark.seconds)])
def test_no_grave_findings_of_accessibility_on_the_page_of_the_rig(on_the_rig, width, tmp_path):
    plan, audited, records = on_the_rig
    page = render(rig_page(plan, audited, records))
    assert len(page.encode()) <= 1_500_000
    assert grave_findings(page, tmp_path, width) == ""
