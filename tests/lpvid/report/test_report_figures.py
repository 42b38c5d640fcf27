"""What the figures of the reports show, against what is known of their signals by other means."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid import plot
from lpvid.plot.comparison import Comparison
from lpvid.plot.residuals import NORMAL_99
from lpvid.plot.stability import locus
from lpvid.plot.synthesis import weighted_channels
from lpvid.report.courses import record_traces
from lpvid.report.figures import comparisons, overall_table, records_table, verdict_grade
from lpvid.report.inspection import MOST_DRAWN, inspection_page
from lpvid.report.stability import locus_items, study_stability
from lpvid.report.synthesis import modes, verdict
from lpvid.report.validation import validation_page
from lpvid.simulation import Simulation
from lpvid.synthesis import weights
from lpvid.synthesis.attach_weights import weigh
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.output_feedback import OutputFeedback
from lpvid.synthesis.synthesizing import synthesize
from lpvid.validation.figures import FigurePair, Figures, RecordFigures
from lpvid.validation.report import Validation

RATE = 100.0


def compared(error: np.ndarray, u: np.ndarray, name: str = "run") -> Comparison:
    """A comparison whose one-step residual is `error`."""
    n = error.size
    record = lpv.Record({"u": u, "y": error}, sample_time=1 / RATE, units={"u": "m", "y": "N"}, name=name)
    zero = Simulation(output=np.zeros((n, 1)), start=0, horizon=1, diverged_at=None, initial="zero", names=("y",),
                      units=("N",), sample_time=1 / RATE)
    return Comparison(record, "held-out", zero, zero, "y", "N")


def coloured(rng: np.random.Generator, n: int, pole: float) -> np.ndarray:
    from scipy.signal import lfilter

    return lfilter([1.0], [1.0, -pole], rng.standard_normal(n + 200))[200:]


# -- residuals --------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_limits_hold_99_per_cent_of_correlations_of_what_is_independent():
    """Coloured residual beside coloured input: the share of bars outside is near 1 % over many lags and records."""
    rng = np.random.default_rng(3)
    outside = counted = 0
    for _ in range(15):
        ax = plot.residuals([compared(coloured(rng, 2500, 0.9), coloured(rng, 2500, 0.8))], 80, ["u"])[2]
        lines = [seg for c in ax.collections if hasattr(c, "get_segments") for seg in c.get_segments()]
        band = -float(ax.patches[0].get_y())
        outside += sum(abs(float(seg[1][1])) > band for seg in lines)
        counted += len(lines)
    assert counted == 15 * 161
    assert 0.002 < outside / counted < 0.03


def test_the_lag_of_a_missing_input_is_the_one_that_sticks_out():
    """e(t) = u(t − 3) + noise: the bar at +3 is ρ = 1/√2, and is marked as outside."""
    rng = np.random.default_rng(4)
    u = rng.standard_normal(4000)
    error = np.r_[np.zeros(3), u[:-3]] + rng.standard_normal(4000)
    ax = plot.residuals([compared(error, u)], 10, ["u"])[2]
    marked = [seg for c in ax.collections if hasattr(c, "get_segments")
              for seg in c.get_segments() if abs(float(seg[1][1])) > 0.3]
    assert len(marked) == 1
    assert float(marked[0][0][0]) == 3 and float(marked[0][1][1]) == pytest.approx(1 / np.sqrt(2), abs=0.03)


def test_the_histogram_stands_about_its_own_mean():
    error = 40.0 + np.random.default_rng(5).standard_normal(3000)
    ax = plot.residuals([compared(error, error)], 10)[0]
    assert np.mean(ax.get_xlim()) == pytest.approx(error.mean(), abs=0.2)
    assert any("mean 40" in line.get_label() for line in ax.lines)
    white = plot.residuals([compared(error, error)], 10)[1].patches[0]
    assert NORMAL_99 / np.sqrt(3000) == pytest.approx(-float(white.get_y()), rel=1e-6)


# -- synthesis --------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def designed():
    system = lpv.LPVStateSpace([[[-1.0]]], [[[1.0, 1.0]]], [[[1.0], [1.0]]], [[[0.0, 0.0], [0.1, 0.0]]],
                               lpv.Polynomial((), 0), None, inputs=("road", "force"), outputs=("comfort", "sensor"))
    wz = weights.lowpass(2.0, 10.0)
    plant = weigh(GeneralizedPlant(system, ("force",), ("sensor",)), {}, {"comfort": wz, "effort": ("force", 0.1)})
    return plant, synthesize(plant, OutputFeedback()), {"comfort": wz, "effort": 0.1}


def test_no_channel_crosses_its_inverse_weight(designed):
    """‖z_i‖ ≤ γ‖w‖ on every channel; the inverse weight of a plain factor is flat at γ/0.1, in Hz."""
    _, found, given = designed
    drawn = weighted_channels(found.closed_loop, given, found.gamma_verified)
    shown = {ax.get_title(loc="left"): ax for ax in np.ravel(drawn)}
    assert set(shown) == {"comfort", "effort"}
    for ax in shown.values():
        curve, bound = ax.lines[0], ax.lines[-1]
        assert np.all(np.asarray(curve.get_ydata()) <= np.asarray(bound.get_ydata()) * (1 + 1e-9))
        assert ax.get_xlabel() == "frequency [Hz]"
    assert shown["effort"].lines[-1].get_ydata() == pytest.approx(10 * found.gamma_verified)
    f = np.asarray(shown["comfort"].lines[-1].get_xdata())
    expected = found.gamma_verified / (2.0 / np.abs(1 + 2j * np.pi * f / 10.0))
    assert shown["comfort"].lines[-1].get_ydata() == pytest.approx(expected, rel=1e-6)


def test_the_verified_gain_is_in_the_verdict(designed):
    plant, found, _ = designed
    stated = verdict(found, plant)
    assert f"{found.gamma_verified:.4g}" in stated and "verified" in stated and stated.startswith("Solved")


def test_modes_of_a_discrete_pair_are_those_of_the_continuous_one():
    s = 2 * np.pi * 3.0 * (-0.2 + 1j * np.sqrt(1 - 0.04))
    assert modes(np.array([s, s.conjugate()]), None) == ["3 Hz, ζ 0.2"]
    assert modes(np.exp(0.01 * np.array([s, s.conjugate()])), 0.01) == ["3 Hz, ζ 0.2"]


# -- other pages ------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_every_record_is_drawn_or_said_to_be_left_out():
    rng = np.random.default_rng(0)
    records = [lpv.Record({"u": rng.standard_normal(80)}, sample_time=0.01, units={"u": "m"}, name=f"r{k}")
               for k in range(MOST_DRAWN + 2)]
    few, many = (inspection_page(lpv.audit(rs), rs).sections[-1].items for rs in (records[:9], records))
    assert sum(i.kind == "traces" for i in few) == 9
    assert sum(i.kind == "traces" for i in many) == MOST_DRAWN
    stated = " ".join(i.text for i in many if i.kind == "paragraph")
    assert f"r{MOST_DRAWN}" in stated and f"r{MOST_DRAWN + 1}" in stated and "Not drawn" in stated
    spectrum = next(i for i in few if i.kind == "figure")
    assert "The first 6 of 9 records" in spectrum.caption


@pytest.mark.seconds
def test_a_locus_says_where_the_other_variables_are_held():
    model = lpv.LPVTransferFunction(a=-np.array([[[[0.5, 0.1, 0.05]]]]), b=np.ones((1, 1, 1, 3)),
                                    basis=lpv.Polynomial(("p", "q"), degree=1), sample_time=0.1,
                                    scheduling=lpv.Scheduling(("p", "q"), (0.0, 2.0), (1.0, 6.0), units=("A", "K")))
    captions = [item.caption for item in locus_items(model)]
    assert "q = 4 K" in captions[0] and "p = 0.5 A" in captions[1]
    names = [t.get_text() for t in locus(lpv.pole_locus(model, "p"))[0].get_legend().get_texts()]
    assert names == ["stability limit: the unit circle", "poles of this model"]


def test_notes_of_several_loci_name_their_variable():
    """A negative real pole along both variables of a model, along the only one of another."""
    def stated(names: tuple[str, ...]) -> list[str]:
        a = np.array([0.5, *([0.1] * len(names))])[None, None, None]
        model = lpv.LPVTransferFunction(a=a, b=np.ones_like(a), basis=lpv.Polynomial(names, degree=1), sample_time=0.1,
                                        scheduling=lpv.Scheduling(names, (0.0,) * len(names), (1.0,) * len(names)))
        return study_stability(model).to_dict()["notes"]

    both, one = stated(("p", "q")), stated(("p",))
    assert [n.split(":")[0] for n in both] == ["along p", "along q"] and one[0].startswith("a negative real pole")


@pytest.mark.seconds
def test_a_validation_shows_mean_error_phase_and_steps():
    """Offset of 2 N that the model lacks: it is in the tables; a linear model has Bode and step figures."""
    rng = np.random.default_rng(1)
    u = rng.standard_normal(600)
    model = lpv.LPVTransferFunction.siso([[-0.5]], [[2.0]], lpv.Polynomial(), 1 / RATE, inputs="u", outputs="y")
    bare = lpv.Record({"u": u, "y": np.zeros(600)}, sample_time=1 / RATE, units={"u": "m", "y": "N"})
    y = lpv.simulate(model, bare).output[:, 0] + 2.0
    data = [lpv.Record({"u": u, "y": y}, sample_time=1 / RATE, units={"u": "m", "y": "N"}, name="late")]
    found = lpv.validate(model, data)
    for table in (overall_table([found]), records_table(found)):
        column = table.columns.index("mean error")
        assert float(table.rows[0][column].split()[0]) == pytest.approx(found.overall.free_run.mean_error, rel=1e-2)
    page = validation_page(found, model, comparisons(model, data, "held-out"), "m.json")
    kinds = {s.title: [i.kind for i in s.items] for s in page.sections}
    assert kinds["Frequency and step response"] == ["figure", "figure"]
    assert kinds["Measured and simulated"][0] == "traces" and "figure" in kinds["What is left in the residuals"]


def test_a_turned_sensor_is_above_the_figures_and_its_error_in_the_frame():
    """y = −run: the error is twice the output. The sentence states no negative share, the caveat what to turn."""
    rng = np.random.default_rng(2)
    u = rng.standard_normal(600)
    model = lpv.LPVTransferFunction.siso([[-0.5]], [[2.0]], lpv.Polynomial(), 1 / RATE, inputs="u", outputs="y")
    bare = lpv.Record({"u": u, "y": np.zeros(600)}, sample_time=1 / RATE, units={"u": "m", "y": "N"})
    y = -lpv.simulate(model, bare).output[:, 0]
    data = [lpv.Record({"u": u, "y": y}, sample_time=1 / RATE, units={"u": "m", "y": "N"}, name="turned")]
    found = lpv.validate(model, data)
    page = validation_page(found, model, comparisons(model, data, "held-out"), "m.json")
    assert "explains nothing of the output" in page.verdict and any("--flip y" in c for c in page.caveats)
    traces = next(i for s in page.sections for i in s.items if i.kind == "traces")
    low, high = traces.panels[0].limits
    error = np.concatenate([c.values for c in traces.panels[0].curves])
    assert low <= np.nanmin(error) and high >= np.nanmax(error)


@pytest.mark.parametrize("at", [0, 7])
def test_a_record_that_diverges_at_its_first_sample_counts_as_bad(at):
    def row(name: str, esr: float | None, diverged: int | None = None) -> RecordFigures:
        free = Figures("free-run", esr, None, None, "N", 100, diverged)
        return RecordFigures(name, 100, free, Figures("one-step", 0.0, 100.0, 0.0, "N", 100), 0.0)

    def graded(*rows: RecordFigures) -> str:
        return verdict_grade(Validation("held-out", FigurePair(rows[0].free_run, rows[0].one_step), rows, (), 0.0))

    well, still, gone = row("well", 1e-4), row("still", None), row("gone", None, at)
    assert graded(well, still) == "good" and graded(well, still, gone) == "warn"


def test_panels_of_a_record_share_one_time_axis() -> None:
    """The times of a uniform clock are a new array at every call: one for each channel doubled the data."""
    record = lpv.Record({n: np.arange(50.0) for n in "abc"}, sample_time=1 / RATE)
    curves = [curve for panel in record_traces(record, "abc", "").panels for curve in panel.curves]
    assert len(curves) == 3 and all(c.times is curves[0].times for c in curves)
    np.testing.assert_array_equal(curves[0].times, record.times)
