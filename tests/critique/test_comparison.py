"""Where a model fails: phases of a run, what its residual goes with, and rates across lost frames."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rfea_vision.artefacts.judgement import Comparison, ExperimentScore, Metrics
from rfea_vision.critique.comparison import _by_segment, _sentences, _worst
from rfea_vision.critique.phases import label_phases
from rfea_vision.critique.torque import _smoothed, all_residual_torques, summarise_torque
from rfea_vision.errors import InputError
from rfea_vision.fitting import fit_model
from rfea_vision.fitting.noise import white_noise_mm
from rfea_vision.fitting.residual_tests import correlation_ratio
from rfea_vision.options import FitOptions


def test_phases_of_a_trapezium():
    time = np.arange(0, 6, 1 / 240)
    pressure = np.interp(time, [0, 1, 2, 4, 5, 6], [0, 0, 200, 200, 0, 0])
    labels = label_phases(time, pressure, pressure / 100)
    middle = {second: labels[np.argmin(np.abs(time - second))] for second in (0.5, 1.5, 3.0, 4.5, 5.5)}
    assert middle == {0.5: "rest", 1.5: "rise", 3.0: "hold", 4.5: "fall", 5.5: "rest"}


def test_phases_of_a_triangle_and_of_ringing():
    time = np.arange(0, 4, 1 / 240)
    triangle = np.interp(time, [0, 1, 2, 3, 4], [0, 100, 0, 100, 0])
    assert label_phases(time, triangle, triangle)[np.argmin(np.abs(time - 1.0))] == "reversal"
    step = np.where(time > 1, 100.0, 0.0)
    bend = np.where(time > 1, 1 + 0.3 * np.exp(-(time - 1) / 0.5) * np.cos(2 * np.pi * 6 * (time - 1)), 0.0)
    assert np.mean(label_phases(time, step, bend)[(time > 1.1) & (time < 1.5)] == "ringing") > 0.6


def test_phases_of_two_chambers_with_a_rippling_regulator():
    """The tube creeps for seconds after each step, and rings nowhere; the second chamber bends to the other side."""
    time = np.arange(0, 40, 1 / 36)
    rng = np.random.default_rng(3)
    pressure = np.interp(time, [0, 1, 2, 10, 12, 20, 21, 29, 31], [0, 0, 60, 60, 0, 0, -60, -60, 0])
    bend = np.zeros_like(time)
    for k in range(1, time.size):
        bend[k] = bend[k - 1] + (pressure[k] / 3 - bend[k - 1]) / 36 / 1.5
    ripple = np.convolve(rng.standard_normal(time.size), np.ones(3) / 3, mode="same")
    labels = label_phases(time, pressure + 2.5 * ripple, bend + 0.02 * rng.standard_normal(time.size))

    def share(label, begin, end):
        return float(np.mean(labels[(time > begin) & (time < end)] == label))

    assert share("rise", 1.2, 1.8) > 0.8 and share("fall", 10.3, 11.7) > 0.8
    assert share("hold", 3, 9.8) > 0.9 and share("hold", 22, 28.8) > 0.9
    assert share("rest", 13, 19.8) > 0.9 and share("rest", 32, 40) > 0.9
    assert np.mean(np.isin(labels, ["reversal", "ringing"])) < 0.02


@pytest.mark.parametrize("nodes", [3, 5, 8, 13, 25])
def test_the_error_along_the_tube_is_told_whatever_the_number_of_nodes(nodes):
    """A few painted marks are a centre line, too; the parts meet one another, from clamp to tip."""
    rows = _by_segment([np.ones((4, nodes))], [np.zeros((4, nodes))])
    assert len(rows) == min(nodes, 8)
    assert [row["from_sigma"] for row in rows[1:]] == [row["to_sigma"] for row in rows[:-1]]
    assert (rows[0]["from_sigma"], rows[-1]["to_sigma"]) == (0.0, 1.0)
    assert all(row["to_sigma"] > row["from_sigma"] for row in rows) and rows[0]["rmse_mm"] == 1.0


def test_a_stretch_that_stands_out_is_told_by_the_floor_that_it_stands_out_of():
    """A floor that was the fit's own error hid every stretch of a model that was 10 mm off: then the run's other stretches tell."""
    time, square, labels = np.arange(0, 4, 0.02), np.full((200, 1), 1.0), np.full(200, "hold")
    square[50:100] = 9.0
    told = [_worst("a", time, square, np.ones(1), labels, floor, 0.05, "mm") for floor in (1.5, None, 2.7)]
    assert [one[0].sentence.rpartition(", ")[2] for one in told[:2]] == [
        "1.98 times the noise floor.",
        "2.97 times the median of this run.",
    ]
    assert told[2] == []


def test_no_stretch_of_noise_alone_stands_out():
    """Of seven frames in a quarter second, the 1.2 times of old was chance: at 30 frames per second one window in eight."""
    time, labels = np.arange(0, 60, 1 / 30), np.full(1800, "hold")
    noise = np.random.default_rng(4).standard_normal((1800, 2))
    square = np.sum(noise**2, axis=1, keepdims=True)
    assert _worst("a", time, square, np.ones(1), labels, None, white_noise_mm(noise), "mm") == []
    square[600:620] += 9.0
    assert [place.from_s for place in _worst("a", time, square, np.ones(1), labels, None, white_noise_mm(noise), "mm")] == [20.0]


def test_dependence_sees_curves_and_no_chance():
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, 4000)
    noise = rng.standard_normal(4000)
    assert correlation_ratio(x**2, x) > 0.95  # no linear correlation at all
    assert correlation_ratio(x**2 + np.std(x**2) * noise, x) == pytest.approx(0.5, abs=0.06)
    assert correlation_ratio(noise, x) < 0.02


def test_a_rate_is_no_larger_where_frames_were_lost():
    """Across a fifth of a second it is that of the chord; taken frame by frame it would be twenty times too large."""
    time = np.delete(np.arange(0, 2, 0.01), np.r_[50:70, 120:124])
    gap = np.sin(3 * time)[:, None]
    (_, rate, _), _ = _smoothed(time, gap)
    assert np.abs(rate[5:-5, 0] - 3 * np.cos(3 * time[5:-5])).max() < 0.6


@pytest.mark.parametrize(("error", "said"), [(2.1, True), (0.1, False)])
def test_noise_is_no_gap_that_a_torque_would_close(error, said):
    """Of a model at the floor the residual torque is that of noise, differentiated twice: as large as that of a failure."""
    scores = {"validate": Metrics(angle_rmse_deg=error)}
    model: Any = SimpleNamespace(name="base", metrics=scores, meets_no_run=False, experiments={})
    rate = {"on": "rate", "what": "the rate", "score": 0.44, "sentence": "44 % of its variance goes with the rate."}
    torque = {"rms_mNm": 0.95, "depends_on": [rate]}
    told = _sentences(model, Comparison(model="base", residual_torque=torque), "deg", 0.1)
    assert any("torque" in text for text in told) == said
    model.experiments = {"run": ExperimentScore(role="train", pressure_times=1.45)}
    told = _sentences(model, Comparison(model="base", residual_torque=torque), "deg", 0.1)
    assert "run is off as if its pressure were logged 1.45 times as high" in " ".join(told)
    model.meets_no_run, model.experiments = True, {"run": ExperimentScore(role="train", normalised_fit_percent=-20.0)}
    lost = _sentences(model, Comparison(model="base", residual_torque=torque), "deg", 0.1)
    assert "never moves" in lost[-1] and not any("torque" in text for text in lost)


def test_a_table_has_its_own_keys_and_no_others(tmp_path):
    row = {"from_sigma": 0.0, "to_sigma": 0.5, "rmse_mm": float("nan"), "bias_mm": 0.1}
    path = tmp_path / "comparison.json"
    Comparison(model="base", by_segment=[row]).save(path)
    assert Comparison.load(path).by_segment == [{**row, "rmse_mm": None}], "what is undefined is null"
    path.write_text(path.read_text(encoding="utf-8").replace("bias_mm", "bias"), encoding="utf-8")
    with pytest.raises(InputError, match=r"comparison.json: by_segment.0.bias.*with --force"):
        Comparison.load(path)


def test_no_torque_of_noise_alone_goes_with_the_rate(campaign):
    """Dampers turn the noise of a track into a torque that went with the rate of that same track, where nothing was missing."""
    recordings, actuator = campaign()
    model = fit_model(recordings, actuator, FitOptions(segments=5, starts=0))
    torque = summarise_torque(list(all_residual_torques(model, recordings).values()))
    assert torque["rms_mNm"] > 0 and max(row["score"] for row in torque["depends_on"]) < 0.03
