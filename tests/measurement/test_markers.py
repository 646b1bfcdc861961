"""Marks on the tube: elongation without assuming an inextensible side."""

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.vision import track_frames
from rfea_vision.vision.derive.markers import elongation_between
from testing.scenes import Lens, Look, picture, shape
from testing.sources import memory_source, true_calibration

SEGMENTS = 8


def stretching(lens: Lens, look: Look, longest: float):
    """A bend during which the hinge side grows by `longest`; pictures, times, and true elongation of the centre line."""
    rng = np.random.default_rng(3)
    shares = np.concatenate([np.zeros(4), np.linspace(0, 1, 14)])
    shapes = [shape(1.0 + 60 * s, length_mm=155.0 * (1 + longest * s)) for s in shares]
    joints = np.linspace(0, 1, SEGMENTS + 1)
    parts = []
    for drawn in shapes:
        steps = np.linalg.norm(np.diff(drawn.centre, axis=0), axis=1)
        arc = np.concatenate([[0.0], np.cumsum(steps)])
        parts.append(np.diff(np.interp(joints, np.linspace(0, 1, len(arc)), arc)))
    truth = np.array(parts) / parts[0] - 1
    return [picture(s, lens, look, rng) for s in shapes], np.arange(len(shapes)) / 60, truth


@pytest.mark.parametrize("longest", [0.0, 0.03])
def test_marks_show_the_true_elongation(longest, small_lens):
    pictures, times, truth = stretching(small_lens, Look(bands=24), longest)
    track = track_frames(memory_source(pictures, times), true_calibration(small_lens), Actuator(), segments=SEGMENTS)
    data = track.dataset
    assert track.valid.all()
    off = data["marker_elongation"].values - truth
    sigma = data["marker_elongation_sigma"].values
    assert np.isfinite(off).mean() > 0.9
    assert np.sqrt(np.nanmean(off**2)) < 0.006
    assert 0.0005 < np.nanmedian(sigma) < 0.01
    assert np.nanmean(np.abs(off) < 1.96 * sigma) > 0.8
    # The hinge side as ruler cannot see it: it reads the bend only.
    missed = np.abs(data["elongation"].values[-1] - truth[-1]).mean()
    assert missed < 0.01 if longest == 0 else missed > 0.02


def test_a_plain_tube_has_no_marker_elongation(small_lens):
    pictures, times, _ = stretching(small_lens, Look(noise=5), 0.0)
    data = track_frames(memory_source(pictures, times), true_calibration(small_lens), Actuator()).dataset
    assert "marker_elongation" not in data
    assert "absent" in data.attrs["marker_elongation_assumption"]


def test_single_marks_tell_each_stretch_between_them():
    """The clamp's part is drawn out by 30 %, the middle by 10 %, and the glued end not at all; then one mark is hidden."""
    first = {0.25: (25.0, 0.2), 0.75: (75.0, 0.2)}
    drawn = {0.25: (32.5, 0.2), 0.75: (87.5, 0.2)}
    material, lengths = [first, drawn, {0.75: (87.5, 0.2)}], np.array([100.0, 112.5, 112.5])
    straight, exact = np.zeros((3, 5)), np.zeros(3)
    marked = elongation_between(material, lengths, np.full(3, 0.5), straight, exact, 4)
    assert marked.elongation[0] == pytest.approx(np.zeros(4), abs=1e-12)
    assert marked.elongation[1] == pytest.approx([0.3, 0.1, 0.1, 0.0])
    assert marked.elongation[2] == pytest.approx([1 / 6, 1 / 6, 1 / 6, 0.0])
    assert marked.sigma[1] == pytest.approx(
        np.sqrt(2) * np.array([0.2 / 25, np.hypot(0.2, 0.2) / 50, np.hypot(0.2, 0.2) / 50, np.hypot(0.2, 0.5) / 25])
    )
    late = elongation_between([{0.5: (50.0, 8.0)}], lengths[:1], np.full(1, 0.5), straight[:1], exact[:1], 4)
    assert np.isnan(late.elongation).all()  # known to a fifth only


@pytest.mark.parametrize("lasting", [1, 3])
def test_marks_are_as_certain_as_their_scatter_and_the_bend_let_them(lasting):
    """Places that scatter by 0.1 mm, also where that lasts for three frames, on a line that may lie 0.5 mm beside the middle."""
    rng = np.random.default_rng(2)
    count, t = 240, np.arange(240) / 240
    lengths = 100.0 * (1.0 + 0.1 * np.sin(2 * np.pi * t))
    bend = 2.0 * np.sin(2 * np.pi * t)
    noise = np.repeat(rng.normal(0.0, 0.1, (count // lasting, 2)), lasting, axis=0)
    off = 0.3 * bend * np.array([[0.25], [0.75]])  # the line lies 0.3 mm to one side: it is longer by so much up to each mark
    places = lengths * np.array([[0.25], [0.75]]) + off + noise.T
    material = [{0.25: (a, 0.8), 0.75: (b, 0.8)} for a, b in places.T]
    headings = bend[:, None] * np.linspace(0, 1, 9)
    marked = elongation_between(material, lengths, np.full(count, 0.1), headings, np.full(count, 0.5), 4)
    wrong = marked.elongation - (lengths / lengths[0] - 1.0)[:, None]
    middle = slice(1, 3)  # between the two marks
    z = (wrong / marked.sigma)[:, middle]
    assert np.abs(z).max() < 4.0 and 0.5 < np.sqrt(np.mean(z**2)) < 1.3
    at_rest = np.abs(bend) < 0.1
    assert marked.sigma[at_rest, 1] == pytest.approx(2.0 * 0.1 / 50.0, rel=0.25)
    assert marked.sigma[count // 4, 1] == pytest.approx(np.hypot(0.2, 0.5) / 50.0, rel=0.15)
