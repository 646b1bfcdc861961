"""Hints and a scale that cannot be right are told before a film is followed, each by its key, and once."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from rfea_vision.artefacts import Actuator, Correction, Hints
from rfea_vision.campaign.check import check_campaign
from rfea_vision.campaign.pointing import Film, of_camera, of_guide, of_hints
from rfea_vision.campaign.schema import ScalePart
from rfea_vision.campaign.specs import CameraSpec
from rfea_vision.errors import InputError
from rfea_vision.stages import open_campaign
from rfea_vision.stages.cameras import calibration_of

FILM = Film((480, 640), 4)
TUBE = Actuator(outer_radius=0.0045, inner_radius=0.002, length=0.12)
RULER = [[20, 600], [320, 600]]  # 3 px per mm
HINTS = Hints(clamp=((226.5, 90.0), (253.5, 90.0)), tip=(240.0, 440.0))
CROSSED = [[20, 600], [300, 600], [20, 100], [300, 100]]
SHEET = [["0 mm", "0 mm"], ["100 mm", "0 mm"], ["100 mm", "170 mm"], ["0 mm", "170 mm"]]


def told(hints: Hints = HINTS, **scale: Any) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    given = ScalePart.model_validate({"points": RULER, "distance": "100 mm"} | scale)
    return of_camera(CameraSpec(scale=given, hints=hints), FILM, TUBE, 0.0)


@pytest.mark.parametrize(
    ("hints", "scale", "key", "says"),
    [
        ({"tip": (900.0, 90.0)}, {}, "camera.tip", "900, 90 lies outside the picture of 480 x 640 px"),
        ({"tip": (600.0, 90.0)}, {}, "camera.tip", "point at it in the first frame, or are x and y exchanged? x counts to the right"),
        ({"corrections": (Correction(2, ((240.0, 700.0),)),)}, {}, "camera.corrections", "240, 700 lies outside the picture"),
        ({"corrections": (Correction(4, ((240.0, 400.0),)),)}, {}, "camera.corrections", "frame 4 is not in the film, whose last is 3"),
        ({"corrections": (Correction(1, ((9.0, 9.0),)),), "tip": None}, {}, "camera.corrections", "acts where camera.clamp"),
        ({"region": (1000.0, 10.0, 30.0, 30.0)}, {}, "camera.region", "lies outside"),
        ({}, {"points": [[20, 600], [900, 600]]}, "camera.scale.points", "900, 600 lies outside"),
        ({}, {"points": [[20, 600], [23, 600]]}, "camera.scale.points", "they are 3 px apart"),
        ({}, {"points": CROSSED, "distance": None, "places": SHEET}, "camera.scale.places", "check the order"),
    ],
)
def test_what_cannot_be_in_the_picture_is_refused(hints, scale, key, says):
    (problem,), _ = told(replace(HINTS, **hints), **scale)
    assert problem[0] == key and says in problem[1]


@pytest.mark.parametrize(
    ("hints", "said"),
    [
        ({"region": (200.0, 60.0, 100.0, 400.0), "exclude": ((0.0, 0.0, 100.0, 640.0),)}, {}),
        ({"region": (200.0, 60.0, 100.0, 300.0)}, {"region": "camera.tip lies outside the box [200.0, 60.0, 100.0, 300.0]"}),
        ({"exclude": ((200.0, 60.0, 50.0, 50.0),)}, {"exclude": "camera.clamp lies within"}),
        ({"clamp": ((240.0, 90.0), (240.0, 117.0))}, {"clamp": "its two points lie one behind the other as seen from camera.tip"}),
    ],
)
def test_a_clamp_or_a_tip_where_the_tube_may_not_be_is_doubted(hints, said):
    found = dict(of_hints(replace(HINTS, **hints), 0.0))
    assert found.keys() == said.keys() and all(text in found[key] for key, text in said.items())


@pytest.mark.parametrize(("kind", "key"), [("rod", "actuator.outer_radius"), ("rectangle", "actuator.section.thickness")])
def test_a_width_is_told_by_the_key_that_says_it(kind, key):
    """Of a rod, whose radius is `actuator.outer_radius`, `actuator.section` was named, which says nothing of it."""
    camera = CameraSpec(scale=ScalePart.model_validate({"points": RULER, "distance": "100 cm"}), hints=HINTS)
    _, odd = of_camera(camera, FILM, replace(TUBE, kind=kind, width=0.02), 0.0)
    assert f"the tube 9 mm wide by {key};" in dict(odd)["camera.clamp"]


@pytest.mark.parametrize(
    ("hints", "scale", "keys"),
    [
        ({}, {}, []),
        ({"tip": (400.0, 200.0)}, {}, []),  # bent
        ({"tip": (240.0, 190.0)}, {}, ["camera.scale"]),  # a length that was guessed is no tube's that hangs
        ({"clamp": ((213.0, 90.0), (267.0, 90.0))}, {}, ["camera.clamp"]),  # a diameter as radius
        ({}, {"distance": "10 mm"}, ["camera.clamp", "camera.scale"]),
        ({}, {"distance": "100 cm"}, ["camera.clamp", "camera.scale"]),
        ({"centre_line": ((240.0, 120.0), (240.0, 150.0)), "tip": (240.0, 200.0)}, {}, ["camera.scale"]),
    ],
)
def test_a_scale_by_which_the_tube_is_of_another_size_is_doubted(hints, scale, keys):
    wrong, odd = told(replace(HINTS, **hints), **scale)
    assert not wrong and [key for key, _ in odd] == keys


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        ("scale: {points: [[20, 20]], distance: 10 mm}", "camera.scale.points: found [[20, 20]], which are 1; there must be 2"),
        ("scale: {points: [[5, 5], [60, 5]], distance: 10}", "camera.scale.distance: 10 has no unit; write for example '10 cm'"),
        ("corrections: [{frame: 0, points: [[5, 5]]}]", "camera.corrections.0.frame: found 0; must be at least 1"),
        ("corrections: [{frame: soft, points: [[5, 5]]}]", "camera.corrections.0.frame: found 'soft'; a whole number is needed"),
        ("corrections: [{frame: 1, points: []}]", "camera.corrections.0.points: found []"),
        ("corrections: [{frame: 2, points: [[5, 5]]}, {frame: 2, points: [[6, 5]]}]", "camera.corrections: frame 2 is there twice"),
        ("scale: tub", "camera.scale: found 'tub'; must be 'tube'"),
        ("tip: [.nan, 20]", "camera.tip.0: found nan; a number is needed"),
        ("clamp: [5, 5, 10, 5]", "camera.clamp: found [5, 5, 10, 5]; write it as [[x, y], [x, y]]"),
        ("clamp: [5, 5]", "camera.clamp: found [5, 5]; write it as [[x, y], [x, y]]"),
        ("clamp: [[5, 5]]", "camera.clamp: found [[5, 5]]; write it as [[x, y], [x, y]]"),
        ("region: [5, 5, 9]", "camera.region: found [5, 5, 9]; write it as [x, y, width, height]"),
        ("vertical: up", "camera.vertical: found 'up'; must be 'board', 'rest' or 'image', or a mapping with plumb"),
        ("vertical: {plum: [[1, 2], [3, 4]]}", "camera.vertical.plum: unknown key 'plum'; did you mean 'plumb'?"),
        ("colour: [300, 0, 0]", "camera.colour.0: found 300"),
        ("tip: [5, 90]", "camera.tip: 5, 90 lies outside the picture of 64 x 48 px"),
    ],
)
def test_each_is_one_sentence_in_the_check_of_a_campaign(tmp_path, camera, says):
    """Of a mapping it was also said that it is no word, NaN passed, and a tip outside of the film was told only by tracking."""
    (tmp_path / "frames").mkdir()
    for k in range(3):
        cv2.imwrite(str(tmp_path / "frames" / f"{k}.png"), np.full((48, 64), 90, np.uint8))
    scale = "" if camera.startswith("scale") else "scale: {points: [[5, 5], [60, 5]], distance: 10 mm}, "
    (tmp_path / "experiment.yaml").write_text(
        f"format: rfea-experiment/1\ncamera: {{{scale}{camera}}}\nframes: {{folder: frames, rate: 30 Hz}}\npressure: {{value: 0 kPa}}\n"
    )
    errors = [str(problem) for problem in check_campaign(tmp_path).problems if problem.severity == "error"]
    assert len(errors) == 1 and says in errors[0], errors


LINE = np.column_stack([np.full(9, 240.0), np.linspace(95.0, 440.0, 9)])


def masks_in(folder, count: int, shape: tuple[int, int], turned: int = 0) -> None:
    folder.mkdir()
    for k in range(count):
        mask = np.zeros(shape, np.uint8)
        mask[round(90 * shape[0] / 640) : round(440 * shape[0] / 640), round(226 * shape[1] / 480) : round(254 * shape[1] / 480)] = 255
        cv2.imwrite(str(folder / f"{k:03d}.png"), mask ^ turned)


@pytest.mark.parametrize(
    ("count", "shape", "turned", "says"),
    [
        (4, (640, 480), 0, ""),
        (4, (640, 480), 255, "most of 000.png is light"),
        (3, (640, 480), 0, "masks holds 3 of the film's 4 frames; they are taken in order"),
        (4, (320, 240), 0, "000.png has 240 x 320 px, and the film 480 x 640"),
    ],
)
def test_masks_that_are_not_those_of_the_film_are_doubted(tmp_path, count, shape, turned, says):
    """They were taken as they came, and helped as little as none, in silence."""
    masks_in(tmp_path / "masks", count, shape, turned)
    said = of_guide(replace(HINTS, masks=tmp_path / "masks"), FILM)
    assert len(said) == bool(says) and all(key == "masks" and says in text for key, text in said), said


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (np.stack([LINE] * 4), ""),
        (np.stack([LINE] * 4) / [480, 640], "lies 2"),
        (np.stack([LINE[:, ::-1]] * 4), "px from camera.clamp in the first frame"),
        (np.stack([LINE]), "track.npy holds 1 of the film's 4 frames"),
        (np.full((4, 9, 2), np.nan), "holds 0 of the film's 4"),
    ],
)
def test_key_points_that_are_not_those_of_the_film_are_doubted(tmp_path, points, says):
    np.save(tmp_path / "track.npy", points)
    said = of_guide(replace(HINTS, keypoints=tmp_path / "track.npy"), FILM)
    assert len(said) == bool(says) and all(key == "keypoints" and says in text for key, text in said), said


def test_a_guide_that_cannot_act_or_be_read_is_told(tmp_path):
    np.save(tmp_path / "track.npy", np.zeros((4, 2, 2)))
    hints = replace(HINTS, keypoints=tmp_path / "track.npy")
    ((key, text),) = of_guide(replace(hints, tip=None), FILM)
    assert key == "keypoints" and text.startswith("acts where camera.clamp and camera.tip are given")
    ((key, text),), _ = told(hints)
    assert key == "camera.keypoints" and "not (frame, point of 3 or more, xy)" in text


def filmed(folder, size, role="train", name=None):
    """A run with a short film of pictures of a size (width, height), if any."""
    run = folder / (name or f"of-{size[0]}" if size else name)
    run.mkdir(parents=True)
    (run / "experiment.yaml").write_text(
        f"format: rfea-experiment/1\nname: {run.name}\nrole: {role}\nvideo: {{file: film.avi}}\npressure: {{value: 0 kPa}}\n"
    )
    if size:
        film = cv2.VideoWriter(str(run / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, size)
        for _ in range(4):
            film.write(np.full((size[1], size[0], 3), 90, dtype=np.uint8))
        film.release()


@pytest.fixture
def scaled(tmp_path):
    (tmp_path / "campaign.yaml").write_text(
        "format: rfea-campaign/1\nname: c\nactuator: {outer_radius: 4.5 mm, inner_radius: 2 mm, length: 120 mm, bends: right}\n"
        "camera:\n  vertical: rest\n  scale: {points: [[20, 30], [320, 30]], distance: 100 mm}\n"
    )
    return tmp_path


def test_a_scale_holds_for_films_of_one_size_alone(scaled):
    """A run of another size made the tube of a good one 1.6 times as long, and nothing was said."""
    filmed(scaled, (480, 640))
    filmed(scaled, (960, 1280), role="ignore")
    assert not [problem for problem in check_campaign(scaled).problems if problem.key == "camera.scale"]
    work = open_campaign(scaled)
    assert calibration_of(work, work.campaign.experiment("of-480")).value.image_width == 480
    with pytest.raises(InputError, match=r"of-480 have 480 x 640 px, and those of of-960 960 x 1280"):
        calibration_of(work, work.campaign.experiment("of-960"))
    file = scaled / "of-960" / "experiment.yaml"
    file.write_text(file.read_text().replace("role: ignore", "role: train"))
    (problem,) = [problem for problem in check_campaign(scaled).problems if problem.key == "camera.scale"]
    assert problem.line == 6 and "write it into the experiment.yaml of the film" in problem.message


def test_a_film_that_cannot_be_opened_keeps_no_other_from_its_scale(scaled):
    filmed(scaled, None, name="a-broken")
    (scaled / "a-broken" / "film.avi").write_bytes(b"")
    filmed(scaled, (480, 640))
    work = open_campaign(scaled)
    assert calibration_of(work, work.campaign.experiment("of-480")).value.image_width == 480


def test_an_ignored_run_whose_film_is_not_there_is_told_by_its_file_where_it_is_asked_for(scaled):
    filmed(scaled, (480, 640))
    filmed(scaled, None, role="ignore", name="gone")
    work = open_campaign(scaled)
    assert calibration_of(work, work.campaign.experiment("of-480")).value.image_width == 480
    with pytest.raises(InputError, match=r"gone/experiment.yaml: video: the pictures that it names are not there"):
        work.track(["gone"])


def test_a_scale_that_two_runs_have_of_their_own_is_told_at_theirs(scaled):
    common = (scaled / "campaign.yaml").read_text()
    (scaled / "campaign.yaml").write_text(common[: common.index("camera:")])
    for size in ((480, 640), (960, 1280)):
        filmed(scaled, size)
        with (scaled / f"of-{size[0]}" / "experiment.yaml").open("a") as file:
            file.write(common[common.index("camera:") :])
    (problem,) = [problem for problem in check_campaign(scaled).problems if problem.key == "camera.scale"]
    assert problem.file == scaled / "of-480" / "experiment.yaml" and problem.line == 8
    work = open_campaign(scaled)
    with pytest.raises(InputError, match=r"of-960/experiment.yaml: camera.scale: the pictures of of-480"):
        calibration_of(work, work.campaign.experiment("of-960"))


def test_a_hint_of_the_campaign_is_told_at_its_line(scaled):
    file = scaled / "campaign.yaml"
    file.write_text(file.read_text().replace("[320, 30]", "[9320, 30]"))
    filmed(scaled, (480, 640))
    (problem,) = [problem for problem in check_campaign(scaled).problems if problem.key == "camera.scale.points"]
    assert (problem.file, problem.line) == (file, 6) and "9320, 30 lies outside the picture" in problem.message
