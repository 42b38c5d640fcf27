"""Nouns that draw themselves on the caller's axes, and their cards in a notebook."""

from __future__ import annotations

import base64
import html
import re
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import lpvid as lpv
from lpvid._shown import Shown
from lpvid.errors import InputError, NumericalError
from lpvid.report.stability import study_stability
from lpvid.synthesis.result import Synthesis
from quartercar.controllers import Passive, Skyhook
from quartercar.controllers.contract import Setting
from quartercar.controllers.designed.lpv_hinf import LpvHinf
from quartercar.dampers import Guo, Guo15, PowerLaw
from quartercar.parameters import MEGANE
from quartercar.rides.comparison import compare_rides
from quartercar.rides.default_damper import identified_damper
from quartercar.roads.ride_roads import Bump
from quartercar.vehicle.nonlinear import Coil, QuarterCar


def record() -> lpv.Record:
    rng = np.random.default_rng(2)
    u, p = rng.standard_normal(500), np.linspace(0.0, 1.0, 500)
    y = np.zeros(500)
    for k in range(1, 500):
        y[k] = (0.5 + 0.3 * p[k]) * y[k - 1] + u[k - 1]
    return lpv.Record(channels={"drive": u, "answer": y, "knob": p}, sample_time=0.01, name="<run>",
                      units={"drive": "m/s", "answer": "N", "knob": "A"})


@pytest.fixture(scope="module")
def nouns() -> dict[str, Any]:
    data = record()
    found = lpv.identify(data, lpv.ARX(1, 1, 1, "drive", "answer", lpv.Polynomial("knob", degree=1)))
    fixed = lpv.identify(data, lpv.ARX(1, 1, 1, "drive", "answer"))
    return {"record": data, "audit": lpv.audit(data), "identification": found, "model": found.model,
            "fixed": fixed.model, "state space": lpv.realize(found.model).model,
            "stability": study_stability(found.model), "validation": lpv.validate(found.model, data)}


NOUNS = ("record", "audit", "identification", "model", "fixed", "state space", "stability", "validation")
DRAWN = ("record", "identification", "model", "fixed", "state space")


@pytest.mark.thinned(8, "seconds")
@pytest.mark.parametrize("name", NOUNS)
def test_a_noun_has_a_card_that_is_small_and_escaped(name: str, nouns: dict[str, Any]) -> None:
    assert set(nouns) == set(NOUNS)
    card = nouns[name]._repr_html_()
    assert isinstance(nouns[name], Shown) and len(card) < 150_000
    assert "<run>" not in card and "prefers-color-scheme:dark" in card
    assert html.escape(str(nouns[name]).splitlines()[0]) in card
    pictures = re.findall(r"base64,([^\"]+)\"", card)
    assert len(pictures) == (name in DRAWN)
    assert all(base64.b64decode(p).startswith(b"\x89PNG") for p in pictures)


@pytest.mark.thinned(5, "seconds")
@pytest.mark.parametrize("name", DRAWN)
def test_a_noun_is_drawn_on_new_axes_or_on_given_ones(name: str, nouns: dict[str, Any]) -> None:
    made = nouns[name].plot()
    count = np.size(made)
    given = Figure().subplots(count, 1)
    drawn = nouns[name].plot(given)
    assert all(isinstance(a, Axes) and a.has_data() for a in np.atleast_1d(made))
    assert drawn is given if count == 1 else list(drawn) == list(given)
    assert all(a.get_ylabel().endswith("]") for a in np.atleast_1d(drawn))
    with pytest.raises(InputError, match="axes"):
        nouns[name].plot(Figure().subplots(count + 1, 1))


def test_what_is_text_only_has_nothing_to_draw(nouns: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="nothing to draw"):
        nouns["audit"].plot()


@pytest.mark.parametrize("damper", [Guo(), Guo15(current_range=(0.0, 2.0)), PowerLaw(), identified_damper()])
def test_a_damper_draws_its_force_over_velocity(damper: Any) -> None:
    ax = damper.plot()
    assert ax.get_xlabel() == "velocity [m/s]" and "virtual" in ax.get_title(loc="left")
    force = np.concatenate([line.get_ydata() for line in ax.lines])
    assert np.isfinite(force).all() and np.ptp(force) > 0
    assert "base64" in damper._repr_html_()


@pytest.mark.seconds
def test_runs_and_comparisons_of_laws_are_drawn() -> None:
    car = QuarterCar(parameters=MEGANE, damper=identified_damper(), coil=Coil(highest=2.5))
    found = compare_rides(car, (Bump(duration=0.6),), {"passive": Passive(), "skyhook": Skyhook()}, (0,))
    ax = found.plot()
    assert [t.get_text() for t in ax.texts] == ["passive", "skyhook"] and "base64" in found._repr_html_()
    axes = found.rows[0].rides[0].run.plot()
    assert len(axes) == 4 and axes[-1].get_xlabel() == "time [s]"


def test_a_damper_goes_to_python_control(nouns: dict[str, Any]) -> None:
    import control

    damper, period = Guo(), 1 / 512
    t = period * np.arange(400)
    x = 0.01 * np.sin(2 * np.pi * 2 * t)
    data = lpv.Record(channels={"displacement": x, "velocity": np.gradient(x, period), "force": np.zeros_like(x)},
                      sample_time=period, units={"displacement": "m", "velocity": "m/s", "force": "N"})
    system = damper.to_control(period)
    drive = np.array([data[n] for n in system.input_labels])
    answer = control.input_output_response(system, t, drive).outputs
    np.testing.assert_allclose(np.ravel(answer), damper.simulate(data).output[:, 0], rtol=1e-9, atol=1e-9)
    with pytest.raises(InputError, match="no frozen linear system"):
        lpv.to_control(damper, at=[1.0])
    model = nouns["model"]
    np.testing.assert_allclose(lpv.to_control(model, at=[0.5]).poles(), [0.65], atol=1e-6)


def test_a_law_goes_to_python_control() -> None:
    """Skyhook's demand from the system is that of the law, step by step; a law to be designed first is refused."""
    import control

    law, period = Skyhook(), 1e-3
    system = law.to_control(period)
    assert system.dt == period
    rng = np.random.default_rng(1)
    seen = rng.standard_normal((len(system.input_labels), 200))
    answer = np.ravel(control.input_output_response(system, period * np.arange(200), seen).outputs)
    stepping = law.start(Setting(period, 1, MEGANE))
    own = [stepping.step({n: seen[i, k: k + 1] for i, n in enumerate(system.input_labels)})[0] for k in range(200)]
    np.testing.assert_allclose(answer, own, rtol=1e-9, atol=1e-9)
    with pytest.raises(InputError, match="not yet a controller"):
        LpvHinf().to_control()


@pytest.mark.seconds
def test_a_synthesis_goes_to_python_control_and_has_a_card() -> None:
    a, b = np.array([[[-2.0]], [[-1.0]]]), np.ones((2, 1, 1))
    k = lpv.LPVStateSpace(a, b, b, 0 * b, lpv.Polynomial("rho", degree=1), None)
    found = Synthesis("solved", 1.0, 1.0, 0.5, k, k)
    np.testing.assert_allclose(found.to_control([0.5]).poles(), [-2.5])
    card = found._repr_html_()
    assert "base64" in card and "solved" in card and len(card) < 150_000
    with pytest.raises(NumericalError):
        Synthesis("infeasible", why="no").to_control([0.5])


def test_a_damper_takes_values_with_units() -> None:
    assert Guo(values={"yield_force": "0.6 kN"}).values["yield_force"] == 600.0
    for wrong in ("0.6 m", "many", "3 frobs"):
        with pytest.raises(InputError, match="yield_force"):
            Guo(values={"yield_force": wrong})
