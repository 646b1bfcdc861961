"""Hard scenes: what is asked for is in the pictures, the time stamps and the files."""

from dataclasses import replace
from itertools import islice

import av
import numpy as np
import pytest
import yaml

from rfea_vision.errors import InputError
from rfea_vision.readers.video import open_video
from rfea_vision.twin import Stress, TwinOptions, parse_scene, simulate
from rfea_vision.twin.draw import Posture, build_plant, camera_times, draw_runs, highest_pressure, move, posture_at
from rfea_vision.twin.renderer import frames
from rfea_vision.twin.stress import shown_frames
from rfea_vision.twin.studio import Studio

SMALL = TwinOptions(seed=3, duration_s=0.1, joints=6, roles=("train",), video=True, frame_size=(180, 320), photos=3)


def pictures(scene):
    """Studio and the pictures of the first frames."""
    options = replace(SMALL, scene=scene)
    plant, _ = build_plant(options)
    run = draw_runs(options, highest_pressure(plant, options))[0]
    times = camera_times(options)
    posture = posture_at(plant, move(plant, run, 0.001), run.offset_s + times)
    studio = Studio(options, [posture])
    return studio, np.array(list(frames(studio.camera, studio.scene, posture, studio.generator, times)), dtype=float)


@pytest.fixture(scope="module")
def plain():
    return pictures(Stress(dark=True))


def test_words_become_a_scene():
    scene = parse_scene(["busy", "flicker=0.1", "slow-motion", "dark"])
    assert (scene.busy, scene.flicker, scene.slow_motion, scene.dark) == (12.0, 0.1, True, True)
    for wrong in (["fog"], ["flicker=2"], ["vfr=1"], ["light", "dark"], ["busy=much"]):
        with pytest.raises(InputError, match="--scene"):
            parse_scene(wrong)


def test_a_tube_is_light_or_dark_as_asked(plain):
    light = pictures(Stress(light=True))[0].scene
    assert plain[0].scene.tube < plain[0].scene.wall - 100
    assert light.tube > light.wall + 100


def test_flicker_makes_whole_frames_darker(plain):
    means = pictures(Stress(dark=True, flicker=0.2))[1].mean(axis=(1, 2)) / plain[1].mean(axis=(1, 2))
    assert 0.1 < np.ptp(means) <= 0.45


def test_clutter_hose_and_uneven_light_are_there(plain):
    still = plain[1][0]
    assert np.std(pictures(Stress(dark=True, busy=15.0))[1][0] - still) > 8
    studio, hose = pictures(Stress(dark=True, hose=8.0))
    middle = studio.camera.project_plane(studio.scene.hose_mm.mean(axis=0)[None])[0]
    assert np.all(np.abs(studio.scene.hose_mm[0] - studio.scene.hose_mm[3]) == [0, 8])
    assert 0.02 < np.mean(np.abs(hose[0] - still) > 20) < 0.3, middle
    tilted = pictures(Stress(dark=True, uneven=0.4))[1][0] / still
    assert abs(tilted[:, :20].mean() - tilted[:, -20:].mean()) > 0.25


def test_where_clamp_and_tube_meet_the_tube_takes_the_walls_part(plain):
    """Across the edge of the clamp the column in the tube's middle goes from clamp to tube and never towards the wall."""
    studio, _ = plain
    scene = replace(studio.scene, noise=0.0, blur_px=0.3)
    options = studio.options
    plant, _ = build_plant(options)
    run = draw_runs(options, highest_pressure(plant, options))[0]
    posture = posture_at(plant, move(plant, run, 0.001), np.array([0.0]))
    picture = next(frames(studio.camera, scene, posture, np.random.default_rng(0), np.zeros(1))).astype(float)
    x, y = studio.camera.project_plane(np.array([[0.0, 0.0]]))[0].round().astype(int)
    column = picture[y - 6 : y + 7, x]
    assert np.all(np.diff(column) <= 2)  # a dark tube under a grey clamp before a bright wall
    assert column.max() <= scene.clamp + 3


def test_landscape_turns_the_picture():
    studio, film = pictures(Stress(landscape=True))
    assert film.shape[1:] == (180, 320) and studio.size == (320, 180)


def test_time_stamps_are_uneven_or_missing_as_asked(tmp_path):
    scene = Stress(vfr=True, dropped=0.2)
    options = replace(SMALL, scene=scene)
    times = camera_times(options)
    assert len(times) < 24 and np.ptp(np.diff(times)) > 1e-3 and np.all(np.diff(times) > 0)
    simulate(tmp_path / "a", options)
    source = open_video(next((tmp_path / "a").glob("*/video.mp4")))
    np.testing.assert_allclose(source.times_s() - source.times_s()[0], times, atol=2e-5)


def test_slow_motion_says_its_rate_and_repeats_are_true(tmp_path):
    options = replace(SMALL, scene=Stress(slow_motion=True, duplicated=0.3), image_noise=0.0)
    simulate(tmp_path / "a", options)
    folder = next(path.parent for path in (tmp_path / "a").glob("*/video.mp4"))
    assert yaml.safe_load((folder / "experiment.yaml").read_text())["video"]["rate"] == "240 Hz"
    with av.open(str(folder / "video.mp4")) as container:
        shown = [frame.to_ndarray(format="gray").astype(float) for frame in container.decode(video=0)]
        assert float(container.streams.video[0].average_rate) == pytest.approx(30.0)
    expected = shown_frames(24, options.scene, options.seed)
    again = np.flatnonzero(expected != np.arange(24))
    assert len(again) >= 3
    assert all(np.abs(shown[k] - shown[k - 1]).max() < 12 for k in again)


def test_light_and_paint_are_where_they_were_asked_for(plain):
    studio, film = plain
    still = film[0]
    lit = pictures(Stress(dark=True, highlight=80.0))[1][0] - still
    assert 50 < lit.max() < 110 and np.mean(np.abs(lit) > 40) < 0.04
    shaded = pictures(Stress(dark=True, shadow=0.5))[1][0] / still
    assert 0.1 < np.mean(shaded < 0.65) < 0.3
    assert np.mean(pictures(Stress(dark=True, bright=2.0))[1][0] == 255) > 0.5 > np.mean(still == 255)
    for scene, below_mm in ((Stress(dark=True, band=20.0), 21.0), (Stress(dark=True, sleeve=10.0), None)):
        change = np.abs(pictures(scene)[1][0] - still)
        rows, columns = np.nonzero(change > 30)
        assert 3 < len(rows) < 400
        if below_mm is not None:
            place = studio.camera.project_plane(np.array([[0.0, -below_mm]]))[0]
            assert np.hypot(np.mean(columns) - place[0], np.mean(rows) - place[1]) < 6


@pytest.mark.study
def test_an_open_shutter_smears_what_moves_and_nothing_else(plain):
    studio, _ = plain
    arcs = np.full(6, 0.02)
    posture = Posture(
        np.arange(3)[:, None] * arcs, np.full(6, 0.155 / 6), np.full(3, 0.004), np.zeros(3), mirrored=False
    )
    still, smeared = (
        next(islice(frames(studio.camera, scene, posture, np.random.default_rng(0), np.arange(3) / 30), 1, 2)).astype(
            float
        )
        for scene in (studio.scene, replace(studio.scene, stress=Stress(shutter=1.0)))
    )
    off = np.abs(smeared - still)
    clamp, tip = (studio.camera.project_plane(posture.line(np.array([u]))[0][1])[0] for u in (0.05, 0.95))
    near = [off[round(y) - 8 : round(y) + 9, round(x) - 12 : round(x) + 13].max() for x, y in (clamp, tip)]
    assert near[0] < 25 < 50 < near[1]
