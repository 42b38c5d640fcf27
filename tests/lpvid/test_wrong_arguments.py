"""Wrong arguments of the public verbs end with one line that says what to give, and no traceback of the inside."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.errors import InputError

RNG = np.random.default_rng(5)
U, P = RNG.normal(size=200), RNG.uniform(0, 2, 200)
RECORD = lpv.Record({"u": U, "p": P, "y": np.r_[0.0, U[:-1]] * (1 + P) + 0.01 * RNG.normal(size=200)}, sample_time=0.01)
ORDERS = {"na": 1, "nb": 1, "input": "u", "output": "y"}
FOUND = lpv.identify(RECORD, lpv.ARX(**ORDERS, basis=lpv.Polynomial("p", degree=1)))
MODEL = FOUND.model

HOLDERS = {
    "simulate": lambda held: lpv.simulate(held, RECORD), "predict": lambda held: lpv.predict(held, RECORD),
    "validate": lambda held: lpv.validate(held, RECORD), "certify_stability": lpv.certify_stability,
    "pole_locus": lpv.pole_locus, "critical_scheduling": lpv.critical_scheduling,
    "frozen_stability": lpv.frozen_stability, "largest_range": lpv.largest_range, "largest_rate": lpv.largest_rate,
}
WRONG = {
    "a name for a basis": (lambda: lpv.ARX(**ORDERS, basis="p"), r'lpv.Polynomial\("p", degree=1\)'),
    "a class for a structure": (lambda: lpv.identify(RECORD, lpv.ARX), r"the class ARX.*ARX\(\.\.\.\)"),
    "one horizon": (lambda: lpv.validate(MODEL, RECORD, horizons=3), r"horizons=\(3,\)"),
    "bounds without names": (lambda: lpv.OutputError(**ORDERS, bounds=5), "by parameter name"),
    "an unnamed held input": (lambda: lpv.exportable(MODEL, lpv.export.contract.Options(at=1.0)), "go by name"),
    "a band of no draws": (lambda: lpv.free_run_band(FOUND, RECORD), "found.draw"),
    "several records": (lambda: lpv.simulate(MODEL, [RECORD, RECORD]), "one record: got 2"),
    "models without names": (lambda: lpv.compare_models([MODEL], RECORD), "by name"),
    "a transfer function to reduce": (lambda: lpv.reduce_order(MODEL, 1), "lpv.realize"),
    "an identification to refit": (lambda: lpv.refit_form(FOUND, RECORD, form="controllable"), "its .model"),
    "one candidate": (lambda: lpv.select(RECORD, lpv.ARX(**ORDERS)), "several structures"),
    "one frozen system": (lambda: lpv.from_control(MODEL.to_control(at=1.0), at=[1.0]), "a list of systems"),
    "a name for a model's basis": (lambda: lpv.LPVTransferFunction.siso([[-0.5]], [[1.0]], "p", 0.1), "lpv.Polynomial"),
    "an unknown variable": (lambda: MODEL.to_control(at={"q": 1.0}), "no scheduling variable 'q'"),
    "a variable left out": (lambda: MODEL.to_control(at={}), "add p"),
    "a misspelt unit": (lambda: lpv.Record({"velocity": U, "force": U}, 0.1, units={"velocty": "mm/s", "force": "N"}),
                        "did you mean 'velocity'"),
}


@pytest.mark.parametrize("held", [FOUND, lpv.realize(MODEL)], ids=["identification", "realization"])
@pytest.mark.parametrize("verb", HOLDERS)
def test_what_holds_a_model_is_no_model(verb, held):
    with pytest.raises(InputError, match=r"give its \.model"):
        HOLDERS[verb](held)


@pytest.mark.parametrize("case", WRONG)
def test_the_message_says_what_to_give(case):
    call, says = WRONG[case]
    with pytest.raises(InputError, match=says) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_columns_serve_where_one_record_does():
    """Simulation and prediction of a dict, a list of one record and the record itself are the same."""
    columns = {"time": RECORD.times, **{name: RECORD[name] for name in ("u", "p", "y")}}
    for verb in (lpv.simulate, lpv.predict):
        expected = verb(MODEL, RECORD).output
        for given in (columns, [RECORD]):
            np.testing.assert_array_equal(verb(MODEL, given).output, expected)


def test_a_point_by_name_is_the_point():
    two = lpv.LPVTransferFunction.siso([[-0.5, 0.1, 0.2]], [[0, 0, 0], [1, 0, 0]], lpv.Polynomial(("p", "q"), 1), 0.1)
    named, plain = two.to_control(at={"q": 0.3, "p": 1.0}), two.to_control(at=[1.0, 0.3])
    np.testing.assert_array_equal(named.A, plain.A)
    assert named.A[0, 0] == pytest.approx(0.5 - 0.1 - 0.06)


def test_one_variable_needs_no_tuples():
    assert lpv.Scheduling("current", 0.0, 2.5, 100.0, "A") == \
        lpv.Scheduling(("current",), (0.0,), (2.5,), (100.0,), ("A",))


def test_units_of_channels_that_a_record_lacks_are_allowed():
    """One table of units for many records; `force_2` beside `force` is no slip."""
    units = {"velocity": "mm/s", "force": "kN"}
    assert lpv.Record({"velocity": [1.0], "force_2": [1.0]}, 0.1, units=units).unit("force_2") == ""


def test_a_band_along_named_columns_is_that_along_the_record():
    columns = {"time": RECORD.times, **{name: RECORD[name] for name in ("u", "p", "y")}}
    drawn = FOUND.draw(np.random.default_rng(0), 5)
    np.testing.assert_array_equal(lpv.free_run_band(drawn, columns).low, lpv.free_run_band(drawn, RECORD).low)


def test_the_box_of_a_model_without_one():
    assert lpv.LPVTransferFunction.siso([[-0.5, 0.1]], [[0, 0], [1, 0]], lpv.Polynomial("p", 1), 0.1).box == \
        lpv.Scheduling("p", -1.0, 1.0)


def test_figures_without_a_unit_have_no_gap_before_the_comma():
    assert " ," not in str(FOUND) and " )" not in str(FOUND)
