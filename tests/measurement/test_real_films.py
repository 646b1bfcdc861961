"""What is pointed at in real films is well-formed, and a track is held against it as it should be."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from testing.real_films import POINTED, Ends, FilmFile, FramesPart, mark_places, pointed_at, score

FILMS = pointed_at()


@pytest.mark.parametrize("name", FILMS)
def test_what_is_pointed_at_makes_sense(name: str):
    film = FILMS[name]
    calibration = film.calibration((1920, 1920))
    assert calibration.quality["scale_stderr_percent"] < 15  # of one who points at 98 px in a picture that large
    clamp, tip = np.array(film.hints.clamp), np.array(film.hints.tip)
    length_px = np.linalg.norm(np.diff([clamp.mean(axis=0), *film.hints.centre_line, tip], axis=0), axis=1).sum()
    # Length and radius are guessed by the scale that is pointed at: they say how the body looks.
    assert film.camera.scale is not None and film.camera.scale != "tube"
    px_per_m = np.linalg.norm(np.subtract(*film.camera.scale.points)) / film.camera.scale.distance
    assert film.tube.length * px_per_m == pytest.approx(length_px, rel=0.1)
    assert film.tube.outer_radius * px_per_m == pytest.approx(film.half_width_px, rel=0.15)
    assert length_px > 1.4 * 2 * film.half_width_px  # the stoutest, a gripper's arm, is 1.48 times as long as wide
    if film.end == "mark":
        assert film.mark is not None
    first = film.tips.get(film.stills[0] if film.stills else film.frames.first)
    if first is not None:
        assert np.linalg.norm(tip - first) <= 3 * film.hand_px


def test_frames_are_found_by_their_numbers_in_the_file():
    content = yaml.safe_load((POINTED / "arm_test_upper_mark.yaml").read_text(encoding="utf-8"))
    every_third = FilmFile.model_validate({**content, "frames": {"first": 10, "stop": 20, "step": 3}})
    assert [every_third.row_of(number) for number in (9, 10, 11, 13, 19, 22)] == [None, 0, None, 1, 3, None]
    stills = FilmFile.model_validate({**content, "stills": [90, 8, 55]})
    assert [stills.row_of(number) for number in (90, 55, 9)] == [0, 2, None]


def test_a_folder_of_pictures_is_a_film(tmp_path):
    film = FILMS["startled_larva"]
    folder = film.film(tmp_path)
    folder.mkdir(parents=True)
    for number in range(8, 12):
        cv2.imwrite(str(folder / f"film_{number}.tif"), np.full((6, 8), number, np.uint8))
    source = film.model_copy(update={"frames": FramesPart(first=1, stop=4, step=2)}).opened(tmp_path)
    assert [int(picture[0, 0]) for _, picture in source.frames()] == [9, 11] and source.size == (8, 6)


def test_another_hand_points_a_pixel_or_two_beside_what_is_kept():
    film = FILMS["hinged_arm"]
    one, again, other = (film.clicked_again(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one == again != other
    assert one.camera.scale == film.camera.scale and one.tips == film.tips
    for key in ("clamp", "tip", "centre_line"):
        off = np.subtract(getattr(one.camera, key), getattr(film.camera, key))
        assert 0.0 < np.abs(off).max() < 5.0
    assert film.begun_at(64).clicked_again(np.random.default_rng(1)).camera.centre_line is None


def test_there_are_films_of_both_kinds():
    assert {film.end for film in FILMS.values()} == {"mark", "end"}
    assert len({(film.path, film.camera.clamp, film.end) for film in FILMS.values()}) == len(FILMS)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"commit": "f31f06e"}, "commit"),
        ({"tips": {0: [368, 186], 7: [370, 186]}, "frames": {"step": 5}}, "none of those that are read"),
        ({"tips": {0: [368, 186]}, "mark": None}, "two at least"),
        ({"camera": {"clamp": [[355, 401], [394, 401]]}}, "clamp and tip"),
        ({"holder": "middle"}, "holder"),
    ],
)
def test_a_film_that_is_described_badly_is_refused(change: dict, what: str):
    content = yaml.safe_load((POINTED / "arm_test_upper_mark.yaml").read_text(encoding="utf-8"))
    with pytest.raises(ValidationError, match=what):
        FilmFile.model_validate({**content, **change})


def test_the_score_counts_what_is_read_off_and_sure():
    true = np.stack([np.linspace(0.0, 90.0, 10), np.zeros(10)], axis=1)
    true[3] = np.nan  # nobody saw the end there
    tip, sigma = true + np.array([3.0, 4.0]), np.full((10, 2), 4.0)
    tip[3] = [30.0, 400.0]  # and nothing is held against it
    tip[5:7] = np.nan  # refused
    tip[8] += [0.0, 26.0]  # off by 30 px, and sure
    tip[9] += [0.0, 26.0]  # as far, and says so
    sigma[9] = 20.0
    found = score(Ends(tip, sigma, np.zeros(10)), true, hand_px=3.0, half_width_px=20.0)
    assert (found.read, found.frames, found.compared) == (8, 10, 7)
    assert found.range_px == pytest.approx(90.0)
    apart = [5.0] * 5 + [np.hypot(3, 30)] * 2
    assert found.error == pytest.approx(np.sqrt(np.mean(np.square(apart))) / 90)
    assert found.covered == pytest.approx(13 / 14)  # 30 px are six standard errors of 5 px, and 1.5 of 20.2
    assert found.sure_and_wrong == 1


def test_what_is_off_by_less_than_half_a_half_width_is_not_wrong():
    true = np.array([[0.0, 0.0], [50.0, 0.0]])
    found = score(Ends(true + 9.0, np.full((2, 2), 0.1), np.zeros(2)), true, hand_px=0.1, half_width_px=30.0)
    assert found.sure_and_wrong == 0
    assert found.covered == 0.0


def test_what_was_off_at_first_is_carried_with_the_end():
    """A mark beside the line's end, which turns by a quarter as it goes up."""
    heading = np.linspace(0.0, -np.pi / 2, 5)
    tip = 100 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    beside = 6 * np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    found = score(Ends(tip, np.full((5, 2), 9.0), heading), tip + beside, hand_px=1.0, half_width_px=30.0)
    assert found.error == pytest.approx(6 / found.range_px)
    assert found.carried == pytest.approx(0.0, abs=1e-12)


def test_a_film_of_which_nothing_is_read_has_no_error():
    true = np.array([[0.0, 0.0], [50.0, 0.0]])
    found = score(Ends.none(2), true, hand_px=1.0, half_width_px=30.0)
    assert (found.read, found.compared, found.sure_and_wrong) == (0, 0, 0)
    assert np.isnan(found.error) and np.isnan(found.carried)


def test_the_middle_of_a_mark_is_found_in_every_picture():
    """A disc that goes by 4 px a picture beside another of its colour, and is covered in one of them."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:120, :200]
    places = np.array([[40.0 + 4 * k, 60.0 + k] for k in range(20)])
    pictures = []
    for k, (at_x, at_y) in enumerate(places):
        picture = rng.integers(90, 110, (120, 200, 3)).astype(np.uint8)
        picture[np.hypot(x - at_x, y - at_y) < 9] = (30, 30, 180)
        picture[np.hypot(x - 40, y - 100) < 9] = (30, 30, 180)
        if k == 10:
            picture[:, 70:] = 100
        pictures.append(picture)
    found = mark_places(pictures, "red", places[0] + [2.0, -1.0])
    seen = np.arange(20) != 10
    assert np.isnan(found[10]).all()
    np.testing.assert_allclose(found[seen], places[seen], atol=0.5)
