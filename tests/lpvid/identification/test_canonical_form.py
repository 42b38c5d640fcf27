"""A canonical form estimated in its own entries: known systems come back, gradients are exact, no fit gets worse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.identification import form_refit
from lpvid.identification.canonical_form import CanonicalForm
from lpvid.identification.form_layout import form_layout
from lpvid.identification.staged_search import StagedData, StagedLayout
from lpvid.identification.state_space_layout import stacks
from lpvid.model.input_stage import TanhStage, ThreeZoneStage
from lpvid.model.scheduling_stage import SchedulingLag

BASIS = lpv.Polynomial("p", degree=1)
BOX = lpv.Scheduling(("p",), (-1.0,), (1.0,))


def transfer_function(stage=None, lag=None, direct: bool = False, affine: bool = False) -> lpv.LPVTransferFunction:
    b = [[0.4, 0.1] if direct else [0, 0], [1.0, 0.5], [0.3, -0.4]]
    if isinstance(stage, TanhStage):
        b = [[row, [-0.5 * x for x in row]] for row in b]
    else:
        b = [[row] for row in b]
    c = np.array([[[0.2, 0.5]], [[0.1, -0.3]]]) if affine else None
    return lpv.LPVTransferFunction(np.array([[-1.0, 0.4], [0.5, -0.3]])[:, None, None, :], np.array(b)[:, None], BASIS,
                                   0.01, BOX, c, input_stage=stage, scheduling_stage=lag, inputs=("u",), outputs=("y",))


def record(seed: int, n: int = 2500, period: int = 1) -> lpv.Record:
    rng = np.random.default_rng(seed)
    p = np.repeat(rng.uniform(-1, 1, n // period + 1), period)[:n]
    p[:2] = -1.0, 1.0
    return lpv.Record({"u": rng.normal(size=n), "p": p, "y": np.zeros(n)}, sample_time=0.01)


def measured(model, seed: int, noise: float = 0.0, n: int = 2500) -> lpv.Record:
    run = record(seed, n)
    y = lpv.simulate(model, run, "zero").output[:, 0]
    y = y + noise * y.std() * np.random.default_rng(seed + 100).normal(size=n)
    return lpv.Record({"u": run["u"], "p": run["p"], "y": y}, sample_time=0.01)


STAGES = {
    "none": (None, None),
    "tanh": (TanhStage(v0=0.8, slope=0.2), None),
    "three zones": (ThreeZoneStage(limit=0.6, limit_slope=0.2, upper=0.2, upper_slope=0.05, lower=0.3), None),
    "lag": (None, SchedulingLag(tau_rise=0.01, tau_fall=0.03)),
    "all": (ThreeZoneStage(limit=0.6, limit_slope=0.2, upper=0.2, lower=0.3), SchedulingLag(tau_rise=0.01, delay=0.004,
                                                                                          with_delay=True)),
}


@pytest.mark.parametrize("stages", STAGES)
@pytest.mark.parametrize("form", ["controllable", "observable"])
@pytest.mark.parametrize(("direct", "affine"), [(False, False), (True, True)])
def test_sensitivities_are_those_of_finite_differences(form, stages, direct, affine):
    """Every column of the Jacobian, stages included, against central differences of the run from a given state."""
    from lpvid._state_space_kernels import predictor_run, sensitivity_rows

    realized = lpv.realize(transfer_function(*STAGES[stages], direct, affine), form)
    model, run = realized.model, measured(realized.model, 0, 0.1, 60)
    layout = StagedLayout.of(form_layout(realized), model)
    data = StagedData.following([run], model, layout)
    x0 = np.random.default_rng(1).normal(size=model.order)

    def output(theta):
        moved = layout.fill(model, theta)
        phi, u, y = data.at(moved).pieces[0]
        out = np.zeros_like(y)
        assert predictor_run(stacks(moved), phi, u, y, x0.copy(), 0, data.limit, out, np.zeros((0, 1, x0.size))) == -1
        return (out * data.weight).ravel()

    theta, step = layout.read(model), 1e-6
    numeric = np.column_stack([(output(theta + step * d) - output(theta - step * d)) / (2 * step)
                               for d in np.eye(theta.size)])
    (phi, u, y), (d_phi, d_u) = data.at(model).pieces[0], data.tangents(model)[0]
    block, nx = np.zeros((x0.size + theta.size + 1, len(y))), x0.size
    moved = np.hstack([np.eye(nx), np.zeros((nx, theta.size))])
    sensitivity_rows(stacks(model), phi, u, y, np.array(layout.table), data.weight, x0.copy(), moved, 0, len(y), block,
                     d_phi, d_u)
    np.testing.assert_allclose(block[nx:-1].T, numeric, atol=2e-6 * max(1.0, np.abs(numeric).max()))


@pytest.mark.parametrize("form", ["controllable", "observable"])
@pytest.mark.parametrize("affine", [False, True])
def test_the_layout_reaches_the_form_as_realised(form, affine):
    realized = lpv.realize(transfer_function(TanhStage(), None, True, affine), form)
    layout = form_layout(realized)
    again = layout.fill(realized.model, layout.read(realized.model))
    for name in ("A", "B", "C", "D", "state_offset", "output_offset"):
        np.testing.assert_array_equal(getattr(again, name), getattr(realized.model, name))
    moved = layout.fill(realized.model, layout.read(realized.model) + 0.01)
    fixed = "B" if form == "controllable" else "C"
    np.testing.assert_array_equal(getattr(moved, fixed), getattr(realized.model, fixed))


@pytest.mark.thinned(3)
@pytest.mark.parametrize("form", ["controllable", "observable"])
@pytest.mark.parametrize("stages", STAGES)
def test_a_known_form_comes_back(form, stages):
    """Data of a model in canonical form; the search begins at a transfer function identified from them."""
    stage, lag = STAGES[stages]
    true = lpv.realize(transfer_function(stage, lag), form).model
    start = None if stage is None else stage.with_vector(1.15 * stage.vector)
    begin = lpv.identify(measured(true, 0), lpv.ARX(2, 2, 1, "u", "y", BASIS, stage=start, schedule_filter=lag)).model
    found = lpv.identify(measured(true, 0), CanonicalForm(begin, form), held_out=[measured(true, 1)])
    assert found.held_out.overall.free_run.esr < 1e-8
    assert lpv.validate(begin, [measured(true, 1)]).overall.free_run.esr > 0.01
    for p in (-0.8, 0.1, 0.9):
        np.testing.assert_allclose(found.model.frozen([p])[0], true.frozen([p])[0], atol=2e-4)
    if stage is not None:
        np.testing.assert_allclose(found.model.input_stage.vector, stage.vector, atol=2e-3)


@pytest.mark.seconds
@pytest.mark.parametrize("form", ["controllable", "observable"])
def test_never_worse_than_the_form_as_realised(form):
    """Training data of the transfer function itself: its form cannot match them, and must not do worse than before."""
    plant = transfer_function(ThreeZoneStage(limit=0.6, upper=0.3, lower=0.3), SchedulingLag(0.02, 0.02), True, True)
    refit = lpv.refit_form(plant, measured(plant, 0, 0.1, 1200), form=form, held_out=measured(plant, 1, 0.1, 1200))
    before, after = refit.esr("form as realised"), refit.esr("form re-estimated")
    assert after < before and refit.esr("form re-estimated", "held-out") < refit.esr("form as realised", "held-out")
    held = lpv.refit_form(plant, measured(plant, 0, 0.1, 1200), form=form, stages=False)
    assert after <= held.esr("form re-estimated") <= before
    assert held.model.input_stage == plant.input_stage
    assert refit.model.metadata["realization"] == {"form": form, "refitted": True, "causal": True}
    assert "as realised not safe when the scheduling moves" in str(refit) or "costs" in str(refit)


def test_a_form_that_equals_its_transfer_function_is_refused():
    with pytest.raises(InputError, match="no parameters of its own"):
        CanonicalForm(transfer_function(), "augmented")
    with pytest.raises(InputError, match="which form"):
        lpv.refit_form(transfer_function(), record(0))
    with pytest.raises(InputError, match="another form"):
        lpv.refit_form(lpv.realize(transfer_function(), "observable"), record(0), form="controllable")
    with pytest.raises(InputError, match="equations cannot determine"):
        lpv.identify(measured(transfer_function(), 0, 0.1, 8), CanonicalForm(transfer_function()))


def test_a_start_that_diverges_is_drawn_in():
    true = lpv.realize(transfer_function(), "controllable").model
    wild = transfer_function().replace(a=1.6 * transfer_function().a)
    found = lpv.identify(measured(true, 0), CanonicalForm(wild))
    assert found.training.overall.free_run.esr < 1e-6


def test_the_file_keeps_the_figures(tmp_path):
    true = lpv.realize(transfer_function(), "controllable").model
    refit = lpv.refit_form(transfer_function(), measured(true, 0, 0.05), form="controllable")
    lpv.save(refit.model, tmp_path / "state_space.json")
    again = lpv.load(tmp_path / "state_space.json")
    assert again.metadata["free_run"]["form re-estimated"]["training"]["esr"] == refit.esr("form re-estimated")
    assert refit.found.standard_errors.shape == (refit.found.layout.size,)


def test_a_form_that_runs_worse_than_as_realised_says_from_which_states_it_does_not():
    plant = transfer_function(ThreeZoneStage(limit=0.6, upper=0.3, lower=0.3), SchedulingLag(0.02, 0.02), True, True)
    data = measured(plant, 0, 0.1, 1200)
    refit = lpv.refit_form(plant, data, form="controllable", stages=False)
    assert refit.remark == ""
    figures = dict(refit.figures)
    figures["form as realised"], figures["form re-estimated"] = (figures[n] for n in ("form re-estimated",
                                                                                     "form as realised"))
    run = lpv.simulate(refit.model, data, "estimate").output[:, 0]
    y = data[refit.model.outputs[0].name]
    esr = np.sum((run - y) ** 2) / np.sum((y - y.mean()) ** 2)
    stated = form_refit._remark(replace(refit, figures=figures), [data])
    assert "runs worse than as realised" in stated and f"training {esr:.4g}" in stated


def test_the_stages_slopes_are_derivatives():
    rng = np.random.default_rng(0)
    u, p = rng.normal(size=(200, 2)), rng.uniform(-1, 1, (200, 1))
    for stage in (TanhStage(0.4, 0.9), TanhStage(0.4, 0.0), ThreeZoneStage(0.5, 0.8, 0.2, 0.1, 0.3, -0.1, channel=1)):
        step, vector = 1e-6, stage.vector
        numeric = np.stack([(stage.with_vector(vector + step * d).apply(u, p)
                             - stage.with_vector(vector - step * d).apply(u, p)) / (2 * step)
                            for d in np.eye(vector.size)], axis=2)
        np.testing.assert_allclose(stage.slopes(u, p), numeric, atol=1e-7)
