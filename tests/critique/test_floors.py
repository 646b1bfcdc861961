"""The floors below which no model is promised an error."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from rfea_vision.artefacts import Recording
from rfea_vision.critique.floors import binding, floors_of, measurement
from rfea_vision.fitting.fit import fit
from rfea_vision.fitting.noise import noise_floor_mm, white_noise_mm
from rfea_vision.fitting.problem import make_problem
from rfea_vision.options import FitOptions


def _fake(noise: np.ndarray, sigma_mm: float) -> tuple[SimpleNamespace, SimpleNamespace]:
    """A problem and a fit of which only the tip's residual is looked at."""
    time = np.arange(noise.shape[0]) / 240.0
    item = SimpleNamespace(
        origin_sigma=0.0,
        name="run", role="train", repeat_of=None, has_tip=True, time=time, period_s=1 / 240.0, frame=np.arange(time.size),
        points=noise[:, None, :] * 1e-3, tip_noise_mm=0.0,
    )  # fmt: skip
    predicted = SimpleNamespace(points=np.zeros((time.size, 1, 2)))
    tip_sigma = np.full((time.size, 2), sigma_mm)
    recordings = {"run": SimpleNamespace(dataset=xr.Dataset({"tip_sigma": (("time", "xy"), tip_sigma)}))}
    problem = SimpleNamespace(train=(item,), validate=(), scored=(item,), recordings=recordings)
    return problem, SimpleNamespace(solution=SimpleNamespace(evaluation=SimpleNamespace(predicted=(predicted,))))


def test_the_floor_sees_noise_that_lasts_over_frames_but_no_motion():
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((3000, 2))
    for k in range(1, 3000):
        noise[k] = 0.6 * noise[k - 1] + 0.8 * noise[k]
    true = 0.06 * np.sqrt(2)
    understated, source = measurement(*_fake(0.06 * noise, 0.03))
    assert source == "the high frequencies that the best model tried leaves"
    assert understated == pytest.approx(true, rel=0.15)
    slow = 0.5 * np.sin(2 * np.pi * 2.0 * np.arange(3000) / 240.0)[:, None]
    assert measurement(*_fake(0.06 * noise + slow, 0.03))[0] == pytest.approx(understated, rel=0.05)


def test_ringing_that_the_model_tells_does_not_raise_the_floor_of_a_slow_track():
    """Third differences of a tube that rings at 5 Hz before 25 frames/s are its motion; what the model leaves has only the noise."""
    rng = np.random.default_rng(3)
    noise = 0.06 * rng.standard_normal((1500, 2))
    ringing = 2.0 * np.sin(2 * np.pi * 5.0 * np.arange(1500) / 25.0)[:, None]
    problem, fitted = _fake(noise, 0.06)
    (item,) = problem.train
    item.points, item.tip_noise_mm = item.points + ringing[:, None, :] * 1e-3, white_noise_mm(noise + ringing)
    fitted.solution.evaluation.predicted[0].points = ringing[:, None, :] * 1e-3
    assert item.tip_noise_mm > 1.0 and measurement(problem, fitted)[0] == pytest.approx(0.06 * np.sqrt(2), rel=0.1)


def test_a_model_that_leaves_less_than_the_track_claims_gives_the_floor_and_is_told_as_its_source():
    """A fit had told 4.00 mm, the diagnosis of the same model 3.21 mm, and nobody said why."""
    slow = 0.06 * np.sin(2 * np.pi * 2.0 * np.arange(1200) / 240.0)[:, None] * np.ones(2)
    floor, source = measurement(*_fake(slow, 0.5))
    assert floor == pytest.approx(0.06) and source.startswith("what a model leaves of its worst run")


def test_repeats_give_the_irreproducible_floor(campaign):
    """Two runs of one excitation that differ by a slow wander of known size: no model is promised less."""
    recordings, actuator = campaign()
    (name, run), *_ = recordings.items()
    again = run.dataset.copy(deep=True)
    wander = 0.5 * np.sin(2 * np.pi * again["time"].values / 1.7)
    for key in ("midline", "tip"):
        again[key] = again[key] + xr.DataArray(wander, dims="time") * xr.DataArray([1.0, 0.0], dims="xy")
    again.attrs |= {"experiment": "again", "repeat_of": name}
    problem = make_problem({**recordings, "again": Recording(again)}, actuator)
    floors = floors_of(problem, fit(problem, FitOptions(segments=4, starts=0)))
    expected = np.sqrt(np.mean(wander**2) / 2)
    assert floors.irreproducible == pytest.approx(expected, rel=0.25) and floors.measurement < 0.5 * expected
    assert binding(floors) == floors.irreproducible


def test_the_floor_leaves_out_what_all_frames_share():
    """Where the clamp was seen is found along with the fit: its error is not noise that a model could be left with."""
    frames = np.arange(10)
    item = SimpleNamespace(
        name="run", repeat_of=None, has_tip=True, frame=frames, tip_noise_mm=0.004, origin_sigma=3e-4
    )
    attributes = {"origin_sigma_along_mm": 0.02, "origin_sigma_across_mm": 0.01}
    sigma = np.full((frames.size, 2), np.sqrt((0.02**2 + 0.01**2 + 0.006**2) / 2))
    data = xr.Dataset({"tip_sigma": (("time", "xy"), sigma)}, attrs=attributes)
    floor, source = noise_floor_mm([item], {"run": SimpleNamespace(dataset=data)})
    assert floor == pytest.approx(0.006) and "standard errors" in source
    item.origin_sigma = 0.0  # a track that is in the rig frame by somebody's word is taken at that word
    assert noise_floor_mm([item], {"run": SimpleNamespace(dataset=data)})[0] == pytest.approx(0.0232, abs=1e-4)


def test_a_floor_hangs_on_no_single_frame_unless_its_error_is_as_large_as_it_claims():
    """One frame of 720 that claims 3.8 mm made a floor of 0.14 mm, beside an error of 0.006 mm."""
    frames = np.arange(720)
    item = SimpleNamespace(name="run", repeat_of=None, has_tip=True, frame=frames, tip_noise_mm=0.004, origin_sigma=0.0)
    sigma = np.full((frames.size, 2), 0.006 / np.sqrt(2))
    sigma[400] = 3.8 / np.sqrt(2)
    runs = {"run": SimpleNamespace(dataset=xr.Dataset({"tip_sigma": (("time", "xy"), sigma)}))}
    assert noise_floor_mm([item], runs)[0] == pytest.approx(0.006, rel=0.01)
    errors = np.full(frames.size, 0.006**2)
    assert noise_floor_mm([item], runs, errors={"run": errors})[0] == pytest.approx(0.006, rel=0.01)
    errors[400] = 3.8**2  # it was as wrong as it said: no model gets below that
    assert noise_floor_mm([item], runs, errors={"run": errors})[0] == pytest.approx(3.8 / np.sqrt(720), rel=0.01)
    errors[400] = 100.0**2  # but a model's own error is no noise
    assert noise_floor_mm([item], runs, errors={"run": errors})[0] == pytest.approx(3.8 / np.sqrt(720), rel=0.01)


def test_claims_of_many_frames_stand_where_a_model_bears_them_out():
    """A fifth of the frames four times as uncertain as the rest: noise makes the mean of their squares."""
    frames = np.arange(500)
    item = SimpleNamespace(name="run", repeat_of=None, has_tip=True, frame=frames, tip_noise_mm=0.0, origin_sigma=0.0)
    sigma = np.where(frames % 5 == 0, 0.08, 0.02)[:, None] * np.ones(2)
    runs = {"run": SimpleNamespace(dataset=xr.Dataset({"tip_sigma": (("time", "xy"), sigma)}))}
    expected = np.sqrt(2 * (0.2 * 0.08**2 + 0.8 * 0.02**2))
    left = {"run": np.full(500, 1.1 * expected**2)}
    assert noise_floor_mm([item], runs, errors=left)[0] == pytest.approx(expected)
    # Noise is in what a model leaves: of a run that is left with half of it, twice as much was claimed as there is.
    left |= {"other": np.full(300, (expected / 2) ** 2), "run": np.full(500, (expected / 3) ** 2)}
    floor, source = noise_floor_mm([item], runs, errors=left)
    assert floor == pytest.approx(expected / 2) and "worst run" in source
