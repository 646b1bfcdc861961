"""A tube that lies across gravity, or stands upright: filmed, tracked, synchronised and fitted, all the way."""

import numpy as np
import pytest
import xarray as xr

from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.stages import open_campaign
from rfea_vision.twin import TwinOptions, simulate
from rfea_vision.vision.scene import gravity_seen_deg, turned


@pytest.mark.parametrize("gravity", ["left", pytest.param("up", marks=pytest.mark.study)])
def test_a_film_of_a_rig_that_does_not_hang(tmp_path, gravity):
    """The picture is level, the tube in it is not: track and fit are as good as those of one that hangs."""
    options = TwinOptions(
        gravity=gravity, video=True, roles=("train",), kinds=("steps",), duration_s=1.2, rate_Hz=60.0, seed=5,
        frame_size=(360, 480), photos=8, exact_tracks=True,
    )  # fmt: skip
    truth = simulate(tmp_path / "c", options)
    work = open_campaign(tmp_path / "c")
    (recording,) = work.recordings("train").values()
    exact = xr.load_dataset(next((tmp_path / "c-truth").glob("*.nc")))
    frames = np.flatnonzero(recording.valid)
    assert frames.size > 0.95 * exact["time"].size
    assert np.abs(recording.dataset["tip"].values[frames] - exact["tip"].values[frames]).max() < 0.6
    (told,) = truth["experiments"].values()
    assert recording.dataset.attrs["offset_s"] == pytest.approx(told["offset_s"], abs=2e-3)
    fitted = work.fit(segments=6)
    assert fitted.metrics["train"].tip_rmse_mm < 0.4


@pytest.mark.parametrize("bends", ["left", "right"])
@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 90.0, -120.0, 180.0])
def test_a_plumb_line_tells_what_the_frame_was_turned_by(bends, angle_deg):
    calibration = scaled_by_distance((640, 480), ((100.0, 200.0), (500.0, 200.0)), 200.0)
    down = turned(np.array([0.0, -1.0]), angle_deg, bends)
    hangs = [(320.0, 40.0), (320.0, 440.0)]
    seen = gravity_seen_deg(calibration, down, hangs, bends)
    assert (seen - angle_deg + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("bends", "points"), [("left", (1.0, 0.0)), ("right", (-1.0, 0.0))])
def test_a_tube_that_bends_down_lies_across(bends, points):
    """Gravity on the side to which it bends: the tube points to the other hand, so that bending takes it down."""
    np.testing.assert_allclose(turned(np.array([0.0, -1.0]), 90.0, bends), points, atol=1e-12)
