"""Bodies that are tracked as a whole: what is a line, an end and a wall, by single pictures and by rules."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.projection import unproject
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.vision.body.around import SURELY, looks_around, off_beside
from rfea_vision.vision.body.begin import Pointed, first_body, hinted_lines
from rfea_vision.vision.body.fit import Fit, off_middle
from rfea_vision.vision.body.follower import BodyFollower
from rfea_vision.vision.body.model import SHARES, STATIONS, SeenBody
from rfea_vision.vision.body.rules import First, elsewhere, may_go_on, refused
from rfea_vision.vision.body.sampling import Behind, support
from rfea_vision.vision.body.wall import Wall
from rfea_vision.vision.edges.fitted import new_buffers
from rfea_vision.vision.find.begin import begin, beside, digits_of, length_of, off_hints
from rfea_vision.vision.scene import make_scene


@pytest.mark.parametrize(
    ("more", "taken"),
    [
        ({"colour": (60, 160, 90)}, "bowed"),
        ({"colour": (200, 120, 60)}, "straight"),
        ({"exclude": ((105.0, 90.0, 30.0, 60.0),)}, "bowed"),
        ({"region": (90.0, 20.0, 60.0, 200.0)}, "straight"),
    ],
)
def test_hints_decide_between_two_lines_from_clamp_to_tip(more, taken):
    """A bowed green arm and a straight orange strip join the clamp and the tip; each is as clear as the other."""
    t = np.linspace(0, 1, 80)[:, None]
    straight = np.array([120.0, 40.0]) + t * np.array([0.0, 160.0])
    lines = {"straight": straight, "bowed": straight + np.hstack([60.0 * np.sin(np.pi * t), 0.0 * t])}
    picture = np.full((260, 260, 3), 220, dtype=np.uint8)
    for name, rgb in (("straight", (200, 120, 60)), ("bowed", (60, 160, 90))):
        cv2.polylines(picture, [np.round(lines[name]).astype(np.int32)], False, rgb[::-1], 19)
    calibration = scaled_by_distance((260, 260), [[0, 0], [100, 0]], 50.0)
    actuator = Actuator(outer_radius=0.005, inner_radius=0.002, length=0.09)
    hints = Hints(clamp=((110.0, 40.0), (130.0, 40.0)), tip=(120.0, 200.0), **more)
    follower = BodyFollower(make_scene(calibration, actuator, "image", hints, (260, 260)), 1.0)
    follower.next(picture, 0.0)
    assert np.linalg.norm(follower.body.points[32] - lines[taken][40]) < 6.0


@pytest.mark.parametrize(("askew_deg", "refusal"), [(15.0, ""), (45.0, "leaves camera.clamp 4")])
def test_a_line_that_leaves_the_clamp_askew_is_another_things(askew_deg, refusal):
    """A strip goes straight from the clamp to the tip, and the clamp's edges are not square to it."""
    picture = np.full((240, 260, 3), (225, 222, 220), np.uint8)
    cv2.line(picture, (60, 120), (200, 120), (60, 120, 200), 17)
    dx, dy = 8.0 * np.sin(np.deg2rad(askew_deg)), 8.0 * np.cos(np.deg2rad(askew_deg))
    clamp = (60.0 + dx, 120.0 + dy), (60.0 - dx, 120.0 - dy)
    calibration = scaled_by_distance((260, 240), [[60, 120], [200, 120]], 70.0)
    actuator = Actuator(outer_radius=4e-3, inner_radius=2e-3, length=70e-3)
    follower = BodyFollower(
        make_scene(calibration, actuator, "image", Hints(clamp=clamp, tip=(200.0, 120.0)), (260, 240)), 1.0
    )
    found = follower.next(picture, 0.0)
    assert refusal in found and bool(found) == bool(refusal), found


def test_a_click_between_two_points_of_a_long_thin_line_lies_on_it():
    """Of a rod 707 px long and 8 px wide a click on it was called 4.5 px off: so far it lay from the nearest station."""
    line = np.column_stack([np.linspace(0.0, 707.0, 65), np.zeros(65)])
    assert beside(line, np.array([line[7, 0] + 5.5, 0.3])) == pytest.approx(0.3)
    assert beside(line, np.array([-3.0, 4.0])) == pytest.approx(5.0), "before its first point"
    assert beside(line[:1], np.array([3.0, 4.0])) == pytest.approx(5.0)


def test_a_line_that_strays_to_the_border_is_no_tip_that_left_the_picture():
    """What was lost elsewhere before is not told to film a wider view; a tip that was followed to the border is."""
    picture = np.full((240, 260, 3), (225, 222, 220), np.uint8)
    cv2.line(picture, (60, 120), (200, 120), (60, 120, 200), 17)
    calibration = scaled_by_distance((260, 240), [[60, 120], [200, 120]], 70.0)
    actuator = Actuator(outer_radius=4e-3, inner_radius=2e-3, length=70e-3)
    hints = Hints(clamp=((60.0, 112.0), (60.0, 128.0)), tip=(200.0, 120.0))
    follower = BodyFollower(make_scene(calibration, actuator, "image", hints, (260, 240)), 1.0)
    assert follower.next(picture, 0.0) == ""
    lab, body = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2LAB), np.uint8), follower.body
    body = replace(body, points=body.points + np.linspace(0, 1, STATIONS)[:, None] * np.array([-40.0, 119.0]))
    seen, rays = np.zeros((STATIONS, 2), bool), np.full(7, np.nan)
    stray = Fit(body, 1e-3 * np.eye(25), seen, np.zeros(STATIONS), rays, ())
    told = []
    for follower.missed, follower.refusal in ((0, ""), (4, "no_fit: folded"), (4, "touches_border: the tip")):
        told.append(follower._judged(lab, stray).reason.split(":")[0])
    assert told == ["touches_border", "no_tube", "touches_border"]


@pytest.mark.parametrize("length_mm", [0.7, 2.0])
def test_a_body_under_a_microscope_has_ends_too(length_mm):
    """Windows in which an end is looked for are longer than all of this body."""
    picture = np.zeros((240, 260), np.uint8)
    cv2.line(picture, (60, 120), (200, 120), 200, 16)
    calibration = scaled_by_distance((260, 240), [[60, 120], [200, 120]], length_mm)
    actuator = Actuator(outer_radius=0.0571e-3 * length_mm, inner_radius=0.01e-3 * length_mm, length=length_mm / 1e3)
    hints = Hints(clamp=((60.0, 112.0), (60.0, 128.0)), tip=(200.0, 120.0))
    found = begin(picture, make_scene(calibration, actuator, "image", hints, (260, 240)), new_buffers())
    assert not isinstance(found, str), found
    assert abs(length_of(found.state) / length_mm - 1.0) < 0.1
    assert f"{0.33:.{digits_of(length_mm)}f}" == f"{0.33:.{2 if length_mm < 1 else 1}f}"


def test_the_share_of_a_line_that_lies_where_the_arm_never_is():
    allowed = np.ones((120, 120), dtype=bool)
    line = np.column_stack([np.full(50, 60.0), np.linspace(10.0, 110.0, 50)])
    allowed[:, 40:80] = False
    assert elsewhere(allowed, line) == 1.0
    allowed[60:] = True
    assert 0.4 < elsewhere(allowed, line) < 0.6
    assert elsewhere(None, line) == 0.0


def test_a_thin_body_is_found_beside_the_clicks_and_a_short_one_is_not_folded():
    """A wire of 5 px clicked up to 5 px beside it, and a finger that is twice as long as wide with a round end."""
    shares = np.linspace(0.0, 1.0, 200)
    wire = np.column_stack([60 + 180 * shares, 60 + 120 * shares**2])
    picture = np.full((240, 320, 3), (160, 128, 128), np.uint8)
    cv2.polylines(picture, [np.round(wire * 16).astype(np.int32)], False, (60, 128, 128), 5, cv2.LINE_AA, 4)
    clicked = wire[[0, 70, 130, 199]] + np.array([[0, 0], [-3, 4], [-3, 4], [0, 0]])
    off = [
        np.linalg.norm(line[:, None] - wire[None], axis=2).min(axis=1)[5:-5]
        for line in hinted_lines(picture, Pointed(wire[0] + np.array([[1, -2.5], [-1, 2.5]]), clicked, 2.5, 220.0))
    ]
    assert off[0].max() > 3.5 and off[1].max() < 1.0, "as it was drawn, and as it is"

    finger = np.full((160, 200, 3), 60, np.uint8)
    cv2.line(finger, (60, 80), (112, 80), (200, 210, 205), 41, cv2.LINE_AA)
    finger[:, :60] = 60
    scene = make_scene(
        scaled_by_distance((200, 160), [[0, 0], [100, 0]], 100.0),
        Actuator(outer_radius=0.02, inner_radius=0.01, length=0.072),
        "image",
        Hints(clamp=((60.0, 60.0), (60.0, 100.0)), tip=(131.0, 88.0), centre_line=((80.0, 80.0), (105.0, 80.0))),
        (200, 160),
    )
    follower = BodyFollower(scene, 0.6)
    small = np.asarray(cv2.resize(finger, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    assert follower.next(small, 0.0) == ""
    turns = np.diff(np.unwrap(np.arctan2(*np.diff(follower.body.points, axis=0).T)))
    assert np.abs(np.cumsum(turns)).max() < 1.0


def as_first(body):
    """What was seen of a body in the first frame: all of it."""
    everywhere, rays = np.ones((STATIONS, 2), bool), np.full(7, np.nan)
    return Fit(body, 1e-3 * np.eye(25), everywhere, np.ones(STATIONS), rays, ())


def test_a_line_that_turns_within_its_width_is_folded_and_where_is_said():
    """A turn of 140 degrees over 20 px, at two fifths of a line: of a body 8 px wide, and of one that is 20 px wide."""
    heading = 2.5 * np.clip((SHARES - 0.35) / 0.1, 0.0, 1.0)
    line = 60.0 + 200.0 / 64 * np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    first = First(200.0, np.full(STATIONS, 6.0), (300, 300), 100.0, 2.0, None)
    bodies = [first_body(np.zeros((300, 300, 3), np.uint8), line, half) for half in (4.0, 10.0)]
    thin, wide = (refused(first, as_first(body)) for body in bodies)
    assert thin == "" and re.fullmatch(r"no_fit: the line that fits is folded, (3[5-9]|4[0-5]) mm from the clamp", wide)


@pytest.mark.parametrize(("times", "says"), [(2.2, ""), (2.6, "2.6"), (0.6, ""), (0.4, "0.4")])
def test_a_body_that_would_be_much_wider_than_at_first_or_thinner_is_another_thing(times, says):
    """A muscle's line had come to three times its first width, and lay over the felt beside it."""
    line = 60.0 + np.column_stack([200.0 * SHARES, 0.0 * SHARES])
    body = first_body(np.zeros((300, 300, 3), np.uint8), line, 8.0)
    first = First(200.0, body.half, (300, 300), 100.0, 2.0, None, as_first(body))
    swollen = as_first(replace(body, half=times * body.half))
    assert refused(first, swollen) == (says and f"no_fit: the line that fits is {says} times as wide as in the first frame")


def test_a_line_that_crosses_the_wall_to_another_thing_is_refused_and_where_is_said():
    line = 60.0 + np.column_stack([200.0 * SHARES, 0.0 * SHARES])
    body = first_body(np.zeros((300, 300, 3), np.uint8), line, 8.0)
    first = First(200.0, body.half, (300, 300), 100.0, 2.0, None, as_first(body))
    crossing = (SHARES > 0.5) & (SHARES < 0.65)
    nothing, edged = as_first(body), as_first(body)
    nothing.backing[crossing], nothing.seen[crossing] = 0.2, False
    edged.backing[crossing] = 0.2
    said = refused(first, nothing)
    assert re.fullmatch(r"no_tube: neither the tube nor an edge of it is seen 5[0-3] to 6[3-5] mm from the clamp", said)
    assert refused(first, edged) == "", "a stretch of another colour that has its edges is the body's"


def test_a_line_beyond_whose_end_the_tube_goes_on_is_refused_where_that_is_seen_and_else_sought_again():
    narrow = np.full((200, 160, 3), (60, 128, 128), np.uint8)
    narrow[:, 68:92] = (200, 120, 140)
    narrow[193:] = (60, 128, 128)
    line = np.column_stack([np.full(STATIONS, 80.0), 10 + 180 * SHARES])
    body, wall = first_body(narrow, line, 12.0), Wall(narrow.shape)
    first = First(180.0, body.half, narrow.shape[:2], 100.0, 1.8, None, as_first(body))
    first.fit.beyond[:] = 1.0

    def fitted(picture, seen, end=0.0, like=1.0, aslant=0.0):
        rays = np.array([np.nan, np.nan, end - aslant, end, end, end + aslant, np.nan])
        around = looks_around(picture, wall, body)
        return Fit(body, 1e-3 * np.eye(25), seen, np.where(SHARES > 0.83, like, 1.0), rays, (), *around)

    def said(*what, **told):
        return refused(first, fitted(*what, **told))

    everywhere = np.ones((STATIONS, 2), bool)
    assert said(narrow, everywhere) == ""
    assert said(narrow, everywhere, like=0.3) == "", "its end has its edges"
    beside_it = np.where(SHARES[:, None] > 0.83, [True, False], True)
    assert said(narrow, beside_it, like=0.3) == "tip_hidden: 30 % of the last body width looks like the tube, or has its edges"
    assert said(narrow, everywhere, 6.0) == "", (
        "what the rays find there is another thing: nothing of the tube is between"
    )
    body = replace(body, points=body.points * [1.0, 0.9])
    assert said(narrow, everywhere) == said(narrow, everywhere, np.nan) == "", (
        "the end is as good as there, or not seen"
    )
    assert said(narrow, everywhere, 6.0) == "", "an end that is seen within a half width is known to that"
    assert said(narrow, everywhere, 6.0, aslant=4.0) == "no_fit: the tube goes on beyond the line's end, by 3.3 mm or more"
    assert said(narrow, everywhere, 13.0) == "no_fit: the tube goes on beyond the line's end, by 7.2 mm or more"
    body = replace(body, points=body.points * [1.0, 0.9])
    assert not may_go_on(first, fitted(narrow, everywhere, np.nan)), "it went on from the first frame on"
    first.fit.beyond[:] = 0.4
    assert may_go_on(first, fitted(narrow, everywhere, np.nan)) >= 1.5 * 12.0 and said(narrow, everywhere, np.nan) == ""
    assert not may_go_on(first, fitted(narrow, everywhere, 6.0)), "its end is seen"
    assert not may_go_on(first, replace(fitted(narrow, everywhere, np.nan), length_told=True)), "its skin says where it ends"
    body = replace(body, points=body.points * [1.0, 1.17])
    assert not may_go_on(first, fitted(narrow, everywhere, np.nan)), "it may end within half its width"
    body = replace(body, half=np.where(SHARES > 0.95, 1.0, 0.8) * first.half)
    assert said(narrow, everywhere) == "", "drawn out, it is thinner all along"
    body = replace(body, points=np.vstack([body.points[0] + [[0.0, 0.0], [1.5, -1.0], [2.5, 1.0]], body.points[3:]]))
    assert said(narrow, everywhere) == "", "beside what holds it the line is known no better"


@pytest.mark.parametrize(
    ("left", "says"), [(0.45, ""), (0.2, "edge_lost: 20 % of the left edge and 9 % of the right one are seen")]
)
def test_what_a_frame_shows_is_more_than_chance_however_little_the_first_one_did(left, says):
    """Beside a body a fifth of an edge is found by chance; a thin arm had hardly more at first."""
    line = np.column_stack([np.full(STATIONS, 80.0), 10 + 180 * SHARES])
    body = first_body(np.zeros((200, 160, 3), np.uint8), line, 12.0)
    first = First(180.0, body.half, (200, 160), 100.0, 1.8, None, as_first(body))
    first.fit.seen = np.column_stack([SHARES < 0.3, SHARES < 0.3])
    seen = np.column_stack([left > SHARES, SHARES < 0.08])
    fit = Fit(body, 1e-3 * np.eye(25), seen, np.ones(STATIONS), np.full(7, np.nan), ())
    assert refused(first, fit) == says


def test_an_arm_that_rolls_up_lies_beside_itself_and_is_no_wider():
    turn = 2.6 * np.pi * np.linspace(0.0, 1.0, STATIONS)
    line = 110.0 + (66.0 - 25.0 * turn / (2 * np.pi))[:, None] * np.column_stack([np.sin(turn), np.cos(turn)])
    rolled = np.full((220, 220, 3), (60, 128, 128), np.uint8)
    cv2.polylines(rolled, [np.round(line * 16).astype(np.int32)], False, (200, 120, 140), 24, cv2.LINE_AA, 4)
    body, wall = first_body(rolled, line, 12.0), Wall(rolled.shape)
    body.outside[:, :, 0] = (60, 128, 128)
    first = First(body.length, body.half, (220, 220), 100.0, 3.0, None, as_first(body))
    beside, beyond = looks_around(rolled, wall, body)
    seen = np.nan_to_num(beside, nan=1.0) < 0.5
    fit = Fit(body, 1e-3 * np.eye(25), seen, np.ones(STATIONS), np.full(7, np.nan), (), beside, beyond)
    assert np.isnan(beside).any(axis=1).mean() > 0.3 and refused(first, fit) == ""
    assert off_beside(body, beside) < 1.0 < off_beside(body, np.nan_to_num(beside, nan=1.0))


def test_an_arm_that_ends_behind_its_clamp_leaves_it_on_the_side_to_which_it_goes():
    turn = np.linspace(np.pi, 2.3 * np.pi, 200)
    line = np.vstack([[[70.0, 130.0]], np.column_stack([120.0 + 50.0 * np.cos(turn), 90.0 + 50.0 * np.sin(turn)])])
    picture = np.full((200, 240, 3), 60, np.uint8)
    cv2.polylines(picture, [np.round(line * 16).astype(np.int32)], False, (200, 210, 205), 20, cv2.LINE_AA, 4)
    picture[120:] = np.where(np.arange(240)[:, None] < 100, 60, picture[120:])  # what holds it
    scene = make_scene(
        scaled_by_distance((240, 200), [[0, 0], [100, 0]], 100.0),
        Actuator(outer_radius=0.010, inner_radius=0.005, length=0.23),
        "image",
        Hints(((60.0, 120.0), (80.0, 120.0)), (144.0, 137.0), ((76.0, 67.0), (120.0, 40.0), (167.0, 75.0))),
        (240, 200),
    )
    follower = BodyFollower(scene, 1.25)
    assert follower.next(picture, 0.0) == ""
    np.testing.assert_allclose(follower.foot[1], [0.0, -1.0], atol=0.01)
    off = np.linalg.norm((follower.body.points[8:, None] + 0.5) / 1.25 - 0.5 - line[None], axis=2).min(axis=1)
    assert off[:-4].max() < 1.0, "up to its round end"


def test_a_line_that_leaves_the_middle_of_its_edges_is_known_by_so_much_less():
    line = np.column_stack([np.full(STATIONS, 50.0), 10.0 + 240.0 * SHARES])
    body = SeenBody(line, np.full(STATIONS, 12.0), np.ones((STATIONS, 2, 3)), np.ones((STATIONS, 2, 2, 3)))
    edges = np.full((STATIONS, 2, 2), 0.5)  # a body that has swelled: both edges lie farther out
    still = np.zeros(STATIONS)
    assert off_middle(body, edges, still) == 0.0
    edges[-10:] = [[3.0, 0.5], [-2.0, 0.5]]  # but for its end, which lies 2.5 px beside the line
    assert abs(off_middle(body, edges, still) - 2.5) < 1e-9
    assert off_middle(body, edges, np.where(SHARES > 0.85, 2.5, 0.0)) < 0.1, "the line has gone there"
    edges[10:, 1, 1] = np.inf  # one edge alone says nothing of the middle
    assert off_middle(body, edges, still) == 0.0
    body = replace(body, told=SHARES < 0.85)
    edges[10:, 1, 1] = 0.5
    assert off_middle(body, edges, still) == 0.0, "edges of the wall are none"


def test_a_line_with_more_of_its_body_on_one_side_is_known_by_so_much_less():
    line = np.column_stack([np.full(STATIONS, 50.0), 10.0 + 240.0 * SHARES])
    body = SeenBody(line, np.full(STATIONS, 12.0), np.ones((STATIONS, 2, 3)), np.ones((STATIONS, 2, 2, 3)))
    more = np.full((STATIONS, 2), 0.3)  # something of its colour on both sides says nothing of where it lies
    assert off_beside(body, more) == 0.0
    more[-10:, 1] = 0.8  # of a strip of 14.4 px
    assert abs(off_beside(body, more) - 7.2) < 1e-9
    more[:, 0] = np.nan  # where it has rolled up, another stretch of it lies there
    assert off_beside(body, more) == 0.0
    more[:], more[30, 0] = 0.0, 1.0  # a spot of its colour at one station of a body width
    assert off_beside(body, more) < 2.5


def test_a_click_may_miss_a_thin_body_and_its_middle_at_once():
    """People miss a pixel by 3 px, and a body's middle by half its width: of a stem of 5 px both were not allowed at once."""
    line = np.column_stack([np.linspace(0.0, 100.0, 65), np.full(65, 50.0)])

    def said(half, off):
        hints = Hints(clamp=((0.0, 50.0 - half), (0.0, 50.0 + half)), tip=(100.0, 50.0 + off), centre_line=((40.0, 50.0 - off),))
        calibration = scaled_by_distance((200, 100), [[0, 0], [100, 0]], 100.0)
        actuator = Actuator(outer_radius=half / 1e3, inner_radius=half / 2e3, length=0.1)
        scene = make_scene(calibration, actuator, "image", hints, (200, 100))
        return off_hints(unproject(scene.camera, line), scene, first=True)

    assert said(2.5, 3.8) == "" and re.match(r"off_hints: what was found lies 4.0 mm from camera.tip", said(2.5, 4.0))
    assert said(20.0, 20.0) == "" and said(20.0, 20.5)


@pytest.mark.parametrize(
    ("light", "around", "like"),
    [((197, 128, 132), 190.0, False), ((60, 128, 131), 190.0, True), ((250, 128, 132), 190.0, True), ((197, 128, 132), 140.0, True)],
    ids=["the wall without the shadow", "dark as the body", "a gleam lighter than all around", "lighter than all around"],
)
def test_a_wall_from_which_the_shadow_has_gone_is_no_body(light, around, like):
    """Beside a dark body that shortens the wall is lit where it was in its shadow; bright fittings at its end scatter its colour."""
    shaded, often = np.full((40, 40, 3), (135.0, 128.0, 132.0), np.float32), np.full((40, 40), 20, np.int32)
    behind = Behind(np.full((40, 40, 3), light, np.uint8), shaded, often, np.zeros((40, 40, 3), np.float32))
    points, half = np.array([[20.0, 20.0]]), np.array([6.0])
    inside = np.array([[(81.0, 128.0, 131.0), (54.0**2, 9.0, 15.0)]])
    outside = np.array([[[(around, 128.0, 132.0), (23.0**2, 16.0, 16.0)]] * 2])
    assert support(behind, points, np.array([[0.0, 1.0]]), half, inside, outside, SURELY) == float(like)
