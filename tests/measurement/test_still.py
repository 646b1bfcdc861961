"""A camera that drifts and breathes is followed by the still wall behind the body."""

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.projection import camera_vector, project
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.readers.video import open_video
from rfea_vision.vision import track_frames
from rfea_vision.vision.body.held import HeldView
from rfea_vision.vision.body.shown import Shown
from rfea_vision.vision.body.still import StillView, at_scale
from rfea_vision.vision.show.clip import in_frame, rig_to_plane
from testing.phone import Arm, Room, film


def drifting(x: float, y: float, zoom: float, size: tuple[int, int], share: float) -> np.ndarray:
    """Affine map (2, 3) of a view that moves by x, y px and grows by `zoom` about the picture's middle, up to a share."""
    grown, (w, h) = 1 + zoom * share, size
    return np.array([[grown, 0, (1 - grown) * w / 2 + x * share], [0, grown, (1 - grown) * h / 2 + y * share]])


def wall(bits: int) -> np.ndarray:
    rng = np.random.default_rng(2)
    picture = np.full((240, 200, 3), 210, dtype=np.uint8)
    for _ in range(bits):
        x, y = rng.integers(8, 190), rng.integers(8, 230)
        cv2.rectangle(picture, (int(x), int(y)), (int(x) + 7, int(y) + 5), (90, 90, 90), -1)
    return cv2.GaussianBlur(picture, (0, 0), 0.8)


def test_the_view_is_that_of_the_wall_and_not_of_what_moves_before_it():
    first, rng = wall(60), np.random.default_rng(0)
    still = StillView(np.array([[100.0, 20.0], [100.0, 200.0]]), 8.0)
    still.look(first)
    for step in range(1, 6):
        view = drifting(6.0, -4.0, 0.03, (200, 240), step / 5)
        seen = cv2.warpAffine(first, view, (200, 240), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        seen[40:120, 4 * step : 4 * step + 70] = (60, 150, 90)  # a board is pushed through the picture
        seen = np.clip(seen + rng.normal(0, 3, seen.shape), 0, 255).astype(np.uint8)
        still.look(seen)
    shown = Shown(seen, moved=still.moved)
    back = shown.colours(shown.whole)
    corners = np.array([[20.0, 20.0], [180.0, 20.0], [20.0, 220.0], [180.0, 220.0]])
    true, told = (corners @ m[:, :2].T + m[:, 2] for m in (view, still.moved))
    np.testing.assert_allclose(told, true, atol=0.15)
    assert np.abs(back[150:220, 20:180].astype(float) - first[150:220, 20:180]).mean() < 4.0
    np.testing.assert_allclose(shown.colours((slice(120, 200), slice(60, 140))), back[120:200, 60:140], atol=2)
    film, view = corners * 2.0 + 0.5, at_scale(still.moved, 0.5)  # in a film whose pictures are seen half as large
    told = film @ view[:, :2].T + view[:, 2]
    np.testing.assert_allclose(told, true * 2.0 + 0.5, atol=0.3)


def test_an_arm_with_most_of_the_corners_is_no_wall():
    """A second arm, before paper with a dot in each corner and little else, swings: the camera stays."""
    rng = np.random.default_rng(4)
    skin = rng.integers(60, 200, (12, 4, 3)).repeat(6, axis=0).repeat(6, axis=1).astype(np.uint8)  # of checks, 72 px long
    paper = np.full((240, 320, 3), 215, dtype=np.uint8)
    for x, y in rng.uniform([8, 8], [312, 232], (26, 2)):
        if not 90 < x < 300:
            cv2.circle(paper, (int(x), int(y)), 3, (70, 70, 70), -1)
    still = StillView(np.array([[70.0, 120.0], [70.0, 200.0]]), 6.0)
    for frame in range(30):
        turn, (x, y) = np.deg2rad(2.0 * frame), (150.0, 160.0)
        place = np.array([[np.cos(turn), -np.sin(turn), x], [np.sin(turn), np.cos(turn), y]]) @ np.array(
            [[1, 0, -12], [0, 1, -72], [0, 0, 1.0]]
        )
        seen = cv2.warpAffine(skin, place, (320, 240), paper.copy(), borderMode=cv2.BORDER_TRANSPARENT)
        seen = np.clip(cv2.GaussianBlur(seen, (0, 0), 0.8) + rng.normal(0, 2, seen.shape), 0, 255).astype(np.uint8)
        still.look(seen)
        assert (still.moved == np.eye(2, 3)).all(), f"frame {frame} is turned back"


@pytest.mark.parametrize("shaken", [True, False])
def test_a_hand_that_shakes_by_a_px_or_two_is_followed_and_a_ball_that_swings_is_not(shaken):
    """A plain wall with four screws and a block's edges; a ball on the body's end shows more than all of them."""
    rng = np.random.default_rng(3)
    room = np.full((240, 320, 3), (150, 155, 160), np.uint8)
    cv2.rectangle(room, (20, 60), (60, 180), (70, 70, 75), -1)
    for x, y in ((100, 20), (300, 30), (110, 225), (295, 215), (200, 15), (220, 228)):
        cv2.circle(room, (x, y), 5, (60, 60, 60), -1, cv2.LINE_AA)
    still, off, turned = StillView(np.array([[60.0, 120.0], [180.0, 120.0]]), 8.0), [], False
    for frame in range(30):
        x, y = (1.5 * np.sin(1.1 * frame), 1.2 * np.cos(0.8 * frame) - 1.2) if shaken else (0.0, 0.0)
        picture = room.copy()
        cv2.circle(picture, (190 + round(20 * np.sin(0.3 * frame)), 120 + 2 * frame), 14, (40, 40, 200), -1, cv2.LINE_AA)
        picture = cv2.warpAffine(picture, np.array([[1.0, 0.0, x], [0.0, 1.0, y]]), (320, 240), borderMode=cv2.BORDER_REPLICATE)
        picture = np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)
        still.look(picture)
        turned = bool((still.moved != np.eye(2, 3)).any())
        off.append(np.abs(still.moved[:, 2] + (still.moved[:, :2] - np.eye(2)) @ [60.0, 120.0] - [x, y]).max())
    assert turned == shaken and (not shaken or max(off) < 0.3)


def test_a_hose_before_a_plain_wall_does_not_take_the_view_along():
    """All that stands out of the wall is a hose that moves, and what holds the body: it rests, and so does the view."""
    rng, clamp = np.random.default_rng(5), np.array([[52.0, 40.0], [68.0, 40.0]])
    line, x = np.array([[60.0, 40.0], [60.0, 110.0]]), np.arange(330)

    def picture(frame, view):
        room = np.full((240, 320, 3), (150, 155, 160), np.uint8)
        cv2.rectangle(room, (46, 2), (74, 40), (40, 40, 200), -1)
        cv2.rectangle(room, (52, 12), (68, 18), (220, 220, 220), -1)
        hose = np.column_stack([x, 170.0 + 30.0 * np.cos(0.015 * x) - 1.2 * frame - 0.004 * frame * x]).round().astype(np.int32)
        cv2.polylines(room, [hose], False, (180, 60, 30), 9, cv2.LINE_AA)
        room = cv2.warpAffine(room, view, (320, 240), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return np.clip(cv2.GaussianBlur(room, (0, 0), 0.8) + rng.normal(0, 2, room.shape), 0, 255).astype(np.uint8)

    for shaken in (0.0, 0.5):
        alone, held = StillView(line, 8.0), StillView(line, 8.0, HeldView(clamp, line, 8.0))
        for frame in range(16):
            view = np.array([[1.0, 0.0, shaken * frame], [0.0, 1.0, -0.4 * shaken * frame]])
            for still in (alone, held):
                still.look(picture(frame, view))
        away = [np.linalg.norm((still.moved - view) @ [60.0, 100.0, 1.0]) for still in (alone, held)]
        assert away[0] > 6.0 and away[1] < 1.0, away


def base_alone(view: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A holder with a label before a wall that shows nothing."""
    room = np.full((480, 640, 3), (150, 155, 160), np.uint8)
    cv2.rectangle(room, (266, 142), (294, 180), (40, 40, 200), -1)
    cv2.rectangle(room, (272, 152), (288, 158), (220, 220, 220), -1)
    room = cv2.warpAffine(room, view, (640, 480), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.clip(cv2.GaussianBlur(room, (0, 0), 0.8) + rng.normal(0, 2, room.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shaken", [0.0, 1.0])
def test_before_a_wall_that_shows_nothing_the_base_tells(shaken):
    rng, line, clamp = np.random.default_rng(6), np.array([[280.0, 180.0], [280.0, 260.0]]), np.array([[272.0, 180.0], [288.0, 180.0]])
    alone, held = StillView(line, 8.0), StillView(line, 8.0, HeldView(clamp, line, 8.0))
    for frame in range(14):
        view = np.array([[1.0, 0.0, shaken * 4.0 * np.sin(0.5 * frame)], [0.0, 1.0, -shaken * 3.0 * np.sin(0.3 * frame)]])
        for still in (alone, held):
            still.look(base_alone(view, rng))
        assert (alone.moved == np.eye(2, 3)).all()
        assert np.linalg.norm((held.moved - view) @ [280.0, 260.0, 1.0]) < (1.0 if shaken else 0.01)


def test_a_lens_that_focuses_is_followed_about_a_base_that_rests():
    """The view grows about the very place at which the body is held."""
    first, line, clamp = wall(60), np.array([[100.0, 120.0], [100.0, 200.0]]), np.array([[92.0, 120.0], [108.0, 120.0]])
    still, rng = StillView(line, 8.0, HeldView(clamp, line, 8.0)), np.random.default_rng(0)
    still.look(first)
    for step in range(1, 6):
        view = drifting(0.0, 0.0, 0.03, (200, 240), step / 5)
        seen = cv2.warpAffine(first, view, (200, 240), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        still.look(np.clip(seen + rng.normal(0, 3, seen.shape), 0, 255).astype(np.uint8))
    np.testing.assert_allclose(still.moved, view, atol=0.3)


def test_light_that_changes_does_not_move_a_ruled_wall():
    ruled = np.full((240, 320), 185.0)
    ruled[::12] -= 14.0
    ruled[:, ::12] -= 14.0
    ruled = cv2.GaussianBlur(ruled, (0, 0), 0.9) + np.linspace(-30.0, 30.0, 320)  # lit from one side
    still, rng = StillView(np.array([[60.0, 120.0], [200.0, 120.0]]), 8.0), np.random.default_rng(0)
    for frame in range(14):
        grey = np.clip(ruled * (1.0 + 0.05 * np.sin(0.07 * frame)) + rng.normal(0.0, 1.0, ruled.shape), 0, 255)
        seen = np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
        still.look(seen)
        assert (still.moved == np.eye(2, 3)).all()


def test_a_wall_that_shows_nothing_leaves_pictures_as_they_are():
    still = StillView(np.array([[100.0, 20.0], [100.0, 200.0]]), 8.0)
    still.look(wall(2))
    still.look(np.roll(wall(2), 5, axis=1))
    assert (still.moved == np.eye(2, 3)).all()


@pytest.mark.parametrize(("x", "y", "zoom"), [(10.0, -6.0, 0.02)])
def test_a_film_whose_camera_drifts_is_measured_as_if_it_had_stayed(x, y, zoom, tmp_path):
    arm, room = (
        Arm(opacity=0.8, rgb=(90.0, 150.0, 120.0)),
        Room((240, 260), 2.2, (120.0, 40.0), ruled=6.0, clutter=3, seed=4),
    )
    bends = -np.concatenate([np.linspace(0.05, 0.9, 12), np.linspace(0.85, 0.05, 12)])

    def seen(number: int) -> np.ndarray:
        return drifting(x, y, zoom, room.size, number / 23)

    truth = film(tmp_path / "film.mp4", arm, room, bends, view=seen)
    source = open_video(tmp_path / "film.mp4")
    calibration = scaled_by_distance(source.size, [[120.0, 40.0], [230.0, 40.0]], 50.0)
    actuator = Actuator(outer_radius=arm.half_width / 1e3, inner_radius=arm.half_width / 2e3, length=arm.length / 1e3)
    hints = Hints(clamp=truth.clamp_px, tip=truth.tip_px)
    track = track_frames(source, calibration, actuator, hints=hints, vertical="image")
    assert track.dataset.attrs["followed_by"] == "body" and track.valid.mean() >= 0.95
    tips = in_frame(track, project(camera_vector(calibration), rig_to_plane(track, track.dataset["tip"].values))[:, None])[:, 0]
    ends = [view[:, :2] @ tip + view[:, 2] for view, tip in zip(map(seen, range(24)), truth.centre_px[:, -1], strict=True)]
    assert np.nanmedian(np.linalg.norm(tips - ends, axis=1)[-6:]) < 3.0, "drawn where the frame shows it"
    off = np.linalg.norm(track.dataset["tip"].values - truth.tip_mm, axis=1)
    swing = np.ptp(truth.tip_mm, axis=0).max()
    assert np.nanmedian(off[-6:]) < 0.03 * swing  # 12 px are 5.4 mm, a tenth of the swing
    assert np.sqrt(np.nanmean(off**2)) < 0.035 * swing
