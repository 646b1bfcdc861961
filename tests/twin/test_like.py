"""A twin of a recorded campaign: the same excitation, frames, clocks and noise, in a tube whose physics is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml

from rfea_vision.artefacts import Actuator, Recording
from rfea_vision.errors import InputError
from rfea_vision.twin import BaseParameters, TwinOptions
from rfea_vision.twin.like import base_like, noise_of, simulate_like, tube_like


def recorded(observe="tip", *, offset_s=0.03, bends="left", noise=0.2):
    """A recording of some slow motion, with lost frames and noise."""
    rng = np.random.default_rng(0)
    camera, log = np.arange(0, 1.0, 1 / 120), np.arange(-0.4, 1.6, 0.002)
    bend = 20 + 15 * np.sin(3 * camera)
    tip = np.column_stack([-2 * bend, -150 + bend]) + rng.normal(0, noise, (len(camera), 2))
    valid = np.ones(len(camera), np.int8)
    valid[40:44] = 0
    data = (
        {"tip": (("time", "xy"), tip)}
        if observe == "tip"
        else {"bend_angle": (("time",), bend + rng.normal(0, 0.1, len(bend)))}
    )
    dataset = xr.Dataset(
        {
            **data,
            "valid": ("time", valid),
            "reason": ("time", np.where(valid, "", "blurred")),
            "pressure": ("log_time", 60 + 40 * np.sin(3 * log)),
        },
        coords={"time": camera + offset_s, "log_time": log},
        attrs={
            "experiment": "a", "role": "validate", "bends": bends, "sync_method": "motion", "offset_s": offset_s,
            "offset_stderr_s": 1e-3, "drift_ppm": 0.0, "drift_stderr_ppm": 1.0,
        },
    )  # fmt: skip
    return Recording(dataset)


OPTIONS = TwinOptions(base=BaseParameters(), joints=6, seed=1)


def test_noise_is_measured_beside_the_motion():
    noise = np.random.default_rng(1).normal(0, 0.07, (3000, 2))
    motion = 80 * np.sin(2 * np.pi * np.arange(3000)[:, None] / 240)
    assert noise_of(motion + noise) == pytest.approx(0.07, rel=0.05)


def test_excitation_frames_clock_and_noise_are_taken_over(tmp_path):
    recording = recorded()
    truth = simulate_like(tmp_path / "twin", {"a": recording}, OPTIONS)
    folder = tmp_path / "twin" / "a"
    log = pd.read_csv(folder / "pressure.csv")
    np.testing.assert_allclose(log["pressure_kPa"], recording.dataset["pressure"].values, atol=1e-4)
    track = pd.read_csv(folder / "track.csv")
    np.testing.assert_allclose(track["time_s"], recording.time_s[recording.valid] - 0.03, atol=2e-6)
    assert track["sigma_mm"].iloc[0] == pytest.approx(0.2, rel=0.25)
    described = yaml.safe_load((folder / "experiment.yaml").read_text())
    assert described["role"] == "validate" and described["sync"]["method"] == "motion"
    assert truth["experiments"]["a"]["offset_s"] == 0.03
    assert np.std(np.diff(track["tip_y_mm"], 4)) / np.sqrt(70) == pytest.approx(0.2, rel=0.25)
    with pytest.raises(InputError, match="not empty"):
        simulate_like(tmp_path / "twin", {"a": recording}, OPTIONS)


def test_what_is_hidden_moves_the_twin(tmp_path):
    quiet = recorded(noise=1e-4)
    plain, heavy = (
        (
            simulate_like(tmp_path / name, {"a": quiet}, replace(OPTIONS, hidden=hidden)),
            pd.read_csv(tmp_path / name / "a" / "track.csv"),
        )[1]
        for name, hidden in (("plain", {}), ("heavy", {"payload.m": 0.004, "payload.offset": 1.0}))
    )
    assert np.abs(plain["tip_y_mm"] - heavy["tip_y_mm"]).max() > 0.5


def test_an_inclinometer_is_taken_after_too(tmp_path):
    simulate_like(tmp_path / "twin", {"a": recorded("angle")}, OPTIONS)
    track = pd.read_csv(tmp_path / "twin" / "a" / "track.csv")
    assert track["sigma_deg"].iloc[0] == pytest.approx(0.1, rel=0.3)


def test_a_tube_that_was_weighed_weighs_the_same_and_a_beam_is_refused():
    weighed = Actuator(mass_per_length=0.08)
    twin = tube_like(weighed)
    assert twin.linear_density == pytest.approx(weighed.linear_density) and twin.mass_per_length is None
    assert tube_like(Actuator()) == Actuator()
    with pytest.raises(InputError, match="the plant is a tube, and this campaign's section a rod"):
        tube_like(Actuator(kind="rod"))


def test_base_parameters_go_with_the_number_of_segments():
    names = list(BaseParameters.__dataclass_fields__)
    found = base_like(dict.fromkeys(names, 16.0), 16)
    assert (found.k_ref, found.b_neg_slope, found.r_hyd) == (8.0, 8.0, 16.0)
