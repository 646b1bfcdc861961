"""Tracking against scenes of known truth."""

from dataclasses import replace

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.errors import DataError, InputError
from rfea_vision.vision import track_frames
from rfea_vision.vision.follow.frame import fit_frame
from rfea_vision.vision.track import wrong_side
from testing.scenes import Lens, Look, bending, film, picture, shape
from testing.sources import memory_source, true_calibration


def even(line: np.ndarray, count: int) -> np.ndarray:
    lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    places = np.linspace(0, lengths[-1], count)
    return np.column_stack([np.interp(places, lengths, line[:, k]) for k in (0, 1)])


def tip_errors(track, shapes) -> np.ndarray:
    return (track.dataset["tip"].values - np.array([s.tip for s in shapes]))[track.valid]


def test_edges_are_read_to_a_fraction_of_a_pixel(filmed, small_lens):
    _, _, shapes, track = filmed
    px = 1 / track.dataset.attrs["px_per_mm"]
    assert track.valid.all()
    truth = np.array([even(s.centre, 33) for s in shapes])
    # In the picture: the origin, which is measured by itself, is put back.
    origin = np.array([track.dataset.attrs["clamp_plane_x_mm"], track.dataset.attrs["clamp_plane_y_mm"]])
    off = track.dataset["midline"].values + origin - truth
    assert np.abs(off[:, 2:-2].mean(axis=0)).max() < 0.02 * px
    assert np.sqrt(np.mean(off[:, 2:-2] ** 2)) < 0.03 * px
    tip = tip_errors(track, shapes)
    assert np.abs(tip.mean(axis=0)).max() < 0.04 * px


def test_pictures_whose_rows_lie_apart_are_read_by_the_same_loops(filmed, small_lens):
    pictures = filmed[0][:12]
    padded = [np.pad(picture, ((0, 0), (0, 24)))[:, :-24] for picture in pictures]
    tracks = [
        track_frames(memory_source(either, filmed[1][:12]), true_calibration(small_lens), Actuator())
        for either in (pictures, padded)
    ]
    np.testing.assert_array_equal(*(track.dataset["midline"].values for track in tracks))
    assert {signature[0].types[0].layout for signature in fit_frame.signatures} == {"C"}


def test_everything_else_follows_the_truth(filmed):
    _, _, shapes, track = filmed
    data = track.dataset
    assert np.abs(data["bend_angle"].values - [s.bend_deg for s in shapes]).mean() < 0.5
    assert np.abs(data["width"].values - 8.0).max() < 0.15
    joints = np.linspace(0, 1, 17)
    truth = np.array(
        [4.0 * np.diff(np.interp(joints, np.linspace(0, 1, len(s.phi)), s.phi)) / (155 / 16) for s in shapes]
    )
    np.testing.assert_allclose(data["elongation"].values[:, 1:-1], truth[:, 1:-1], atol=0.004)
    np.testing.assert_allclose(data["hinge_length"].values, 155.0, atol=0.2)
    inner, outer = data["edges"].values[-1]
    np.testing.assert_allclose(inner[[0, -1]], shapes[-1].inner[[0, -1]], atol=0.06)
    np.testing.assert_allclose(outer[[0, -1]], shapes[-1].outer[[0, -1]], atol=0.06)
    middle = data["curvature"].values[-1, 16]
    slope = np.gradient(
        shapes[-1].phi, np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(shapes[-1].centre, axis=0), axis=1))])
    )
    assert abs(middle - slope[len(slope) // 2]) < 0.05 * slope.max()


def test_claimed_errors_are_those_that_are_made(filmed):
    _, _, shapes, track = filmed
    data = track.dataset
    truth = np.array([even(s.centre, 33) for s in shapes])
    phi = np.array([np.interp(np.linspace(0, 1, 33), np.linspace(0, 1, len(s.phi)), s.phi) for s in shapes])
    normal = np.stack([np.cos(phi), -np.sin(phi)], axis=-1)
    off = np.sum((data["midline"].values - truth) * normal, axis=-1)
    z = (off - off.mean(axis=0))[:, 2:-2] / data["midline_noise_sigma"].values[:, 2:-2]
    assert 0.7 < z.std() < 1.5
    tip = tip_errors(track, shapes)
    inside = np.abs(tip) < 1.96 * data["tip_sigma"].values
    assert inside.mean() > 0.85


SCENES = {
    "dark tube on white": (Look(tube=40, background=200, clamp=120), {}),
    "no clamp drawn": (Look(clamp=None), {}),
    "clamp as light as the tube": (Look(clamp=190), {}),
    "clamp as dark as the ground": (Look(clamp=60), {}),
    "uneven and flickering light": (Look(uneven=0.5, flicker=0.15), {}),
    "busy background": (Look(busy=15), {}),
    "low contrast": (Look(tube=120, background=85, clamp=60), {}),
    "noise and blur": (Look(noise=7, blur_px=1.5), {}),
    "hose in front": (Look(hose_mm=-60), {}),
    "bent from the start": (Look(), {"rest_deg": 50.0}),
}


@pytest.mark.parametrize("name", SCENES)
def test_no_frame_is_lost_on_stress_scenes(name, small_lens):
    look, options = SCENES[name]
    pictures, times, shapes = film(small_lens, look, bending(np.arange(36) / 120, **options), rate_Hz=120)
    track = track_frames(memory_source(pictures, times), true_calibration(small_lens), Actuator())
    assert track.valid.all(), set(track.dataset["reason"].values)
    error = np.sqrt(np.mean(np.sum(tip_errors(track, shapes) ** 2, axis=1)))
    assert error < (0.25 if name in ("busy background", "low contrast", "noise and blur") else 0.08)


def test_landscape_and_bends_right():
    lens = Lens(
        size=(1280, 720),
        matrix=np.array([[1400.0, 0, 640], [0, 1400, 360], [0, 0, 1]]),
        translation=np.array([-50.0, -75.0, 420.0]),
    )
    lens = lens.scaled(0.5)
    pictures, times, shapes = film(lens, Look(), bending(np.arange(30) / 120), rate_Hz=120, bends="right")
    track = track_frames(memory_source(pictures, times), true_calibration(lens), Actuator(bends="right"))
    assert track.valid.all()
    assert np.sqrt(np.mean(tip_errors(track, shapes) ** 2)) < 0.08
    assert track.dataset["bend_angle"].values[-1] > 50
    assert track.dataset["tip"].values[-1, 0] > 40


def test_a_bend_of_150_degrees_does_not_swap_base_and_tip(small_lens):
    pictures, times, shapes = film(small_lens, Look(), [150.0] * 3)
    track = track_frames(memory_source(pictures, times), true_calibration(small_lens), Actuator())
    assert track.valid.all()
    assert np.abs(tip_errors(track, shapes)).max() < 0.15
    np.testing.assert_allclose(track.dataset["bend_angle"].values, 150, atol=2)


def test_bad_frames_keep_their_row_and_say_why(small_lens):
    pictures, times, shapes = film(small_lens, Look(), bending(np.arange(40) / 120), rate_Hz=120)
    pictures[10] = np.full_like(pictures[10], 60)
    pictures[20] = pictures[19]
    pictures[30] = pictures[30].copy()
    pictures[30][150:600] = 10  # something passes in front
    track = track_frames(memory_source(pictures, times), true_calibration(small_lens), Actuator())
    reasons = track.dataset["reason"].values
    assert len(reasons) == 40
    assert reasons[10] in ("no_tube", "occluded", "edge_lost")
    assert reasons[20] == "duplicate"
    assert reasons[30] in ("no_tube", "occluded", "edge_lost", "tip_hidden")
    others = np.delete(np.arange(40), [10, 20, 30])
    assert track.valid[others].all()
    assert np.isnan(track.dataset["tip"].values[10]).all()
    assert np.abs(tip_errors(track, shapes))[12:].max() < 0.15


def test_a_tip_outside_the_picture_is_said(small_lens):
    lens = replace(small_lens, translation=small_lens.translation - [50.0, 0.0, 0.0])
    pictures, times, _ = film(lens, Look(), np.linspace(2, 100, 30), rate_Hz=60)
    track = track_frames(memory_source(pictures, times), true_calibration(lens), Actuator())
    reasons = track.dataset["reason"].values
    assert track.valid[0] and not track.valid[-1]
    assert set(reasons[~track.valid]) <= {
        "touches_border",
        "length_off",
        "tip_hidden",
        "no_tube",
        "occluded",
        "edge_lost",
    }
    assert "touches_border" in reasons


def test_vertical_is_turned_as_asked(small_lens):
    pictures, times, _ = film(small_lens, Look(), [0.0] * 3)
    calibration = true_calibration(small_lens)
    turned = replace(calibration, plane_rotation=calibration.plane_rotation @ _about_z(5.0))
    by_board = track_frames(memory_source(pictures, times), turned, Actuator())
    by_rest = track_frames(memory_source(pictures, times), turned, Actuator(), vertical="rest")
    plumb = small_lens.project(np.array([[20.0, 0.0], [20.0, -150.0]])).tolist()
    by_plumb = track_frames(memory_source(pictures, times), turned, Actuator(), vertical={"plumb": plumb})
    assert abs(abs(by_board.dataset["bend_angle"].values.mean()) - 5.0) < 0.3
    assert abs(by_rest.dataset["tip"].values[0, 0]) < 0.05
    assert abs(by_plumb.dataset["tip"].values[0, 0]) < 0.1


def _about_z(degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_hints_override_what_is_found(small_lens):
    pictures, times, _ = film(small_lens, Look(), [0.0] * 3)
    clamp = small_lens.project(np.array([[-4.0, -10.0], [4.0, -10.0]]))
    tip = small_lens.project(np.array([[0.0, -155.0]]))[0]
    track = track_frames(
        memory_source(pictures, times),
        true_calibration(small_lens),
        Actuator(length=0.145),
        hints=Hints(clamp=clamp.tolist(), tip=tip.tolist()),
    )
    np.testing.assert_allclose(track.dataset["tip"].values[0], [0, -145], atol=0.1)
    assert track.dataset.attrs["clamp_found_by"] == "hint"
    with pytest.raises(InputError, match=r"camera\.clamp"):
        track_frames(
            memory_source(pictures, times),
            true_calibration(small_lens),
            Actuator(),
            hints=Hints(clamp=((-5, 0), (5, 5))),
        )


@pytest.mark.usefixtures("unadvised")
def test_no_tube_and_wrong_camera_are_errors(small_lens):
    rng = np.random.default_rng(0)
    noise = [rng.normal(100, 5, (640, 360)).astype(np.uint8) for _ in range(3)]
    with pytest.raises(DataError, match="no tube found"):
        track_frames(memory_source(noise, [0, 1, 2]), true_calibration(small_lens), Actuator())
    wide = [picture(shape(0), Lens(size=(400, 300)), Look(), rng)]
    with pytest.raises(InputError, match="calibrate in the video's camera mode"):
        track_frames(memory_source(wide, [0]), true_calibration(small_lens), Actuator())


@pytest.mark.parametrize(
    ("bend_deg", "doubted"),
    [([0.1, -9.0, -44.0], True), ([-3.0, 20.0, 60.0], False), ([-1.0, -2.0, -4.0], False), ([-20.0, 80.0], False)],
)
def test_a_tube_that_bends_to_the_other_side_is_told(bend_deg, doubted):
    said = wrong_side(np.array(bend_deg), "right")
    assert bool(said) == doubted and ("actuator.bends says ('right')" in said) == doubted
