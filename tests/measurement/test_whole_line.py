"""How lines are held against what is known of them, and what the tracker claims of the bend of bodies that it follows."""

import numpy as np

from rfea_vision.readers.video import open_video
from rfea_vision.vision import track_frames
from testing.drawn import draw, film
from testing.pointing import pointed_by_hand
from testing.whole_line import beside, headings, line_score


def arc(radius_px, turn_rad, count=65):
    """An arc that begins downwards at (0, 0), y down, and bends to the left of the picture."""
    angle = np.linspace(0.0, turn_rad, count)
    return radius_px * np.column_stack([np.cos(angle) - 1.0, np.sin(angle)])


def test_places_beside_an_arc_lie_as_far_off_as_they_do():
    inner, shares = arc(95.0, 1.5, 33) - (5.0, 0.0), np.linspace(0, 1, 33)
    apart, at = beside(arc(100.0, 1.5), inner)
    np.testing.assert_allclose(apart, 5.0, atol=0.05)
    np.testing.assert_allclose(at, shares, atol=0.005)


def test_places_beyond_an_end_are_held_to_its_continuation():
    apart, at = beside(np.array([[0.0, 0.0], [0.0, 100.0]]), np.array([[3.0, -10.0], [4.0, 110.0]]))
    np.testing.assert_allclose(apart, [3.0, 4.0], atol=0.01)
    np.testing.assert_array_equal(at, [0.0, 1.0])


def test_an_arc_bends_by_its_radius_and_turns_by_its_angle():
    angle, curvature = headings(arc(100.0, 1.5), 1.0)
    np.testing.assert_allclose(angle[-1], 1.5, atol=0.02)
    np.testing.assert_allclose(curvature[2:-2], 0.01, rtol=1e-3)


def test_what_is_claimed_of_a_followed_body_s_bend_holds(tmp_path):
    """Of its bend angles 41 % lay within their intervals, of its curvatures 60 %: what leads a line astray did not count for these."""
    truth = film(tmp_path / "film.mp4", draw(436))
    source = open_video(tmp_path / "film.mp4")
    calibration, tube, hints = pointed_by_hand(truth, source.size, np.random.default_rng(436))
    track = track_frames(source, calibration, tube, hints=hints, vertical="image")
    known = {int(frame): truth.centre_px[frame] for frame in np.flatnonzero(truth.visible)}
    found = line_score(track, calibration, known, truth.half_width_px, whole=True)
    assert found is not None and found.off < 0.1, found
    assert min(found.within, found.turned_within, found.bent_within) > 0.9, found
