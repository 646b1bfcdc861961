import numpy as np
import pandas as pd
import pytest
import xarray as xr

from rfea_vision.artefacts import Track
from rfea_vision.campaign.schema import TrackPart
from rfea_vision.errors import InputError
from rfea_vision.readers.apart import isolating
from rfea_vision.readers.tracks import noise_of, read_track

TIME_S = np.arange(480) / 240
NODES = 17
NOISE_mm = 0.05


def arc(bends="left", noise_mm=0.0, seed=0):
    """A tube that swings as an arc of constant curvature: angle (rad) and nodes (mm)."""
    angle = 1.7 * np.sin(2 * np.pi * 0.5 * TIME_S)
    length = np.linspace(0.0, 155.0, NODES)
    phi = angle[:, None] * length / 155.0
    safe = np.where(np.abs(phi) < 1e-9, 1e-9, phi)
    side = -1.0 if bends == "left" else 1.0
    nodes = np.stack([side * length * (1 - np.cos(phi)) / safe, -length * np.sin(safe) / safe], axis=2)
    return angle, nodes + np.random.default_rng(seed).normal(0.0, noise_mm, nodes.shape) if noise_mm else nodes


def node_frame(nodes):
    columns = {"time_s": TIME_S}
    for index in range(nodes.shape[1]):
        columns |= {f"x{index:02d}_mm": nodes[:, index, 0], f"y{index:02d}_mm": nodes[:, index, 1]}
    return pd.DataFrame(columns)


def read(folder, frame, **options):
    frame.to_csv(folder / "track.csv", index=False)
    return read_track(folder / "track.csv", **options)


def test_nodes_tip_and_angle_agree(tmp_path):
    angle, nodes = arc()
    track = read(tmp_path, node_frame(nodes))
    np.testing.assert_allclose(track.dataset["midline"], nodes)
    np.testing.assert_allclose(track.dataset["tip"], nodes[:, -1])
    np.testing.assert_allclose(track.dataset["bend_angle"], np.rad2deg(angle), atol=1e-6)


def test_angles_are_positive_where_the_tube_bends(tmp_path):
    angle, nodes = arc("right")
    track = read(tmp_path, node_frame(nodes), bends="right")
    np.testing.assert_allclose(track.dataset["bend_angle"], np.rad2deg(angle), atol=1e-6)
    assert track.dataset["tip"].values[60, 0] > 0  # x stays camera-right


def test_reported_errors_are_the_true_errors(tmp_path):
    angle, nodes = arc(noise_mm=NOISE_mm)
    track = read(tmp_path, node_frame(nodes))
    assert "own high frequencies" in track.dataset.attrs["sigma_source"]
    np.testing.assert_allclose(np.mean(track.dataset["midline_sigma"]), NOISE_mm, rtol=0.05)
    error_deg = track.dataset["bend_angle"].values - np.rad2deg(angle)
    np.testing.assert_allclose(np.std(error_deg), np.mean(track.dataset["bend_angle_sigma"]), rtol=0.15)


def test_given_sigmas_are_taken(tmp_path):
    frame = pd.DataFrame({"time_s": TIME_S, "tip_x_mm": TIME_S, "tip_y_mm": -155.0, "sigma_mm": 0.25})
    track = read(tmp_path, frame)
    assert np.all(track.dataset["tip_sigma"] == 0.25)
    assert track.dataset.attrs["sigma_source"] == "given in the track"


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -0.1])
def test_a_standard_error_that_is_none_is_refused_where_there_is_a_tip(tmp_path, wrong):
    frame = pd.DataFrame({"time_s": TIME_S, "tip_x_mm": TIME_S, "tip_y_mm": -155.0, "sigma_mm": 0.25})
    frame.loc[3, ["tip_x_mm", "sigma_mm"]] = np.nan  # a gap needs none
    assert read(tmp_path, frame).valid.sum() == len(TIME_S) - 1
    frame.loc[7, "sigma_mm"] = wrong
    with pytest.raises(InputError, match="sigma_mm, row 8: is no finite number, or below 0"):
        read(tmp_path, frame)


def test_an_inclinometer_is_a_track(tmp_path):
    frame = pd.DataFrame({"time_s": TIME_S, "angle_deg": 30 * TIME_S, "sigma_deg": 0.5})
    track = read(tmp_path, frame)
    np.testing.assert_allclose(track.dataset["bend_angle"], 30 * TIME_S)
    assert "tip" not in track.dataset and np.all(track.dataset["bend_angle_sigma"] == 0.5)


def test_gaps_are_rows_with_a_reason(tmp_path):
    _, nodes = arc()
    frame = node_frame(nodes)
    frame.loc[5, "x03_mm"] = np.nan
    track = read(tmp_path, frame)
    assert len(track.time_s) == len(TIME_S) and not track.valid[5] and track.valid.sum() == len(TIME_S) - 1
    assert track.dataset["reason"].values[5] == "not_tracked"
    assert np.isnan(track.dataset["midline"].values[5]).all()
    track.save(tmp_path / "track.nc")
    again = Track.load(tmp_path / "track.nc")
    np.testing.assert_array_equal(again.valid, track.valid)
    assert list(again.dataset["reason"].values[4:7]) == ["", "not_tracked", ""]


def test_rows_in_which_a_tool_wrote_one_number_everywhere_are_no_tube(tmp_path):
    frame = node_frame(arc()[1])
    frame.loc[3:4, frame.columns != "time_s"] = 9999.0
    track = read(tmp_path, frame)
    assert list(np.flatnonzero(~track.valid)) == [3, 4]


@pytest.mark.parametrize("sigma", [0.01, 0.1, 1.0])
def test_noise_is_seen_beside_motion(sigma):
    motion = 40.0 * np.sin(2 * np.pi * 2.0 * TIME_S)
    noisy = motion + np.random.default_rng(1).normal(0.0, sigma, TIME_S.size)
    assert noise_of(noisy[:, None]) == pytest.approx(sigma, rel=0.15)


def test_rounded_numbers_are_not_free_of_noise():
    assert noise_of(np.round(np.zeros((100, 1)), 1)) > 0
    stairs = np.round(np.linspace(0, 5, 1000), 1)[:, None]
    assert noise_of(stairs) == pytest.approx(0.1 / np.sqrt(12), rel=0.01)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time_s,tip_x_mm\n0,1\n0.1,2\n", "'tip_x_mm' stands without 'tip_y_mm'"),
        ("time_s,speed\n0,1\n0.1,2\n", "no columns of a track"),
        ("t,tip_x_mm,tip_y_mm\n0,1,2\n", "no column 'time_s'"),
        ("time_s,angle_deg\n0,1\n0,2\n", "time_s, row 2: does not increase"),
        ("time_s,angle_deg\n0,1\nnan,2\n", "time_s, row 2: is not a finite number"),
        ("time_s,angle_deg\n0,\n0.1,\n", "column 'angle_deg' holds no number in any row"),
        ("time_s,angle_deg\n0,1\n", "1 row;"),
        ("time_s,x00_mm,y00_mm,x02_mm,y02_mm\n0,1,1,1,1\n0.1,1,1,1,1\n", "column 'x01_mm' is missing"),
        ("time_s,x00_mm,y00_mm,x01_mm,y01_mm\n0,1,1,1,1\n0.1,1,1,1,1\n", "at least three"),
        ("time_s,angle_deg\n0,1\n0.1,steep\n", "'steep' is not a number"),
    ],
)
def test_a_bad_track_is_named(tmp_path, text, says):
    file = tmp_path / "track.csv"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        read_track(file)
    assert str(caught.value).startswith(str(file)) and says in str(caught.value)


@pytest.fixture
def own(tmp_path):
    """A track as a film gives it: more than any table has, its errors among them, and a frame without a tube."""
    _, nodes = arc()
    valid = np.arange(len(TIME_S)) != 7
    dataset = xr.Dataset(
        {
            "valid": ("time", valid.astype(np.int8)),
            "reason": ("time", np.where(valid, "", "no_fit").astype(object)),
            "tip": (("time", "xy"), np.where(valid[:, None], nodes[:, -1], np.nan), {"units": "mm"}),
            "tip_sigma": (("time", "xy"), np.full((len(TIME_S), 2), 0.3, dtype=np.float32), {"units": "mm"}),
            "lamp": ("time", np.linspace(0.0, 255.0, len(TIME_S))),
        },
        coords={"time": ("time", TIME_S, {"units": "s"}), "xy": ["x", "y"]},
        attrs={"Conventions": "CF-1.10", "bends": "left", "doubts": "", "clamp_px_x": 12.5, "marks": 3},
    )
    Track(dataset).save(tmp_path / "track.nc")
    return tmp_path / "track.nc"


@pytest.mark.parametrize("apart", [True, False])
def test_a_track_of_our_own_is_read_as_it_was_written(own, tmp_path, apart):
    """Of an archived film the track was left, and refused as no file of movement's poses."""
    with isolating(apart):
        read_track(own).save(tmp_path / "again.nc")
    assert (tmp_path / "again.nc").read_bytes() == own.read_bytes()


def test_a_track_of_our_own_is_refused_where_something_else_is_meant(own, tmp_path):
    with pytest.raises(InputError, match=r"was made with 'bends: left', and actuator.bends is right"):
        read_track(own, bends="right")
    with pytest.raises(InputError, match=r"track.angle: means nothing for a track that rfea has made"):
        read_track(own, spec=TrackPart(file="track.nc", angle="bend_angle"))
    recording = Track.load(own).dataset.assign(pressure=("log_time", np.zeros(3)))
    Track(recording).save(tmp_path / "recording.nc")
    with pytest.raises(InputError, match=r"is a recording, on the clock of its log; give the track.nc beside it"):
        read_track(tmp_path / "recording.nc")
