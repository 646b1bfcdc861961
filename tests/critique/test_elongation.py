"""What is said of the elongation along the tube: of segments that are known, and of no others."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import xarray as xr

from rfea_vision.artefacts.measurement import Recording
from rfea_vision.critique.elongation import describe_elongation
from rfea_vision.vision.curve import COEFFICIENTS
from rfea_vision.vision.derive.elongation import elongation_of

HALF_MM, LENGTH_MM, SEGMENTS = 6.0, 80.0, 16


def elongation(kinked_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Elongation and standard error (1, 16) of a line of 80 mm that leaves its clamp squarely and at once goes aside."""
    knots = np.linspace(-1, COEFFICIENTS - 2, COEFFICIENTS) / (COEFFICIENTS - 3)
    aside = np.where(knots > 0.08, kinked_mm, 0.0) + 4.0 * knots**2
    line = np.stack([aside, -LENGTH_MM * knots], axis=-1)[None]
    nothing = SimpleNamespace(rotation=lambda places, _: np.zeros((1, *places.shape[:2])))
    still = SimpleNamespace(turned_over=np.zeros_like)
    noise = np.full((1, SEGMENTS), 1e-8)
    found = elongation_of(SEGMENTS, line, 1.0, noise, np.array([LENGTH_MM]), HALF_MM, nothing, still)
    return found[0], found[2]


def test_an_elongation_where_the_line_bends_within_its_own_half_width_is_not_known():
    """Of an arm that a clip let turn, -95 and +103 % were told next to it, with standard errors of 6 %."""
    smooth, sure = elongation(0.0)
    assert np.abs(smooth).max() < 0.05 and sure.max() < 0.01
    kinked, sigma = elongation(9.0)
    off = np.abs(kinked[0]) > 0.4
    assert off.any() and np.all(sigma[0, off] > 0.4)
    assert np.all(np.abs(kinked[0, 8:]) < 0.05) and sigma[0, 8:].max() < 0.01, "far from it all is as it was"


def told(elongation: list[float], sigma: list[float]) -> str:
    """The sentence on a run whose segments are stretched so, in every frame of a slow rise."""
    time, frames = np.arange(200) / 100.0, np.ones((200, 1))
    data = xr.Dataset(
        {
            "elongation": (("time", "segment"), frames * elongation),
            "elongation_sigma": (("time", "segment"), frames * sigma),
            "pressure": (("log_time",), np.linspace(0, 20, 200)),
            "valid": (("time",), np.ones(200, dtype=np.int8)),
            "reason": (("time",), np.full(200, "")),
            "tip": (("time", "xy"), np.zeros((200, 2))),
        },
        coords={"time": time, "log_time": time},
        attrs={"experiment": "one", "role": "train"},
    )
    predictions: Any = {"one": xr.Dataset({"elongation": (("time", "joint"), np.full((200, 3), 0.1))})}
    return describe_elongation({"one": Recording(data)}, predictions)["sentence"]


def test_what_is_not_known_is_not_told_of():
    said = told([-0.9, 0.9, 0.1, 0.1, 0.1, 0.1], [0.9, 0.9, 0.02, 0.02, 0.02, 0.02])
    assert "10.0 to 10.0 %" in said and "over the 4 that are known of 6 segments of one" in said
    assert "not known anywhere" in told([-0.9, 0.9, 0.1], [0.9, 0.9, 0.9])
    said = told([0.0, 0.1, 0.2], [0.02, 0.02, 0.02])
    assert "is not uniform: 0.0 to 20.0 %" in said and said.endswith("over 3 segments of one.")
