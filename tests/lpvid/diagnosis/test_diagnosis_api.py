"""`lpvid.diagnose` from names, files and records as read, and extended models in files: on a toy that hides a cause."""

from __future__ import annotations

import base64
import html
import importlib.metadata
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

import lpvid as lpv
from lpvid.baselines.baseline import Baseline, Coefficient
from lpvid.baselines.named import factories, named_baseline
from lpvid.baselines.signals import Signals
from lpvid.condition.derivation import derived
from lpvid.diagnosis.estimates import errors_of, estimates
from lpvid.diagnosis.evidence.outcome import EvidenceOutcome
from lpvid.diagnosis.facade import _seen_rows, _with_channel_names, run_task
from lpvid.diagnosis.localise import ErrorRegime
from lpvid.diagnosis.problem import problem_of
from lpvid.diagnosis.refitting import refit
from lpvid.diagnosis.task import prepare_task
from lpvid.effects.catalogues import catalogue
from lpvid.effects.composition import Composition
from lpvid.effects.effect import EffectParameter, GridEffect, LpvChange
from lpvid.effects.extended import ExtendedRun
from lpvid.effects.lpv_extension import LpvExtension, enlarged, measured_extension
from lpvid.errors import InputError
from lpvid.report.diagnosis import _facts

RATE, SLOPE, FRICTION, NOISE = 200.0, 40.0, 3.0, 0.5


@dataclass(frozen=True, eq=False)
class Viscous(Baseline):
    """force = slope × velocity."""

    slope: float = 1.0
    polarity: int = 1
    name: str = field(default="viscous", init=False)
    output: str = field(default="force", init=False)
    output_unit: str = field(default="N", init=False)
    static: bool = field(default=True, init=False)

    @property
    def channels(self):
        return ("velocity", "force")

    @property
    def coefficients(self):
        return (Coefficient("slope", "N*s/m", -1e6, 1e6, 1.0),)

    @property
    def vector(self):
        return np.array([self.slope])

    @property
    def start(self):
        return 0

    def with_vector(self, vector):
        return Viscous(float(vector[0]), self.polarity)

    def signals(self, record):
        channels = {n: record[n] for n in ("velocity", "displacement") if record.has(n)}
        return Signals(record.sample_time, channels, self.polarity * record["force"], record.name)

    def core(self, vector):
        return lambda s: vector[0] * s["velocity"]

    def fit(self, records):
        v, f = (np.concatenate([part(self.signals(r)) for r in records])
                for part in (lambda s: s["velocity"], lambda s: s.output))
        return Viscous(float(v @ f / (v @ v)), self.polarity)

    def sensitivities(self, signals, vector):
        return signals["velocity"][:, None]

    def starts(self, signals):
        return []

    def to_dict(self):
        return {"kind": "viscous", "slope": self.slope, "polarity": self.polarity}


class Added(GridEffect):
    """A force of the velocity's sign or square, or of position."""

    family: ClassVar[str] = "toy"
    stage: ClassVar[str] = "force"
    equation = reference = experiment = "toy"

    def __init__(self, name, function, needs=("velocity",), change=None):
        self.name, self.title, self.function, self.needs, self.change = name, name, function, needs, change

    @property
    def parameters(self):
        return (EffectParameter("size", "N", "size", 0.0, (-100.0, 100.0), (-1e4, 1e4), (-1.0, 1.0)),)

    def applies(self, baseline, signals):
        return None

    def compose(self, core, values, baseline):
        return lambda s: core(s) + values[0] * self.function(s)

    def lpv_change(self):
        return self.change


def sign(s: Signals) -> np.ndarray:
    return np.tanh(s["velocity"] / 2e-3)


DRY = Added("dry", sign, change=LpvChange("sign", regressors=("sign(velocity)",)))
CATALOGUE = (DRY, Added("square", lambda s: 50 * s["velocity"] * np.abs(s["velocity"])),
             Added("spring", lambda s: 100 * s["displacement"], ("displacement",)),
             Added("heat", lambda s: s["temperature"], ("temperature",)))


class Point:
    """An entry point that gives an object, or fails."""

    def __init__(self, name, value):
        self.name, self.value, self._object = name, f"{name}:X", value

    def load(self):
        if isinstance(self._object, Exception):
            raise self._object
        return self._object


@cache
def plain_diagnosis():
    """Of the plain record; asked for first by a test for which "viscous" is installed."""
    return lpv.diagnose([measured()], "viscous", CATALOGUE)


@pytest.fixture
def installed(monkeypatch):
    """Pretend that packages name these objects in the entry-point groups of a diagnosis."""
    def factory(records: Sequence, parameters=None):
        return Viscous() if parameters is None else Viscous(parameters["slope"], parameters["polarity"])

    points = {"lpvid.baselines": [Point("viscous", factory)], "lpvid.effects": [Point("toys", CATALOGUE)]}
    everyone = importlib.metadata.entry_points

    def pretended(**asked):
        ours = asked.get("group", "").startswith("lpvid.")
        return points.get(asked["group"], []) if ours else everyone(**asked)

    monkeypatch.setattr(importlib.metadata, "entry_points", pretended)
    return points


def measured(seed: int = 0, friction: float = FRICTION, seconds: float = 20.0, rate: float = RATE, sign_of: int = 1,
             **more) -> lpv.Record:
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    w, phase = 2 * np.pi * np.array([0.7, 1.9, 4.3]), rng.uniform(0, 6, 3)
    x = 0.02 * np.sin(np.outer(t, w) + phase).sum(axis=1)
    v = 0.02 * (w * np.cos(np.outer(t, w) + phase)).sum(axis=1)
    f = SLOPE * v + friction * np.tanh(v / 2e-3) + NOISE * rng.standard_normal(t.size)
    columns = {"displacement": x, "velocity": v, "force": sign_of * f} | more
    return lpv.Record(columns, 1 / rate, name=f"run-{seed}",
                      units={"displacement": "m", "velocity": "m/s", "force": "N"})


def by_hand(slope: float, friction: float, record: lpv.Record) -> float:
    f = record["force"]
    e = f - slope * record["velocity"] - friction * np.tanh(record["velocity"] / 2e-3)
    return float(e @ e / np.sum((f - f.mean()) ** 2))


def test_a_further_record_of_constant_output_has_no_share_but_an_error(installed):
    """Its ESR is no number, before and after: which error is less, and by how much, is known all the same."""
    other = measured(1)
    still = other.with_channel("force", np.full(other.n_samples, 5.0), "N")
    problem = problem_of([measured()], Viscous())
    before, after = (errors_of(problem, b, refit(problem, Composition(b), b.vector, iterations=0),
                               np.zeros(problem.n_samples), [still]) for b in (Viscous(SLOPE), Viscous(0.5 * SLOPE)))
    assert before.esr_held_out == after.esr_held_out == np.inf
    assert EvidenceOutcome.predicts.fget(SimpleNamespace(errors=(before, after)))  # type: ignore[attr-defined]
    found = replace(lpv.diagnose(measured(), "viscous", "toys"), before=before, after=after)
    squares = [np.sum((5.0 - c * other["velocity"]) ** 2) for c in (SLOPE, 0.5 * SLOPE)]
    assert found.gain_percent == pytest.approx(100 * (1 - squares[1] / squares[0])) and found.gain_percent > 10


def test_the_cause_is_named_and_the_gain_is_that_of_the_held_out_record(installed):
    other = measured(1)
    found = lpv.diagnose(measured(), "viscous", "toys", other)
    assert found.verdict == "explained" and [c.name for c in found.causes] == ["dry"]
    size = found.causes[0].parameters[0]
    assert abs(size.value - FRICTION) < 4 * size.std < 0.2
    values = dict(zip(found.extended.composition.names, found.extended.vector, strict=True))
    assert found.after.esr_held_out == pytest.approx(by_hand(values["slope"], values["dry.size"], other), rel=1e-9)
    bare = found.baseline["parameters"][0]["value"]
    assert found.before.esr_held_out == pytest.approx(by_hand(bare, 0.0, other), rel=1e-9)
    assert found.gain_percent == pytest.approx(100 * (1 - found.after.esr_held_out / found.before.esr_held_out))
    described = json.loads(json.dumps(found.to_dict()))
    assert (
        described["schema"] == "lpvid/diagnosis/2" and described["complete"] and described["baseline"]["polarity"] == 1
    )
    assert [c["name"] for c in described["cannot_tell"]] == ["heat"] and "temperature" in described["cannot_tell"][0][
        "reason"
    ]


def test_a_diagnosis_has_a_small_card_with_its_figure(installed) -> None:
    """Verdict as text, both errors as a figure, and colours for a dark page as for a light one."""
    found = plain_diagnosis()
    card = found._repr_html_()
    assert len(card) < 150_000 and "prefers-color-scheme:dark" in card
    assert html.escape(str(found).splitlines()[0]) in card
    pictures = re.findall(r"base64,([^\"]+)\"", card)
    assert len(pictures) == 1 and base64.b64decode(pictures[0]).startswith(b"\x89PNG")
    ax = found.plot()
    heights = [bar.get_height() for bar in ax.patches]
    expected = [e for errors in (found.before, found.after) for e in (errors.esr_training, errors.esr_held_out)]
    assert found.extended is not None and heights == pytest.approx(expected)


def test_an_output_that_does_not_move_is_refused() -> None:
    moving = measured()
    channels = {n: moving[n] for n in ("displacement", "velocity")} | {"force": np.full(moving.n_samples, 2.0)}
    still = lpv.Record(channels, 1 / RATE, units={"displacement": "m", "velocity": "m/s", "force": "N"})
    with pytest.raises(InputError, match="'force' never changes in the training records"):
        lpv.diagnose([still], Viscous(), CATALOGUE)
    channels = {"displacement": np.full(moving.n_samples, 0.1), "force": moving["force"]}
    resting = lpv.Record(channels, 1 / RATE, units={"displacement": "m", "force": "N"})
    with pytest.raises(InputError, match="nothing moves in the training records"):
        lpv.diagnose([resting], Viscous(), CATALOGUE)


def test_an_extended_model_is_the_same_after_its_file(installed, tmp_path):
    found = plain_diagnosis()
    path = lpv.save(found.extended, tmp_path / "extended_model.json")
    assert json.loads(path.read_text())["schema"] == "lpvid/extended/1"
    again, other = lpv.load(path), measured(3)
    assert np.array_equal(again.predict(other), found.extended.predict(other))
    assert np.array_equal(lpv.simulate(again, other).output[:, 0], again.predict(other))
    assert np.array_equal(again.covariance, found.extended.covariance) and again.effects == ("dry",)
    assert again.reads == ("velocity",) and again.period == pytest.approx(1 / RATE)
    values = dict(zip(again.composition.names, again.vector, strict=True))
    figures = lpv.validate(again, other)
    assert figures.label == "held-out" and lpv.validate(again, measured()).label == "training"
    assert figures.overall.free_run.esr == pytest.approx(by_hand(values["slope"], values["dry.size"], other), rel=1e-9)


@pytest.mark.seconds
def test_the_extended_model_is_a_baseline_in_which_nothing_more_is_found(installed, tmp_path):
    found = plain_diagnosis()
    path = lpv.save(found.extended, tmp_path / "m.json")
    for start in (found.extended, path, str(path)):
        more = lpv.diagnose([measured()], start, CATALOGUE)
        assert more.verdict == "nothing-to-explain" and not more.causes
        assert more.baseline["name"] == "viscous+dry"
        assert more.baseline["esr_as_given"]["training"] == pytest.approx(found.after.esr_training, rel=0.1)
    nested = lpv.load(lpv.save(more.extended, tmp_path / "n.json"))  # an extended model inside an extended model
    assert np.array_equal(nested.predict(measured(5)), more.extended.predict(measured(5)))


@pytest.mark.parametrize(("change", "stated"), [
    (lambda d: d["effects"][0].update(name="gone"), "no installed catalogue has the effect 'gone'"),
    (lambda d: d["baseline"].update(name="gone"), "no baseline 'gone'"),
    (lambda d: d["effects"][0]["parameters"][0].update(name="other"), "other parameters here than in the file"),
    (lambda d: d["effects"][0]["parameters"][0].update(value="x"), "size of dry"),
    (lambda d: d["covariance"].pop(), "not a consistent extended file"),
    (lambda d: d["baseline"].update(vector=[1.0, 2.0]), "not a consistent extended file"),
    (lambda d: d.pop("reads"), "lacks 'reads'"),
    (lambda d: d.update(schema="lpvid/extended/2"), "newer format"),
])
def test_a_file_that_is_not_what_it_claims_is_refused_in_one_line(installed, tmp_path, change, stated):
    found = plain_diagnosis()
    path = lpv.save(found.extended, tmp_path / "m.json")
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(InputError) as error:
        lpv.load(path)
    assert stated in str(error.value) and "\n" not in str(error.value) and "m.json" in str(error.value)


@pytest.mark.seconds
def test_a_reversed_record_is_diagnosed_in_the_sense_of_the_device(installed):
    record = measured(sign_of=-1)
    found = lpv.diagnose([record], Viscous(polarity=-1), CATALOGUE)
    assert found.causes[0].parameters[0].value == pytest.approx(FRICTION, rel=0.05)
    assert "reversed polarity" in found.notes[0] and found.baseline["polarity"] == -1
    assert "reversed-polarity" in {f.name for f in found.audit.findings}
    run = lpv.simulate(found.extended, record).output[:, 0]
    assert np.mean(run * record["velocity"]) < 0 and np.corrcoef(run, record["force"])[0, 1] > 0.95


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("current", "advised"), [
    (np.repeat([0.0, 1.0, 0.4, 1.7], 1000), True), (np.sin(np.linspace(0, 30, 4000)), True),
    (np.full(4000, 0.87), False), (1.5 + 0.01 * np.random.default_rng(3).standard_normal(4000), False)])
def test_a_current_that_moves_and_is_not_used_is_pointed_out(current, advised):
    found = run_task(prepare_task([measured(0, current=current)], Viscous(), CATALOGUE))
    lines = [n for n in found.notes if "--baseline auto" in n]
    assert len(lines) == advised
    assert all("viscous does not read it" in n and "\n" not in n for n in lines)


def test_gaps_rates_and_missing_velocity_are_prepared():
    fast = measured(rate=2000.0)
    force = np.array(fast["force"])
    force[20000:20050] = np.nan
    record = lpv.Record({"displacement": fast["displacement"], "force": force}, fast.sample_time, name="run",
                        units={"displacement": "m", "force": "N"})
    task = prepare_task(record, Viscous(), CATALOGUE)
    assert [round(1 / r.sample_time) for r in task.prepared.training] == [500, 500]
    stated = " ".join(task.prepared.notes)
    assert "velocity derived" in stated and "decimated by 4" in stated and "cut into 2" in stated
    v = task.prepared.training[0]["velocity"]
    assert np.corrcoef(v[50:4000], fast["velocity"][::4][50:4000])[0, 1] > 0.999
    found = run_task(task)
    assert [c.name for c in found.causes] == ["dry"]


def test_a_channel_that_only_some_records_have_is_left_out():
    task = prepare_task([measured(0, temperature=np.linspace(0, 1, 4000)), measured(1)], Viscous(), CATALOGUE)
    assert not task.prepared.training[0].has("temperature")
    assert "temperature is left out: only 1 of 2 records have it" in task.prepared.notes


def test_parameters_may_be_given_and_their_error_is_told(installed, tmp_path):
    found = lpv.diagnose(measured(friction=0.0), "viscous", CATALOGUE, parameters={"slope": 60.0, "polarity": 1})
    assert found.verdict == "nothing-to-explain"
    assert found.baseline["esr_as_given"]["training"] == pytest.approx(by_hand(60.0, 0.0, measured(friction=0.0)))
    assert found.before.esr_training < 0.1 * found.baseline["esr_as_given"]["training"]
    with pytest.raises(InputError, match="parameters belong to a baseline that is given by name"):
        lpv.diagnose(measured(), Viscous(), CATALOGUE, parameters={})


@pytest.mark.parametrize(("at", "reached"), [("fitting", "fitting viscous"), ("enlarging", "enlarging")])
def test_an_interruption_leaves_what_is_known(at, reached):
    def stop(text: str) -> None:
        if text.startswith(at):
            raise KeyboardInterrupt

    found = lpv.diagnose(measured(), Viscous(SLOPE), CATALOGUE, progress=stop)
    assert not found.complete and not found.causes and reached in found.reason
    esr = by_hand(found.baseline["parameters"][0]["value"], 0.0, measured())
    assert found.before.esr_training == pytest.approx(esr, rel=0.05)
    assert found.to_dict()["complete"] is False and found.extended.effects == ()
    errors = found.to_dict()["baseline"]
    assert errors["esr"] == {"training": found.before.esr_training, "held_out": None}
    assert f"free-run ESR {found.before.esr_training:.4g} training (training samples, nothing" in str(found)
    page = dict(_facts(found, False))
    assert "free-run ESR, baseline, training" in page and not any("held-out" in name for name in page)


def test_entry_points_may_give_a_factory_or_a_mapping_of_them(installed):
    installed["lpvid.baselines"].append(Point("house", {"a": lambda r, p=None: Viscous(1.0),
                                                        "b": lambda r, p=None: Viscous(2.0)}))
    assert named_baseline("b", ()).vector == [2.0] and set(factories()) == {"viscous", "a", "b"}
    installed["lpvid.effects"].append(Point("more", (Added("lone", sign),)))
    assert [e.name for e in catalogue()] == ["lone", "dry", "square", "spring", "heat"]
    assert [e.name for e in catalogue(["more"])] == ["lone"]


@pytest.mark.parametrize(("group", "value", "stated"), [
    ("lpvid.effects", ImportError("broken\nmodule"), "does not load; broken module"),
    ("lpvid.effects", (1, 2), "no tuple of effects"),
    ("lpvid.effects", (Added("dry", sign),), "two effects have one name"),
    ("lpvid.baselines", {"x": 3}, "gives no factory for 'x'"),
    ("lpvid.baselines", {"viscous": Viscous}, "two installed baselines are called 'viscous'"),
])
def test_a_package_that_names_nonsense_is_told(installed, group, value, stated):
    installed[group].append(Point("odd", value))
    with pytest.raises(InputError) as error:
        catalogue() if group == "lpvid.effects" else factories()
    assert stated in str(error.value) and "\n" not in str(error.value)


def test_unknown_names_are_refused_with_the_nearest(installed):
    with pytest.raises(InputError, match=r"no baseline 'viscos'.*viscous"):
        lpv.diagnose(measured(), "viscos", CATALOGUE)
    with pytest.raises(InputError, match=r"no catalogue 'toy'.*toys"):
        lpv.diagnose(measured(), "viscous", "toy")
    with pytest.raises(InputError, match="this is no baseline"):
        lpv.diagnose(measured(), 3.0, CATALOGUE)
    with pytest.raises(InputError, match="a catalogue is a sequence of effects"):
        lpv.diagnose(measured(), Viscous(), [DRY, 3])


def test_an_lpv_structure_takes_in_what_the_causes_ask_for():
    record = derived([measured()])[0]
    start = lpv.ARX(2, 2, 1, basis=lpv.Polynomial(("velocity_sign",), 1))
    changes = [LpvChange("", degree=1, order=1), LpvChange("", regressors=("displacement", "1", "velocity|velocity|")),
               LpvChange("", schedule_filter="rise-fall"), LpvChange("", schedule_filter="delay")]
    wide = enlarged(start, changes, [record])
    assert wide.na == 3 and wide.width == (3, 3, 3) and wide.delay == (1, 1, 1) and wide.affine == 1
    assert wide.input == ("velocity", "displacement", "velocity_square") and wide.basis.degree == 2
    assert wide.schedule_filter == "rise-fall-delay"
    with pytest.raises(InputError, match="needs temperature"):
        enlarged(start, [LpvChange("", schedule=("temperature",))], [record])


@pytest.mark.parametrize(("before", "after", "end"), [(0.4, 0.1, "held-out"), (0.1, 0.2, "; no gain"),
                                                    (1.4, 1.5, "no better than the mean of these data")])
def test_an_lpv_extension_that_gains_nothing_says_so(before, after, end):
    runs = [SimpleNamespace(held_out=SimpleNamespace(overall=SimpleNamespace(free_run=SimpleNamespace(esr=e))))
            for e in (before, after)]
    assert str(LpvExtension(*runs, ("a constant as a further input",), ())).endswith(end)


def test_the_lpv_extension_gains_what_the_cause_costs():
    """On y = slope v + friction sign v + noise: without the sign the error is bounded below, with it only noise is."""
    found = measured_extension([measured()], lpv.ARX(0, 1, 0), [DRY, CATALOGUE[1]], [measured(1)])
    other = measured(1)
    floor = NOISE**2 / np.var(other["force"])
    assert found.esr[1] == pytest.approx(floor, rel=0.1) and found.esr[0] > 3 * floor
    assert found.gain_percent == pytest.approx(100 * (1 - found.esr[1] / found.esr[0]))
    assert found.left_out == ("square: no LPV structure represents it",) and found.changes == ("dry: sign",)
    assert lpv.validate(found.extended.model, other).overall.free_run.esr == pytest.approx(found.esr[1])


def test_the_lpv_extension_leaves_a_filter_out_where_the_scheduling_rests():
    """Held currents do not show a lag: `identify` refuses such a filter, and the extension goes on without it."""
    lag = Added("lag", sign, change=LpvChange("scheduled on the lagged current", schedule_filter="lag"))
    runs = [measured(k, current=np.full(4000, float(k))) for k in (0, 1)]
    structure = lpv.ARX(0, 1, 0, basis=lpv.Polynomial("current", 1))
    found = measured_extension(runs, structure, [DRY, lag], [measured(2, current=np.ones(4000))])
    assert found.left_out == ("lag: current is constant within every record",) and found.changes == ("dry: sign",)


def test_where_the_error_lies_is_stated_with_the_channel_that_stands_for_the_current(installed):
    found = replace(plain_diagnosis(), wrong=(ErrorRegime("large |current|", 0.78, 0.25),
                                               ErrorRegime("velocity < 0", 0.6, 0.5),
                                               ErrorRegime("after a change of current", 0.6, 0.2)))
    record = measured()
    commanded = record.with_channel("voltage", np.ones(record.n_samples), "V")
    for records in ([commanded, commanded], [commanded.with_roles({"current": "voltage"})]):
        named = _with_channel_names(found, records)
        assert [w.where for w in named.wrong] == ["large |voltage|", "velocity < 0", "after a change of voltage"]
    current = commanded.with_channel("current", np.ones(record.n_samples), "A")
    for other in (record, current):
        assert _with_channel_names(found, [other]).wrong == found.wrong


def test_a_parameter_at_the_end_of_its_range_states_which_end():
    from quartercar.effects.thermal import ViscousFade

    effect = ViscousFade()
    fade, cooling = estimates(effect, np.array([5e-5, 2900.0]), np.array([2e-6, np.nan]))
    assert str(cooling) == "cooling_time 2900 s (its upper bound)" and cooling.to_dict()["bound"] == "upper"
    assert str(fade) == "fade 5e-05 ± 2e-06 1/J" and "bound" not in fade.to_dict()
    absent, inside = estimates(effect, np.array([0.0, 60.0]), None)
    assert absent.bound is None and inside.bound is None


def test_the_extended_model_keeps_the_rows_of_the_training_files() -> None:
    """Of the records as read, not of the resampled ones; held-out records are none of them."""
    training, kept = measured(0), measured(1)
    found = run_task(prepare_task([training], Viscous(), CATALOGUE, [kept], sample_rate=0.4 / training.sample_time))
    assert found.extended is not None
    rows = found.extended.metadata["training"]["rows"]
    assert rows["sample_time"] == training.sample_time
    assert lpv.validate(found.extended, training.slice(501, 1500)).label == "training"
    assert lpv.validate(found.extended, kept).label == "held-out"


def test_held_out_records_that_hold_training_rows_are_noted() -> None:
    training, other = measured(0), measured(1)
    for kept, seen in ((training.slice(1000, 3000), True), (other, False)):
        notes = _seen_rows(prepare_task([training], Viscous(), CATALOGUE, [kept]))
        assert (len(notes) == 1 and "holds samples that the model was fitted to" in notes[0]) if seen else not notes
    assert not _seen_rows(prepare_task([training], Viscous(), CATALOGUE))


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e3])
@pytest.mark.parametrize(("low", "high", "slack"), [(0.0, 0.0, 0.0), (0.0, 2.0, 0.02), (-5.0, -4.0, 0.05)])
def test_the_box_of_a_run_is_wider_by_a_share_in_any_unit(scale: float, low: float, high: float, slack: float) -> None:
    """Where a scheduling variable was always zero in training there is no share: any other value is outside."""
    run = SimpleNamespace(scheduled=("current",), model=SimpleNamespace(
        ranges={"current": (scale * low, scale * high)}, units={}))
    box = ExtendedRun.box.fget(run)  # type: ignore[attr-defined]
    assert [*box.lower, *box.upper] == pytest.approx([scale * (low - slack), scale * (high + slack)], rel=1e-12, abs=0)
