"""Packing, thinning and formatting: small, exact, and reversible within the promised step."""

from __future__ import annotations

import base64
import math
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfea_vision.report.formatting import law, listing, number, unit_text, with_unit
from rfea_vision.report.pack import MISSING, Pack, nearest, stride


def unpack(pack: Pack, address: dict) -> np.ndarray:
    block = zlib.decompress(base64.b64decode(pack.base64()))
    whole = np.frombuffer(block, "<i2", math.prod(address["shape"]), address["at"]).astype(float)
    whole[whole == MISSING] = np.nan
    return (address["zero"] + address["step"] * whole).reshape(address["shape"])


@given(st.lists(st.floats(-1e6, 1e6) | st.just(math.nan), min_size=1, max_size=50))
def test_packing_is_reversible(values: list[float]) -> None:
    pack = Pack()
    pack.add([1.0, 2.0, 3.0])
    address = pack.add(values)
    back, array = unpack(pack, address), np.array(values)
    finite = array[np.isfinite(array)]
    step = (finite.max() - finite.min()) / 65000 if finite.size else 0.0
    np.testing.assert_allclose(
        back, array, atol=0.51 * step + 1e-9 * (1 + np.abs(finite).max(initial=0)), equal_nan=True
    )


@given(st.integers(0, 5000), st.integers(1, 900))
def test_stride_keeps_the_first_row_and_no_more_than_asked(count: int, most: int) -> None:
    rows = stride(count, most)
    assert len(rows) <= most
    assert (len(rows) == 0) == (count == 0)
    assert len(rows) == 0 or rows[0] == 0


@given(st.lists(st.floats(0, 100), min_size=1, max_size=40).map(sorted), st.floats(-5, 105))
def test_nearest_is_nearest(times: list[float], wanted: float) -> None:
    array = np.array(times)
    row = nearest(array, np.array([wanted]))[0]
    assert abs(array[row] - wanted) == np.abs(array - wanted).min()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0829, "0.0829"),
        (5.7349, "5.73"),
        (-41200.0, "−41200"),
        (0.0, "0"),
        (None, "–"),
        (math.nan, "–"),
        (1e-300, "1.00·10⁻³⁰⁰"),
        (9.999, "10.0"),
        (0.09998, "0.100"),
    ],
)
def test_numbers_as_people_read_them(value: float | None, text: str) -> None:
    assert number(value) == text


def test_units() -> None:
    assert unit_text("N*m/rad**2") == "N m/rad²"
    assert unit_text("Pa s^2/m^3") == "Pa s²/m³"
    assert with_unit(0.5, "1") == "0.500"
    assert with_unit(None, "mm") == "–"
    assert listing(["a", "b", "c"]) == "a, b and c"


@pytest.mark.parametrize(
    "latex",
    [
        r"\dot{z} = \frac{\theta - z}{T}",
        r"\tau_{j} = - k_{1} \tanh{\left(\frac{\dot\theta}{w} \right)}",
        r"\left|{x}\right|^{2}",
    ],
)
def test_laws_are_typeset(latex: str) -> None:
    assert law(latex).startswith("<math")


def test_a_law_of_two_lines_is_two_equations() -> None:
    assert law(r"a = b \\ c = d").count("<math") == 2
    assert law("") == ""


def test_a_law_that_cannot_be_typeset_is_shown_as_it_is() -> None:
    assert "<" not in law(r"\left( <b>").replace("<code>", "").replace("</code>", "").split("math")[0]
    assert law("") == ""
