"""Clamp and tip that were pointed at beside the body: it is said which of them, and where the body is instead."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.errors import DataError
from rfea_vision.vision import advice
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.clicks import aside
from rfea_vision.vision.follow.follower import Follower
from rfea_vision.vision.scene import make_scene
from rfea_vision.vision.track import track_frames
from rfea_vision.vision.trials import Trial, Trials
from testing.sources import memory_source

CLAMP, TIP = ((108.0, 40.0), (132.0, 40.0)), (120.0, 200.0)


def drawn(body: int = 205, number: int = 0) -> np.ndarray:
    """A body of 24 x 160 px in a dark block before a mottled wall."""
    wall = cv2.GaussianBlur(np.random.default_rng(1).normal(0, 1, (260, 240, 3)), (0, 0), 3.0)
    picture = 90 + 6 * wall / wall.std()
    cv2.rectangle(picture, (108, 40), (132, 200), (body, body, body), -1)
    cv2.rectangle(picture, (94, 0), (146, 39), (25, 25, 25), -1)
    noise = np.random.default_rng(number).normal(0, 2, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


def pointed_at(**hints: Any) -> Any:
    """A scene of a tube of 80 mm, 2 px per mm."""
    scale = scaled_by_distance((240, 260), [[0, 0], [100, 0]], 50.0)
    actuator = Actuator(outer_radius=0.006, inner_radius=0.003, length=0.08)
    return make_scene(scale, actuator, "image", Hints(**{"clamp": CLAMP, "tip": TIP} | hints), (240, 260))


def film_of(pictures: list[np.ndarray]) -> Any:
    times = np.arange(len(pictures)) / 30.0
    colours = lambda scale: (pair for pair in zip(times, pictures, strict=True))  # noqa: E731
    return SimpleNamespace(size=(240, 260), colours=colours, times_s=lambda: times)


def looked(picture: np.ndarray, **hints: Any) -> BodyFollower:
    follower = BodyFollower(pointed_at(**hints), 1.0)
    follower.next(picture, 0.0)
    return follower


@pytest.mark.parametrize(
    ("hints", "name", "places"),
    [
        ({}, None, None),
        ({"tip": (124.0, 197.0)}, None, None),  # as people point
        ({"tip": (120.0, 232.0)}, "tip", [120, 200]),
        ({"tip": (154.0, 204.0)}, "tip", [120, 200]),
        ({"tip": (204.0, 150.0)}, "tip", [120, 200]),
        ({"tip": (120.0, 166.0)}, "tip", [120, 200]),  # on the body, before its end
        ({"clamp": ((138.0, 42.0), (162.0, 42.0))}, "clamp", [120, 42]),
        ({"clamp": ((134.0, 42.0), (158.0, 42.0))}, "clamp", [120, 42]),
    ],
)
def test_a_click_beside_the_body_is_known_and_where_the_body_is(hints, name, places):
    """Such films were followed to their end, with a tip or a clamp 14 px off and more, or were told to put up another light."""
    picture = drawn()
    found = aside(looked(picture, **hints))
    assert (found.name if found else None) == name
    if found:
        assert np.abs(found.places.reshape(-1, 2).mean(axis=0) - places).max() < 5.0
        assert found.length_mm == pytest.approx(80.0, rel=0.05)


def test_no_click_is_called_wrong_where_the_rest_of_the_body_looks_like_the_wall():
    """Then nothing as long as the tube ends elsewhere."""
    picture = drawn()
    picture[140:202, 100:140] = picture[140:202, 40:80]
    assert aside(looked(picture)) is None


def test_what_was_found_instead_is_tried_before_it_is_said():
    film = film_of([drawn(number=k) for k in range(6)])
    said = advice.clicked_aside(Trials(film, pointed_at(tip=(120.0, 232.0)), 6), [""] * 6)
    assert said.startswith("camera.tip was pointed at beside the tube, or not at its end: check this against the first frame")
    assert "tried, it reads 6 of the first 6 frames, and 6 were read without it" in said
    assert advice.clicked_aside(Trials(film, pointed_at(), 6), [""] * 6) == ""
    said = advice.clicked_aside(Trials(film, pointed_at(clamp=((138.0, 42.0), (162.0, 42.0))), 6), ["off_hints"] * 6)
    assert "give it: camera.clamp: [[" in said
    lost = film_of([drawn(), *[drawn(body=92, number=k) for k in range(1, 6)]])
    assert advice.clicked_aside(Trials(lost, pointed_at(tip=(120.0, 232.0)), 6), [""] * 6) == "", "it reads less than was read before"


@pytest.mark.parametrize(
    ("hints", "said"),
    [
        ({"tip": (220.0, 100.0)}, r"from [3-8]\d % on \(of the way from clamp to tip\) what was pointed at looks like the wall"),
        ({"clamp": ((40.0, 180.0), (40.0, 204.0))}, r"(from|up to) \d\d % (on )?\(of the way from clamp to tip\) what was pointed"),
        ({"clamp": ((30.0, 40.0), (54.0, 40.0)), "tip": (42.0, 200.0)}, r"(from|up to) \d* % .* check camera\.clamp and camera\.tip"),
        ({"clamp": ((96.0, 40.0), (144.0, 40.0))}, "camera.clamp is 24 mm wide by the scale, and the tube 12 mm by actuator"),
    ],
)
def test_hints_beside_the_body_are_not_answered_with_light(hints, said):
    for number in range(4):
        answer = advice.film_lacks(Trials(film_of([drawn(number=number)]), pointed_at(**hints), 1))
        assert re.match(said, answer), (number, answer)


def test_a_line_in_the_wrong_order_is_tried_without(monkeypatch):
    """It was said to bend towards the camera."""
    film = film_of([drawn(number=k) for k in range(6)])
    monkeypatch.setattr(advice, "base_moved", lambda *_: "")
    scene = pointed_at(centre_line=((120.0, 160.0), (120.0, 80.0)))
    assert looked(drawn(), **{"centre_line": scene.hints.centre_line}).refusal
    said = advice.next_hint(Trials(film, scene, 6), ["no_fit: the line that fits is folded"] * 6)
    assert said.startswith("check this against the picture and give it: camera.clamp and camera.tip alone, without camera.centre_line")
    assert advice.next_hint(Trials(film, replace(scene, hints=Hints(clamp=CLAMP, tip=TIP)), 6), [""] * 6)


def test_a_guess_that_its_first_frame_refuses_is_looked_at_no_further(monkeypatch):
    """Each further frame is sought in as many ways as the first: of a film without hints the guesses took minutes."""
    looked_at, next_frame = [], BodyFollower.next

    def counted(self, picture, time_s):
        looked_at.append(time_s)
        return next_frame(self, picture, time_s)

    monkeypatch.setattr(BodyFollower, "next", counted)
    told: list[tuple[int, int]] = []
    trials = Trials(film_of([drawn(number=k) for k in range(6)]), pointed_at(), 6, lambda *share: told.append(share))
    beside = replace(trials.scene.hints, clamp=((40.0, 60.0), (64.0, 60.0)), tip=(52.0, 220.0))
    assert trials.of(beside) == Trial(0, 0.0) and len(looked_at) == 1 and told == []
    assert trials.of(trials.scene.hints).good == 6 and len(looked_at) == 7
    assert told == [(k, 6) for k in range(1, 7)], "a bar shows how far a trial is"


def test_guesses_are_tried_once_and_only_as_far_as_they_are_asked_for(monkeypatch):
    """Where what is followed rests and too little is read, two sentences ask for them: each had tried them all, for a minute."""
    tried = []

    def counted(self, hints):
        tried.append(hints.tip)
        return Trial(len(tried), 1.0)

    monkeypatch.setattr(Trials, "of", counted)
    monkeypatch.setattr("rfea_vision.vision.trials._suggested", lambda _: ((Hints(tip=(k, k)), f"guess {k}") for k in range(3)))
    trials = Trials(film_of([drawn()]), pointed_at(), 1)
    assert next(trials.guesses()).words == "guess 0" and tried == [(0, 0)]
    assert [(guess.words, guess.trial.good) for guess in trials.guesses()] == [("guess 0", 1), ("guess 1", 2), ("guess 2", 3)]
    assert len(list(trials.guesses())) == len(tried) == 3


def test_a_film_that_a_line_leads_astray_in_is_read_by_its_ends_where_the_tube_passes_that_line(monkeypatch):
    """It was read by nothing, and told to be read without the line; where a point lies beside the tube it still is."""
    monkeypatch.setattr(Follower, "next", lambda *_: "no_tube")  # edges read this one
    pictures = [cv2.cvtColor(drawn(number=k), cv2.COLOR_BGR2GRAY) for k in range(6)]
    source, scene = memory_source(pictures, np.arange(6) / 30.0), pointed_at()
    calibration = scaled_by_distance((240, 260), [[0, 0], [100, 0]], 50.0)

    def read(*points: tuple[float, float]) -> Any:
        hints = replace(scene.hints, centre_line=points)
        return track_frames(source, calibration, scene.actuator, hints=hints, vertical="image")

    swapped = read((120.0, 160.0), (120.0, 80.0))
    assert swapped.valid.all() and swapped.dataset.attrs["advice"].startswith("it was read by camera.clamp and camera.tip alone")
    assert "advice" not in read((120.0, 80.0), (120.0, 160.0)).dataset.attrs
    with pytest.raises(DataError, match=r"alone, without camera\.centre_line"):
        read((120.0, 160.0), (160.0, 80.0))
