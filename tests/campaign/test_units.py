import re
from itertools import permutations

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfea_vision.errors import InputError
from rfea_vision.options.given import read_conditions
from rfea_vision.units import _PLAIN_UNITS, conversion_factor, parse_quantity, to_error


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("4 mm", "m", 0.004),
        ("4mm", "m", 0.004),
        ("965 kg/m^3", "kg/m^3", 965.0),
        ("0.965 g/cm^3", "kg/m^3", 965.0),
        ("12 ms", "s", 0.012),
        ("-12 ms", "s", -0.012),
        ("5min", "s", 300.0),
        ("1e-3 m", "mm", 1.0),
        ("240 Hz", "Hz", 240.0),
        ("1 bar", "kPa", 100.0),
        ("5e-7/Pa", "1/Pa", 5e-7),
        (".5 psi", "Pa", 0.5 * 6894.757293168),
    ],
)
def test_quantities_are_converted(text, unit, value):
    assert parse_quantity(text, unit, example="1 mm") == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (4, "4 has no unit; write for example '4 mm'"),
        ("4", "'4' has no unit"),
        ("mm", "not a number with a unit"),
        ("4 mmm", "unknown unit 'mmm'; did you mean 'mm'?"),
        ("4 Millimeter", "unknown unit 'Millimeter'; write one such as mm, cm, m"),
        ("4 kgg", "unknown unit 'kgg'; write one such as mm, cm, m"),
        ("4 kg", "'kg' is not a unit of the right kind; write one that converts to"),
        ("4 MM", "'MM' is not a unit of the right kind; did you mean 'mm'?"),
        ("4,5 mm", "decimal comma; write '4.5 mm'"),
        ("nan mm", "not a number with a unit"),
        ("1e999 mm", "not a finite number"),
        (True, "expected a quantity"),
        (None, "expected a quantity"),
        (["4 mm"], "expected a quantity"),
    ],
)
def test_what_is_wrong_is_said(value, says):
    with pytest.raises(ValueError) as caught:
        parse_quantity(value, "m", example="4 mm")
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("value", "unit", "example", "says"),
    [
        (155, "m", "155 mm", "155 mm"),
        (0.155, "m", "155 mm", "0.155 m"),
        ("15.5", "m", "155 mm", "15.5 cm"),
        (0.965, "kg/m^3", "965 kg/m^3", "0.965 g/cm^3"),
        (-0.5, "deg", "30 deg", "-0.5 rad"),
        (1.013, "kPa", "101.3 kPa", "1.013 bar"),
        (0, "m", "3 mm", "0 mm"),
        (12, "kPa", "0 kPa", "12 kPa"),
        (300, "s", "5min", "300s"),
        (1e999, "m", "3 mm", "3 mm"),
    ],
)
def test_a_bare_number_is_shown_with_the_unit_that_it_probably_has(value, unit, example, says):
    with pytest.raises(ValueError, match=re.escape(f"has no unit; write for example '{says}'")):
        parse_quantity(value, unit, example=example)


@given(st.floats(min_value=-1e6, max_value=1e6, allow_nan=False))
def test_a_quantity_survives_writing_and_reading(value):
    assert parse_quantity(f"{value!r} mm", "mm", example="4 mm") == pytest.approx(value)


@given(st.text(max_size=30))
def test_any_text_is_a_quantity_or_a_sentence(text):
    try:
        assert isinstance(parse_quantity(text, "m", example="4 mm"), float)
    except ValueError as error:
        assert str(error)


def test_factors_convert_there_and_back():
    assert conversion_factor("bar", "kPa") * conversion_factor("kPa", "bar") == pytest.approx(1.0)


def test_units_that_are_known_by_heart_are_those_of_pint():
    registry, known = pint.UnitRegistry(), _PLAIN_UNITS.keys() - {"fps"}  # which are feet per second there
    alike = [pair for pair in permutations(known, 2) if len({_PLAIN_UNITS[unit][0] for unit in pair}) == 1]
    assert len(alike) == 64  # ordered pairs of one kind
    for unit, to in alike:
        truth = registry.Quantity(1.0, unit).to(to).magnitude
        assert conversion_factor(unit, to) == pytest.approx(truth, rel=1e-15, abs=0.0), (unit, to)


def test_frames_per_second_are_a_rate():
    """`rate: 25 fps` was refused: pint's fps are feet per second."""
    assert parse_quantity("25 fps", "Hz", example="240 Hz") == 25.0
    assert conversion_factor("fps", "kHz") == pytest.approx(1e-3) and conversion_factor("fps", "1/min") == pytest.approx(60.0)


def test_a_mass_without_a_unit_is_proposed_in_grams():
    with pytest.raises(InputError, match=r"write for example '10 g'"):
        read_conditions({"payload": 10.0})


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [(-1344406.787, 9.06, "-1344406.8"), (12.3456, 0.05, "12.346"), (1300.0, 64.0, "1300"), (12.3456, 0, "12.3"), (9.0, None, "9.00")],
)
def test_a_value_is_told_to_the_second_digit_of_its_standard_error(value, error, shown):
    """Of a camera whose clock began with the day the offset had been told as -1.34e+06 ms, beside an error of 9."""
    assert to_error(value, error) == shown
