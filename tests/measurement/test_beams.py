"""Films of beams: they bend about their middle, and have no inextensible side by which their length or elongation could be read."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.critique.elongation import describe_elongation
from rfea_vision.vision import advice, track_frames
from testing.sources import memory_source

ROD = Actuator(kind="rod", outer_radius=0.011, inner_radius=0.004, length=0.09, mass_per_length=0.4)
SIZE, PX_PER_MM, CLAMP = (480, 480), 3.6, (340.0, 80.0)


def pictures_of_a_rod(bends_deg):
    """Arcs whose middle keeps its length, under a dark clamp."""
    half, along = 1e3 * ROD.outer_radius * PX_PER_MM, np.linspace(0.0, 1e3 * ROD.length * PX_PER_MM, 200)
    rng = np.random.default_rng(5)
    for bend in np.deg2rad(bends_deg):
        angle = bend * along / along[-1]
        steps = np.column_stack([-np.sin(angle[:-1]), np.cos(angle[:-1])]) * along[1]
        middle = CLAMP + np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        aside = half * np.column_stack([np.cos(angle), np.sin(angle)])
        outline = np.vstack([middle + aside, (middle - aside)[::-1]])
        large = np.full((2 * SIZE[1], 2 * SIZE[0]), 200, np.uint8)
        cv2.fillPoly(large, [np.round(32 * (outline + 0.25)).astype(np.int32)], (60,), cv2.LINE_AA, 4)
        large[: 2 * int(CLAMP[1]), 2 * int(CLAMP[0] - 70) : 2 * int(CLAMP[0] + 70)] = 25
        small = cv2.GaussianBlur(cv2.resize(large, SIZE, interpolation=cv2.INTER_AREA).astype(float), (0, 0), 0.9)
        yield np.clip(small + rng.normal(0.0, 1.5, small.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def film():
    bends = 40.0 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 30)))
    return bends, memory_source(list(pictures_of_a_rod(bends)), np.arange(30) / 30)


def test_the_middle_of_a_beam_is_what_keeps_its_length(film):
    """Its inner side shortens by 17 % at 80 degrees: frames were refused for it, and the scale was doubted."""
    bends, source = film
    track = track_frames(source, scaled_by_distance(SIZE, [[0, 0], [360, 0]], 100.0), ROD).dataset
    assert track["valid"].values.all()
    np.testing.assert_allclose(track["bend_angle"].values, bends, atol=0.7)
    said = track.attrs["length_check"]
    assert said.startswith("the middle keeps its length within 0.") and "against actuator.length" not in said
    assert track.attrs["hinge_length_mm"] == pytest.approx(90.0, rel=0.006)


def test_nothing_is_said_of_a_beams_elongation_without_marks(film):
    """It had been half the width times the curvature, 17 %, while the model, rightly, had none."""
    _, source = film
    track = track_frames(source, scaled_by_distance(SIZE, [[0, 0], [360, 0]], 100.0), ROD)
    assert not [name for name in track.dataset if str(name).startswith("elongation")]
    recording: Any = SimpleNamespace(role="train", dataset=track.dataset)
    told = describe_elongation({"run": recording}, {"run": track.dataset})
    assert told["sentence"].endswith("a beam bends about its middle, and how its parts stretch is told by marks on it alone.")


def test_a_wrong_scale_is_doubted_by_a_beams_middle(film):
    _, source = film
    track = track_frames(source, scaled_by_distance(SIZE, [[0, 0], [360, 0]], 108.0), replace(ROD, outer_radius=0.0119)).dataset
    assert advice.scale_doubt(track.attrs["length_check"]).startswith("the middle measures +8")
