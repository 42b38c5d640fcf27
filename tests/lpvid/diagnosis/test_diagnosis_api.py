"""`lpvid.diagnose` from names, files and records as read: on a toy that hides a cause."""

from __future__ import annotations

import base64
import html
import json
import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.toy_viscous import CATALOGUE, DRY, FRICTION, RATE, SLOPE, Viscous, by_hand, measured, pretend_installed

import lpvid as lpv
from lpvid.diagnosis.estimates import errors_of, estimates
from lpvid.diagnosis.evidence.outcome import EvidenceOutcome
from lpvid.diagnosis.facade import _labelled, _polarity_note, _with_channel_names, run_task
from lpvid.diagnosis.localise import ErrorRegime
from lpvid.diagnosis.problem import problem_of
from lpvid.diagnosis.refitting import refit
from lpvid.diagnosis.task import prepare_task
from lpvid.effects.composition import Composition
from lpvid.effects.preparing import prepare
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.report.diagnosis import _facts


@cache
def plain_diagnosis():
    """Of the plain record; asked for first by a test for which "viscous" is installed."""
    return lpv.diagnose([measured()], "viscous", CATALOGUE)


@pytest.fixture
def installed(monkeypatch):
    return pretend_installed(monkeypatch)


@pytest.mark.seconds
def test_a_further_record_of_constant_output_has_no_share_but_an_error(installed):
    """Its ESR is no number, before and after: which error is less, and by how much, is known all the same."""
    other = measured(1)
    still = other.with_channel("force", np.full(other.n_samples, 5.0), "N")
    problem = problem_of([measured()], Viscous())
    before, after = (errors_of(problem, refit(problem, Composition(b), b.vector, iterations=0),
                               np.zeros(problem.n_samples), [still]) for b in (Viscous(SLOPE), Viscous(0.5 * SLOPE)))
    assert before.esr_held_out == after.esr_held_out == np.inf
    assert EvidenceOutcome.predicts.fget(SimpleNamespace(errors=(before, after)))  # type: ignore[attr-defined]
    found = replace(lpv.diagnose(measured(), "viscous", "toys"), before=before, after=after)
    squares = [np.sum((5.0 - c * other["velocity"]) ** 2) for c in (SLOPE, 0.5 * SLOPE)]
    assert found.gain_percent == pytest.approx(100 * (1 - squares[1] / squares[0])) and found.gain_percent > 10


@pytest.mark.seconds
def test_a_tone_that_no_input_has_is_not_taken_for_noise(installed):
    """Of a tenth of the force: named with its frequency beside the cause, and alone the error is unexplained."""
    record = measured()
    tone = np.sin(2 * np.pi * 23.0 * np.arange(record.n_samples) / RATE)
    humming = record.with_channel("force", record["force"] + 0.14 * record["force"].std() * tone, "N")
    found = lpv.diagnose(humming, "viscous", "toys")
    assert found.verdict == "partly-explained" and [c.name for c in found.causes] == ["dry"]
    assert "a line at 23" in found.reason and "Hz that no input has" in found.reason
    assert "line" not in lpv.diagnose(record, "viscous", "toys").reason
    again = lpv.diagnose(humming, found.extended, "toys")
    assert again.verdict == "unexplained" and "a line at 23" in again.reason


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


@pytest.mark.seconds
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


@pytest.mark.seconds
def test_a_reversed_record_is_diagnosed_in_the_sense_of_the_device(installed):
    record = measured(sign_of=-1)
    found = lpv.diagnose([record], Viscous(polarity=-1), CATALOGUE)
    assert found.causes[0].parameters[0].value == pytest.approx(FRICTION, rel=0.05)
    assert "reversed polarity" in found.notes[0] and found.baseline["polarity"] == -1
    assert "reversed-polarity" in {f.name for f in found.audit.findings}
    run = lpv.simulate(found.extended, record).output[:, 0]
    assert np.mean(run * record["velocity"]) < 0 and np.corrcoef(run, record["force"])[0, 1] > 0.95


@pytest.mark.thinned(2, "slow", "seconds")
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


@pytest.mark.seconds
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


def test_unknown_names_are_refused_with_the_nearest(installed):
    with pytest.raises(InputError, match=r"no baseline 'viscos'.*viscous"):
        lpv.diagnose(measured(), "viscos", CATALOGUE)
    with pytest.raises(InputError, match=r"no catalogue 'toy'.*toys"):
        lpv.diagnose(measured(), "viscous", "toy")
    with pytest.raises(InputError, match="this is no baseline"):
        lpv.diagnose(measured(), 3.0, CATALOGUE)
    with pytest.raises(InputError, match="a catalogue is a sequence of effects"):
        lpv.diagnose(measured(), Viscous(), [DRY, 3])


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


@pytest.mark.seconds
def test_the_extended_model_keeps_the_rows_of_the_training_files() -> None:
    """Of the records as read, not of the resampled ones; held-out records are none of them."""
    training, kept = measured(0), measured(1)
    found = run_task(prepare_task([training], Viscous(), CATALOGUE, [kept], sample_rate=0.4 / training.sample_time))
    assert found.extended is not None
    rows = found.extended.metadata["training"]["rows"]
    assert rows["sample_time"] == training.sample_time
    assert lpv.validate(found.extended, training.slice(501, 1500)).label == "training"
    assert lpv.validate(found.extended, kept).label == "held-out"


@pytest.mark.seconds
def test_figures_of_held_out_records_that_hold_training_rows_are_not_called_held_out() -> None:
    training, other = measured(0), measured(1)
    found, files = plain_diagnosis(), {"held-out": [other], "training": [training.slice(1000, 3000)],
                                       "partly training": [training.slice(1000, 3000), other]}
    for part, kept in files.items():
        task = prepare_task([training], Viscous(), CATALOGUE, kept)
        labelled, notes = _labelled(found, task)
        assert labelled.before.part == labelled.after.part == part
        assert (labelled.before.to_dict()["esr"]["held_out"] is None) == (part != "held-out")
        assert any("holds samples that the model was fitted to" in n for n in notes) == (part != "held-out")
        assert labelled.held_out.endswith("with rows of the training data") == (part != "held-out")
        assert part == "held-out" or all(w.held_out_esr is None for w in labelled.weights.sets)
        stopped = replace(found, complete=False)
        assert _labelled(stopped, task) == (stopped, ())  # its figures are all of training samples
    assert _labelled(found, prepare_task([training], Viscous(), CATALOGUE)) == (found, ())


def test_channels_of_held_out_records_beyond_the_training_range_are_stated() -> None:
    training, other = measured(0), measured(1)
    fast = other.with_channel("velocity", 3 * other["velocity"], "m/s")
    _, notes = _labelled(plain_diagnosis(), prepare_task([training], Viscous(), CATALOGUE, [fast]))
    assert len(notes) == 1 and "of 'velocity' lies outside the range of the training data" in notes[0]


def test_a_record_that_lacks_the_force_is_named_itself() -> None:
    other = measured(1)
    bare = Record({n: c for n, c in other.channels.items() if n != "force"}, other.sample_time, name="bare")
    with pytest.raises(InputError, match="record 'bare' has no force, which other records have"):
        prepare([measured()], [bare], ())


@pytest.mark.parametrize(("findings", "mend"), [((), "--flip force"), (("velocity-sign",), "--flip velocity")])
def test_a_turned_velocity_has_one_mend(findings: tuple[str, ...], mend: str) -> None:
    audited = SimpleNamespace(findings=[SimpleNamespace(name=n) for n in findings])
    (note,) = _polarity_note(SimpleNamespace(polarity=-1, output="force"), audited)  # type: ignore[arg-type]
    assert mend in note and not _polarity_note(SimpleNamespace(polarity=1), audited)  # type: ignore[arg-type]
