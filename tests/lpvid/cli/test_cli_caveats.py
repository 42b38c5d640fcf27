"""What commands state beside their figures: signs, ranges, units, causes of short records, options without effect."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli import modelling
from lpvid.cli.app import app
from lpvid.validation.figures import Figures

pytestmark = pytest.mark.usefixtures("undrawn")

IO = ("--input", "velocity", "--output", "force", "--na", 1, "--nb", 2, "--nk", 0)


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


def write(file: Path, seed: int = 0, *, sign: float = 1.0, size: float = 1.0, current: float | None = None,
          units: tuple[str, str] = ("velocity [m/s]", "force [N]"), n: int = 1200) -> Path:
    """A damper of first order behind low-pass noise; `current` alone moves by a microampere about its value."""
    rng = np.random.default_rng(seed)
    t, v = np.arange(n) / 200.0, size * np.convolve(rng.standard_normal(n), np.ones(5) / 5, "same")
    p = np.repeat(rng.uniform(0, 2, n // 20 + 1), 20)[:n] if current is None else current + 1e-6 * rng.normal(size=n)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + (200 + 150 * p[k]) * v[k]
    force = sign * (y + 0.02 * y.std() * rng.standard_normal(n))
    rows = "\n".join(",".join(f"{x:.9g}" for x in row) for row in zip(t, v, p, force, strict=True))
    file.write_text(f"time [s],{units[0]},current [A],{units[1]}\n{rows}\n")
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("caveats")
    write(root / "run.csv")
    write(root / "turned.csv", 1, sign=-1.0)
    write(root / "wide.csv", 2, size=3.0)
    write(root / "bare.csv", 3, units=("velocity [m/s]", "force"))
    write(root / "steady.csv", 4, current=0.8)
    run("identify", root / "run.csv", *IO, "--out", root / "plain")
    return root


# -- polarity ----------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_a_reversed_held_out_file_leaves_the_sign_of_the_model_alone(folder, tmp_path):
    shown = run("identify", folder / "run.csv", *IO, "--schedule", "current", "--held-out", folder / "turned.csv",
                "--out", tmp_path / "m").output
    assert "polarity" not in lpv.load(tmp_path / "m/model.json").metadata
    assert "reversed-polarity" in shown and "note: held-out: with the sign of 'force' turned" in shown
    assert "--flip force" in (tmp_path / "m/report.html").read_text()
    compared = run("compare", tmp_path / "m/model.json", folder / "turned.csv").output
    assert "with the sign of 'force' turned the free-run fit would be" in compared


@pytest.mark.seconds
def test_reversed_training_records_mark_the_model(folder, tmp_path):
    run("identify", folder / "turned.csv", *IO, "--held-out", folder / "run.csv", "--out", tmp_path / "m")
    assert lpv.load(tmp_path / "m/model.json").metadata["polarity"] == "reversed"


# -- range and units -----------------------------------------------------------------------------------------------
def test_held_out_data_beyond_the_training_range_are_named(folder):
    shown = run("identify", folder / "run.csv", *IO, "--held-out", folder / "wide.csv").output
    assert "% of 'velocity' lies outside the range of the training data" in shown


@pytest.mark.seconds
def test_held_out_currents_beyond_the_training_range_are_named(folder, tmp_path):
    other = tmp_path / "high.csv"
    rows = [line.split(",") for line in (folder / "run.csv").read_text().splitlines()]
    other.write_text("\n".join(",".join([a, b, c if i == 0 else f"{float(c) + 5:.9g}", d])
                               for i, (a, b, c, d) in enumerate(rows)) + "\n")
    words = ("identify", folder / "run.csv", *IO, "--schedule", "current", "--held-out")
    assert "100.0 % of samples outside the training range of the scheduling" in run(*words, other).output
    assert "training range of the scheduling" not in run(*words[:-1], "--hold-out", "0.1").output


@pytest.mark.seconds
def test_a_rate_that_was_given_is_not_advised_again(folder, tmp_path):
    rows = (folder / "wide.csv").read_text().splitlines()
    slow = tmp_path / "slow.csv"
    slow.write_text("\n".join([rows[0], *rows[1::2]]) + "\n")
    described = run("identify", folder / "run.csv", slow, *IO, "--sample-rate", 100).output
    assert "warning mixed-rates" not in described and "resampled from 200 Hz to 100 Hz" in described
    assert "warning mixed-rates" in run("inspect", folder / "run.csv", slow).output
    stated = run("inspect", folder / "run.csv", slow, "--sample-rate", 100).output
    assert "note mixed-rates" in stated and "mended: one rate by --sample-rate 100" in stated


def test_jitter_is_no_fault_once_the_rate_was_given(folder, tmp_path):
    head, *rows = [line.split(",") for line in (folder / "run.csv").read_text().splitlines()]
    late = np.random.default_rng(3).uniform(0, 5e-4, len(rows))
    shaky = tmp_path / "shaky.csv"
    shaky.write_text("\n".join([",".join(head), *(",".join([f"{float(r[0]) + x:.7f}", *r[1:]])
                                                for r, x in zip(rows, late, strict=True))]) + "\n")
    assert "fault jitter" in run("inspect", shaky).output
    assert "fault jitter" not in run("identify", shaky, *IO, "--sample-rate", 200).output


def test_units_that_no_file_states_are_named_once(folder):
    stated = "no unit is stated for 'force': taken as SI"
    assert run("identify", folder / "bare.csv", *IO).output.count(stated) == 1
    assert run("validate", folder / "plain/model.json", folder / "bare.csv").output.count(stated) == 1
    assert "no unit" not in run("validate", folder / "plain/model.json", folder / "wide.csv").output


@pytest.mark.parametrize("command", [("simulate",), ("compare",), ("validate", "--chunk", 300)])
def test_units_that_no_file_states_are_named_by_every_command_that_runs_a_model(folder, command):
    name, *more = command
    shown = run(name, folder / "plain/model.json", folder / "bare.csv", *more).output
    assert shown.count("no unit is stated for 'force': taken as SI") == 1
    assert "no unit is stated" not in run(name, folder / "plain/model.json", folder / "wide.csv", *more).output


@pytest.mark.seconds
def test_units_of_later_files_count_in_parts_too(folder):
    shown = run("identify", folder / "run.csv", folder / "bare.csv", *IO, "--chunk", 500).output
    assert "no unit is stated for 'force': taken as SI" in shown
    again = run("validate", folder / "plain/model.json", folder / "run.csv", "--chunk", 500).output
    assert "not held-out: run holds samples that the model was fitted to" in again


def test_data_in_parts_get_the_remarks_of_whole_ones(folder, tmp_path):
    """On ranges and units: the same lines, whatever the parts."""
    large = write(tmp_path / "large.csv", 5, size=1000.0, units=("velocity", "force [N]"))
    for file, words in ((folder / "wide.csv", ("lies outside the range of the training data",)),
                        (large, ("lies outside the range", "about 1000 times the"))):
        whole = run("validate", folder / "plain/model.json", file).output
        parts = run("validate", folder / "plain/model.json", file, "--chunk", 300).output
        for word in words:
            lines = [[line for line in shown.splitlines() if word in line] for shown in (whole, parts)]
            assert lines[0] and lines[0] == lines[1]


@pytest.mark.parametrize(("size", "doubted"), [(1000.0, True), (10.0, False)])
def test_a_channel_without_unit_that_is_a_thousand_times_as_large_is_doubted(folder, tmp_path, size, doubted):
    other = write(tmp_path / "mm.csv", 5, size=size, units=("velocity", "force [N]"))
    shown = run("validate", folder / "plain/model.json", other).output
    assert ("'velocity' states no unit and reaches" in shown) == doubted


# -- constant scheduling -------------------------------------------------------------------------------------------
def test_a_current_that_moves_by_its_noise_is_constant(folder):
    shown = run("identify", folder / "steady.csv", *IO, "--schedule", "current", code=2).output
    assert "'current' is constant over the whole data set: got 0.8 ±" in shown
    assert "constant-scheduling" in run("inspect", folder / "steady.csv").output


# -- short records -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("share", "left"), [("0.999", 1), ("0.998", 2)])
def test_the_share_held_out_is_named_where_it_leaves_too_few_samples(folder, share, left):
    shown = run("identify", folder / "run.csv", *IO, "--hold-out", share, code=2).output
    assert f"--hold-out {share} leaves {left} of 1200 samples" in shown and "gaps" not in shown


def test_the_rate_is_named_where_it_leaves_too_few_samples(tmp_path):
    shown = run("identify", write(tmp_path / "short.csv", n=60), *IO, "--sample-rate", 12, code=2).output
    assert "--sample-rate 12 leaves 4 of 60 samples, measured at 200 Hz" in shown and "choose a higher rate" in shown


def test_records_that_are_short_by_themselves_are_no_fault_of_an_option(tmp_path):
    shown = run("identify", write(tmp_path / "short.csv", n=5), *IO, code=2).output
    assert "--hold-out" not in shown and "--sample-rate" not in shown


# -- options ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("more", [("--affine",), ("--affine-terms", 2), ("--affine", "--affine-terms", 2)])
def test_affine_terms_and_no_constant_exclude_each_other(folder, more):
    shown = run("identify", folder / "run.csv", *IO, "--schedule", "current", "--no-constant", *more, code=2).output
    assert "exclude each other" in shown


def test_a_rate_without_scheduling_has_no_effect(folder):
    shown = run("stability", folder / "plain/model.json", "--rate", 3).output
    assert "the rate has no effect: nothing schedules this model" in shown
    assert "no effect" not in run("stability", folder / "plain/model.json").output


def test_the_gain_has_a_unit(folder, tmp_path):
    shown = run("stability", folder / "plain/model.json", "--gain", "--out", tmp_path).output
    assert "induced gain [N/(m/s)]: " in shown
    assert "N/(m/s)" in (tmp_path / "report.html").read_text()


def test_a_name_that_is_a_word_of_c_is_not_replaced_in_silence(folder, tmp_path):
    shown = run("export", folder / "plain/model.json", "--to", "csv", "--name", "int", "--out", tmp_path).output
    assert "'int' is a word of C, Python or MATLAB" in shown and "int_model" in shown


def test_a_rate_that_an_export_does_not_use_is_noted(tmp_path):
    law = lpv.LPVTransferFunction.siso([], [[2.0]], lpv.Polynomial(), 0.01)
    shown = run("export", lpv.save(law, tmp_path / "law.json"), "--to", "csv", "--sample-rate", 100).output
    assert "the sample rate of 100 Hz changes nothing: a static law has no states" in shown
    motion = lpv.LPVStateSpace([[[-1.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], lpv.Polynomial(), 0.01)
    shown = run("export", lpv.save(motion, tmp_path / "m.json"), "--to", "csv", "--sample-rate", 100).output
    assert "changes nothing" not in shown


def test_a_role_with_a_space_is_quoted_in_the_mend(folder):
    record = lpv.Record({"velocity": [0.0, 1.0]}, sample_time=0.1)
    with pytest.raises(lpv.InputError, match="--role 'motor current=CHANNEL'"):
        record.resolve("motor current")
    with pytest.raises(lpv.InputError, match="--role force=CHANNEL"):
        record.resolve("force")


# -- divergence ------------------------------------------------------------------------------------------------------
def test_an_unstable_identified_model_is_exported_with_a_warning(folder, tmp_path):
    found = lpv.load(folder / "plain/model.json")
    unstable = found.replace(a=np.full_like(found.a, -1.05))
    for file, words in ((folder / "plain/model.json", False), (lpv.save(unstable, tmp_path / "u.json"), True)):
        shown = run("export", file, "--to", "csv").output
        assert ("this model is NOT stable: largest frozen pole modulus 1.05" in shown) == words


@pytest.mark.seconds
@pytest.mark.parametrize("run_of_it", [Figures("free-run", None, None, None, "N", 1200, diverged_at=772),
                                       Figures("free-run", 1.2, -9.5, 80.0, "N", 1200)])
def test_a_free_run_that_is_none_of_the_training_data_is_a_shortfall(folder, tmp_path, monkeypatch, run_of_it):
    whole = modelling.fit

    def fit(*arguments):
        reported = whole(*arguments)
        training = reported.found.training
        worse = replace(training, overall=replace(training.overall, free_run=run_of_it))
        return replace(reported, found=reported.found.replace(training=worse))

    monkeypatch.setattr(modelling, "fit", fit)
    shown = run("identify", folder / "run.csv", *IO, "--hold-out", "1/3", "--out", tmp_path / "m", code=3).output
    assert "the model cannot simulate the data that it was fitted to" in shown
    assert json.loads((tmp_path / "m/identification.json").read_text())["doubt"].startswith("the model cannot simulate")


def test_the_delay_is_said_to_be_chosen_on_another_structure(folder):
    words = ("--input", "velocity", "--output", "force", "--order", 1, "--structure")
    assert "errors of ARX models of these lags" in run("identify", folder / "run.csv", *words, "subspace").output
