"""Units: the table against pint, readable SI text, refusals."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lpvid import units
from lpvid.errors import InputError
from lpvid.units import contradicts, convert, parse_header, quantity_to_si, same_kind, to_si

REGISTRY = pint.UnitRegistry()
NOT_IN_PINT = {"", "-"}  # spellings of a pure number
ESU = {"gauss"}  # pint keeps Gaussian units apart; 1 gauss is 1e-4 T


@pytest.mark.parametrize("text", sorted(set(units._SCALES) - NOT_IN_PINT - ESU))
def test_every_table_entry_agrees_with_pint(text):
    for value in (0.0, 1.0, -37.5):
        ours = to_si([value], text)
        theirs = REGISTRY.Quantity(value, text).to_base_units()
        stated = REGISTRY.Quantity(1.0, ours.unit or "dimensionless").to_base_units()
        assert ours.known
        assert theirs.units == stated.units
        assert ours.values[0] * stated.magnitude == pytest.approx(theirs.magnitude, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("text", sorted(units._SCALES))
def test_the_si_text_reads_back_as_itself(text):
    once = to_si([2.0], text)
    again = to_si(once.values, once.unit)
    assert again.unit == once.unit
    assert again.values[0] == once.values[0]


def test_gauss():
    assert to_si([5.0], "gauss").values[0] == 5e-4
    assert to_si([5.0], "gauss").unit == "T"


@pytest.mark.parametrize("text, unit, factor", [
    ("lbf*s/in", "N*s/m", 4.4482216152605 / 0.0254), ("ft*lbf", "N*m", 0.3048 * 4.4482216152605),
    ("L/min", "m^3/s", 1e-3 / 60), ("mph", "m/s", 1609.344 / 3600), ("K/min", "K/s", 1 / 60),
    ("N*m*s/deg", "N*m*s/rad", 180 / np.pi), ("m s⁻²", "m/s^2", 1.0), ("kNs/m", "N*s/m", 1e3),
    ("mNm", "N*m", 1e-3), ("kN·s/m", "N*s/m", 1e3), ("µm", "m", 1e-6), ("°/s", "rad/s", np.pi / 180),
    ("ppm", "", 1e-6), ("kΩ", "ohm", 1e3), ("mm / s", "m/s", 1e-3), ("m**2", "m^2", 1.0),
])
def test_units_beyond_the_table(text, unit, factor):
    ours = to_si([1.0, 2.0], text)
    assert (ours.unit, ours.known) == (unit, True)
    np.testing.assert_allclose(ours.values, [factor, 2 * factor], rtol=1e-12)


@pytest.mark.parametrize("text", ["raw", "foo", "dB", "a.u.", "5 m", "9**9**9**9", "((9**99)**99)**99", "m**(9**9)",
                                  "1e400", "__import__('os')", "m" * 200, "m/", "(", "[", "0", "nan", "m 0"])
def test_what_nobody_knows_stays_a_number(text):
    ours = to_si([1.0, np.nan], text)
    assert (ours.unit, ours.known) == ("", False)
    np.testing.assert_array_equal(ours.values, [1.0, np.nan])


def test_a_missing_unit_is_si():
    assert to_si([4.0], None).known
    assert to_si([4.0], None).unit == ""


@pytest.mark.parametrize("text, expected", [
    ("force [N]", ("force", "N")), ('  "motor current [mA]" ', ("motor current", "mA")), ("p1", ("p1", None)),
    ("x []", ("x", "")), ("F[ kN ]", ("F", "kN")), ("force (N)", ("force", "N")), ("a [b] c", ("a [b] c", None)),
    ("force (filtered)", ("force (filtered)", None)), ("Time (s)", ("Time", "s")), ("run (2)", ("run (2)", None)),
    ("[N]", ("", "N")), ("", ("", None)), ("F [N] [kN]", ("F [N]", "kN")),
    ("Velocity / (m/s)", ("Velocity", "m/s")), ("Weg / mm", ("Weg", "mm")), ("Winkel / °", ("Winkel", "°")),
    ("valve (%)", ("valve", "%")), ("angle (°)", ("angle", "°")), ("F/N", ("F/N", None)), ("a / b", ("a / b", None)),
    ("L / R", ("L / R", None)), ("force (a)", ("force (a)", None)), ("force (b)", ("force (b)", None)),
    ("R (Ω)", ("R", "Ω")), ("mass (t)", ("mass", "t")), ("rig / force / N", ("rig / force / N", None)),
])
def test_header(text, expected):
    assert parse_header(text) == expected


@pytest.mark.parametrize("value, expected", [
    ("5 mm", (0.005, "m")), ("5mm", (0.005, "m")), ("-1.5e3 N", (-1500.0, "N")), ("2.5", (2.5, "")), (7, (7.0, "")),
    (".5 %", (0.005, "")), ("20 degC", (293.15, "K")), ("1e-3 V*s/m", (1e-3, "N/A")), ("25.4 mm", (0.0254, "m")),
])
def test_settings(value, expected):
    assert quantity_to_si(value) == expected


@pytest.mark.parametrize("value", ["", "mm", "5 foo", "inf m", float("nan"), True, None, "5 5", [1], "1e999",
                                   "5 m m kg x"])
def test_nonsense_settings_are_refused(value):
    with pytest.raises(InputError):
        quantity_to_si(value)


def test_a_setting_of_the_wrong_kind_is_refused():
    assert quantity_to_si("5 km/h", unit="m/s")[0] == pytest.approx(5 / 3.6)
    assert quantity_to_si(5, unit="mm") == (5.0, "m")
    for value, unit in (("5 N", "m"), ("5 Hz", "rad/s"), ("5 m", "")):
        with pytest.raises(InputError, match="wanted"):
            quantity_to_si(value, unit=unit)


def test_kinds():
    assert same_kind("N*s/m", "kg/s")
    assert same_kind("J", "N*m")
    assert same_kind("1/s", "Hz")
    assert not same_kind("Hz", "rad/s")
    with pytest.raises(InputError, match="cannot convert"):
        convert(1.0, "Hz", "rad/s")
    with pytest.raises(InputError, match="unknown unit"):
        convert(1.0, "foo", "m")


@pytest.mark.seconds
@given(st.floats(-1e9, 1e9), st.sampled_from(sorted(units._SCALES)))
def test_there_and_back(value, text):
    there = convert(value, text, units._SCALES[text].unit)
    back = convert(there, units._SCALES[text].unit, text)
    assert back == pytest.approx(value, rel=1e-12, abs=1e-9)


@pytest.mark.seconds
@settings(max_examples=30)
@given(st.text(max_size=40))
def test_any_text_is_a_unit_or_is_not(text):
    ours = to_si([1.0], text)
    assert ours.known or ours.unit == ""
    assert np.isfinite(ours.values).all()


def test_common_units_do_not_load_pint():
    code = "import sys; from lpvid.units import to_si; to_si([1.0], 'mm/s'); assert 'pint' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", ["acceleration", "body_acceleration", "wheel acc", "Accel"])
def test_an_acceleration_in_g_is_not_one_in_grams(name):
    """[g] is the gram; as a mass the channel was a thousandth of its number, and the model's unit kg."""
    import lpvid as lpv

    t = np.arange(400) / 200
    def columns(unit):
        return {"time [s]": t, f"{name} [{unit}]": np.sin(20 * t), "force [N]": np.cos(20 * t)}
    structure = lpv.ARX(na=1, nb=1, nk=0, input=name, output="force")
    with pytest.raises(InputError, match=r"\[g_0\]"):
        lpv.identify(columns("g"), structure)
    assert "g_0" in next(f.mend for f in lpv.audit(columns("g")).findings if f.name == "unit-contradicts-name")
    assert lpv.identify(columns("g_0"), structure).model.inputs[0].unit == "m/s^2"


@pytest.mark.parametrize("name, unit", [("acceleration sprung", "g"), ("acc z", "g"), ("Beschleunigung", "g"),
                                        ("ACC_FL", "mg"), ("z body", "g"), ("sprung acceleration", "kg"),
                                        ("massAcc", "g"), ("payload acceleration", "g"), ("loadAcc2", "g"),
                                        ("Aufbaubeschleunigung", "kg"), ("bodyAccel", "kg")])
def test_grams_are_masses_only_where_the_name_says_so(name, unit):
    assert "m/s^2" in contradicts(name, "kg", unit)


@pytest.mark.parametrize("name, unit", [("payload", "g"), ("mass of oil", "g"), ("Zuladung", "g"), ("Radlast", "g"),
                                        ("z body", "kg"), ("accumulator mass", "g"), ("accelerated mass", "kg"),
                                        ("accelerated mass", "g"), ("accelerator pedal", "kg"), ("acc mass", "kg"),
                                        ("mass_acceleration_channel", "kg")])
def test_masses_stay_masses(name, unit):
    assert contradicts(name, "kg", unit) == ()


@pytest.mark.parametrize("unit", ["g", "mg"])
def test_a_name_that_says_neither_mass_nor_acceleration_is_told_so(unit):
    import lpvid as lpv

    t = np.arange(400) / 200
    columns = {"time [s]": t, f"specimen [{unit}]": np.sin(20 * t), "force [N]": np.cos(20 * t)}
    mend = rf"\[{unit}\] may be grams or gravity: write \[{unit}_0\].*name the channel as a mass"
    with pytest.raises(InputError, match="two meanings.*neither mass nor acceleration.*" + mend):
        lpv.identify(columns, lpv.ARX(na=1, nb=1, nk=0, input="specimen", output="force"))
    finding, = (f for f in lpv.audit(columns).findings if f.name == "unit-contradicts-name")
    assert "neither mass nor acceleration" in finding.evidence
    assert re.search(mend, finding.mend)


def test_a_unit_that_contradicts_the_role_names_header_role_and_mend():
    import lpvid as lpv

    t = np.arange(400) / 200
    record = lpv.Record({"x": np.sin(t), "force": np.cos(t)}, time=t, units={"x": "mm", "force": "N"},
                        roles={"velocity": "x"})
    with pytest.raises(InputError, match=r"got 'x \[mm\]'.*role 'velocity' calls for m/s.*--role velocity=CHANNEL"):
        lpv.identify(record, lpv.ARX(na=1, nb=1, input="velocity", output="force"))
    with pytest.raises(InputError, match=r"role 'force' calls for N.*--role force=CHANNEL"):
        lpv.identify(lpv.Record({"v": np.sin(t), "b": np.cos(t)}, time=t, units={"v": "m/s", "b": "mm"},
                                roles={"force": "b"}), lpv.ARX(na=1, nb=1, input="v", output="force"))
