"""Synchronisation of tracked films: time stamps of all kinds, frames shown twice, noise that lasts over frames."""

from dataclasses import replace

import numpy as np
import pytest

from rfea_vision.stages.workspace import open_campaign
from rfea_vision.sync.sections import repeated
from rfea_vision.twin import Stress, TwinOptions, simulate

SMALL = TwinOptions(
    seed=7, duration_s=2.0, joints=8, roles=("train",), kinds=("steps",), video=True, frame_size=(180, 320), photos=6
)


@pytest.mark.parametrize(
    "scene",
    [
        pytest.param(Stress(), id="plain"),
        pytest.param(Stress(vfr=True, dropped=0.04), id="uneven and lost frames", marks=pytest.mark.study),
    ],
)
def test_the_offset_of_a_rendered_film(tmp_path, scene):
    known = simulate(tmp_path / "twin", replace(SMALL, scene=scene))["experiments"]["steps-1"]
    said = open_campaign(tmp_path / "twin").sync()["steps-1"].dataset.attrs
    error = said["offset_s"] - known["offset_s"]
    assert abs(error) < 1e-3
    assert abs(error) < 3 * said["offset_stderr_s"] < 3e-3


def moved(rate=240.0, seconds=3.0, noise=2e-4, seed=0):
    """Times, and amplitudes (n, 2) of a swing with noise."""
    time = np.arange(0, seconds, 1 / rate)
    swing = np.column_stack([np.sin(6 * time), 0.3 * np.cos(9 * time)])
    return time, swing + np.random.default_rng(seed).normal(0, noise, swing.shape)


def test_frames_that_show_the_picture_before_are_found():
    time, swing = moved()
    again = np.arange(25, 700, 40)
    swing[again] = swing[again - 1] + np.random.default_rng(1).normal(0, 5e-5, (len(again), 2))
    found = np.flatnonzero(repeated(time, swing))
    assert set(found) <= set(again)
    assert len(found) > 0.6 * len(again)


def test_a_tube_that_turns_or_starts_or_shakes_repeats_nothing():
    time, swing = moved()
    starts = np.where(time[:, None] < 1.0, swing[240], swing)
    assert repeated(time, swing).sum() <= 1
    assert repeated(time, starts).sum() <= 1
    jitter = time + np.random.default_rng(2).uniform(-1e-3, 1e-3, len(time))
    uneven = np.column_stack([np.sin(6 * jitter), 0.3 * np.cos(9 * jitter)])
    uneven += np.random.default_rng(3).normal(0, 2e-4, swing.shape)
    assert repeated(jitter, uneven).sum() <= 1


def test_a_swing_filmed_in_few_pictures_repeats_nothing():
    """At 30 frames/s of a motion up to 5 Hz, one step in a hundred is as short as that of a repeat: where it turns."""
    generator = np.random.default_rng(0)
    time = np.arange(0, 40, 1 / 30)[:, None]
    rates, phases = generator.uniform(0.5, 5, 12), generator.uniform(0, 2 * np.pi, 12)
    swing = np.sum(0.2 / rates * np.sin(2 * np.pi * rates * time + phases), axis=1, keepdims=True)
    assert not repeated(time[:, 0], swing + generator.normal(0, 8e-4, swing.shape)).any()
