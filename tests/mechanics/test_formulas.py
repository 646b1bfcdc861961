"""Lines of formulas that are written down for the compiler are what Python makes of them."""

import math

import numpy as np
import pytest
from numba import njit, types

from rfea_vision.dynamics import generation
from rfea_vision.dynamics.formulas import formulas, understood
from rfea_vision.dynamics.laws import compose
from rfea_vision.effects.catalogue import catalogue

LINES = """
a = table[j, 1]
_s0 = -4/5*a**3 + shift*pi
_s1 = (_s0 >= a)
_s2 = (1.0 if (a) > 0 else (-1.0 if (a) < 0 else 0.0))
_s3 = ((a) if _s1 else ((1/40)/_s0**2 if (not _s1 and a < 1 or -1 < a < 2) else (sqrt(abs(a)))))
out[j, 0] = _s0
out[j, 2] = ((_s1) if a != 0 else (_s2 == 1.0))
out[j, 3] = exp(-a**2) + tanh(_s3)*abs(a)**(3/2) + atan2(a, 2) + 2**a
out[j, 4] = _s3/(a - table[j, 1])
"""


def test_every_kind_of_line_is_what_python_makes_of_it():
    run = formulas(LINES, "table, shift, out")
    table = np.array([[0.0, value] for value in (-2.5, -1.0, -0.3, 0.0, 0.7, 1.0, 1.9, 40.0)])
    out, expected = np.full((8, 5), 7.0), np.full((8, 5), 7.0)

    @njit(types.void(types.float64[:, ::1], types.float64, types.float64[:, ::1]), error_model="numpy", _nrt=False)
    def compiled(table, shift, out):
        for j in range(len(table)):
            run((table, shift, out), j)

    compiled(table, 0.25, out)
    lines = LINES.rsplit("out[j, 4]", 1)[0]
    for j in range(8):
        exec(lines, {**vars(math), "table": table, "shift": 0.25, "out": expected, "j": j})
    assert out[:, :4] == pytest.approx(expected[:, :4], rel=1e-14, abs=0)
    assert (out[:, 1] == 7.0).all(), "what no line names stays as it was"
    assert not np.isfinite(out[:, 4]).any(), "a division by nought is infinite, and no error"


def test_a_law_is_to_the_bit_what_numba_reads():
    texts = generation.generate(compose(tuple(catalogue()[name]() for name in ("contact", "mullins"))))
    rng = np.random.default_rng(2)
    for loop in ("joint_law", "joint_law_parameters", "body_force"):
        text, made, read, most = texts[loop], {}, {}, 0.0
        exec(text.replace("cache=True", "cache=False"), made)
        _, rest = text.split('run = formulas("""')
        lines, rest = rest.split('"""', 1)
        call = next(line for line in rest.splitlines() if line.lstrip().startswith("run(("))
        rest = rest.split("\n", 1)[1].replace(call, lines.replace("\n", "\n        "))
        exec(generation._HEADER + rest.replace("cache=True", "cache=False"), read)
        for _ in range(50):
            if loop == "body_force":
                given = (rng.normal(size=(5, 4)), rng.uniform(0.01, 0.1, 5))
            else:
                joint = (rng.normal(size=5), rng.normal(size=5), rng.normal(size=(5, 3)), 1e5 * rng.normal())
                given = (*joint, rng.random(5), rng.uniform(0.01, 0.1, 5), rng.random((5, 2)))
            con = np.array([5, 0.004, 0.003, 1000.0, 0.155, 1.0, rng.choice([0.0, 0.004]), 0.03, rng.normal()])
            both = [np.zeros((5, 60) if loop == "joint_law" else (5, 6, 20)) for _ in range(2)]
            par = rng.normal(size=16)
            for law, out in zip((made, read), both, strict=True):
                law[loop](*given, par, con, out)
            assert both[0].tobytes() == both[1].tobytes(), loop
            most = max(most, np.abs(both[0]).max())
        assert most > 0


def test_what_is_not_understood_is_left_to_numba():
    assert understood("a = sin(x[0])**2 if x[1] > 0 else -1")
    for line in ("a = lambertw(x)", "a = 'text'", "a = [1, 2]", "a = x.size", "for", "a = max(x[0], 1)", "a = getattr(1)"):
        assert not understood(line), line
    assert all(
        "run = formulas(" in text
        for name in ("coulomb", "hysteresis", "radial_expansion")
        for loop, text in generation.generate(compose((catalogue()[name](),))).items()
        if loop.startswith("joint")
    ), "the laws of the catalogue are"
