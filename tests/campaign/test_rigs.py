"""How the chambers and the rig of an experiment are read."""

import pytest

from rfea_vision.campaign import load_campaign, read_campaign
from rfea_vision.errors import InputError

from .campaigns import write_campaign

TWO_CHAMBERS = "pressure: [{chamber: left, file: pressure.csv}, {chamber: right, file: pressure.csv, sign: -1}]"


def _with_chambers(folder, given):
    write_campaign(folder)
    for name, text in given.items():
        file = folder / name / "experiment.yaml"
        file.write_text(file.read_text().replace("pressure: {file: pressure.csv}", text))
    return folder


def test_chambers_are_read_with_their_signs(tmp_path):
    folder = _with_chambers(tmp_path / "c", {"steps": TWO_CHAMBERS, "sine": TWO_CHAMBERS})
    pressure = load_campaign(folder).experiment("steps").pressure
    assert [(part.name, part.keys.sign) for part in pressure.chambers] == [("left", 1), ("right", -1)]
    assert len(pressure.files) == 1
    assert [problem.key for problem in read_campaign(folder).problems] == ["actuator.section"]
    campaign = folder / "campaign.yaml"
    text = campaign.read_text().replace("inner_radius: 3 mm, ", "")
    campaign.write_text(text.replace("bends", "section: {kind: rod, chamber_area: 60 mm^2}, bends"))
    assert not read_campaign(folder).problems


def test_a_finger_bends_about_the_side_that_keeps_its_length_and_not_to_both_sides(tmp_path):
    folder = write_campaign(tmp_path / "c")
    campaign = folder / "campaign.yaml"
    tube = campaign.read_text()
    flat = tube.replace("outer_radius: 4 mm, inner_radius: 3 mm, ", "")
    section = "section: {kind: rectangle, width: 22 mm, thickness: 12 mm, chamber_area: 140 mm^2%s}, bends"
    for keeps, offset in (("", 0.0), (", keeps: middle", 0.0), (", keeps: side", 0.006)):
        campaign.write_text(flat.replace("bends", section % keeps))
        finger = load_campaign(folder).experiment("steps").actuator
        assert finger.offset == pytest.approx(offset) and finger.bore_offset == 0.0
    _with_chambers(folder, {"steps": TWO_CHAMBERS, "sine": TWO_CHAMBERS})
    campaign.write_text(flat.replace("bends", section % ", keeps: side"))
    assert [problem.key for problem in read_campaign(folder).problems] == ["actuator.section"]
    campaign.write_text(tube.replace("bends", "section: {keeps: side}, bends"))
    assert read_campaign(folder).problems[0].key == "actuator.section.keeps"
    campaign.write_text(flat.replace("bends", section.replace("chamber_area: 140 mm^2", "tendon: 5 mm") % ", keeps: side"))
    assert read_campaign(folder).problems[0].message.startswith("stands beside section.tendon, whose lever counts from the middle")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (TWO_CHAMBERS, "'sine' has without a name; name the same ones in all experiments"),
        (TWO_CHAMBERS.replace("right", "left"), "each of several needs the name of its chamber"),
        (TWO_CHAMBERS.replace("chamber: right, ", ""), "each of several needs the name of its chamber"),
        (TWO_CHAMBERS.replace("sign: -1", "sing: -1"), "did you mean 'sign'"),
        (TWO_CHAMBERS.replace("-1", "2"), "must be 1 or -1"),
        ("pressure: []", "there must be 1 at least"),
    ],
)
def test_chambers_that_are_wrong_are_named(tmp_path, text, says):
    with pytest.raises(InputError, match=says):
        load_campaign(_with_chambers(tmp_path / "c", {"steps": text}))


CAMERA = "camera: {file: camera.yaml, vertical: %s}\nvideo: {file: film.mp4}\n"


def _rig(folder, above, below, camera=""):
    """The experiment `steps` of a campaign whose files say these things of the rig."""
    write_campaign(folder)
    (folder / "camera.yaml").touch()
    file = folder / "campaign.yaml"
    file.write_text(file.read_text() + above)
    file = folder / "steps" / "experiment.yaml"
    (folder / "steps" / "film.mp4").touch()
    text = file.read_text() + below
    file.write_text(text.replace("track: {file: track.csv}\n", CAMERA % camera) if camera else text)
    return folder


@pytest.mark.parametrize(
    ("above", "below", "deg"),
    [
        ("", "", 0.0),
        ("rig: {gravity: left}\n", "", 90.0),
        ("rig: {gravity: left}\n", "rig: {gravity: up}\n", 180.0),
        ("rig: {gravity: {angle: 30 deg}}\n", "rig: {gravity: none}\n", None),
        ("rig: {gravity: none}\n", "rig: {gravity: {angle: -20 deg}}\n", -20.0),
    ],
)
def test_an_experiment_may_stand_otherwise_than_its_campaign(tmp_path, above, below, deg):
    campaign = load_campaign(_rig(tmp_path / "c", above, below))
    assert campaign.experiment("steps").rig.gravity_deg == deg
    assert campaign.experiment("sine").rig.gravity_deg in (0.0, 90.0, 30.0, None)


def test_gravity_is_read_from_a_plumb_line(tmp_path):
    plumb = "rig: {gravity: {plumb: [[10, 20], [12, 400]]}}\n"
    rig = (
        load_campaign(_rig(tmp_path / "c", "rig: {gravity: {angle: 30 deg}}\n", plumb, "board")).experiment("steps").rig
    )
    assert rig.plumb == ((10, 20), (12, 400)) and rig.gravity_deg == 0.0
    for place, (below, camera, says) in enumerate(
        [
            (plumb, "", "needs pictures"),
            (plumb, "{plumb: [[1, 2], [3, 4]]}", "the axis of the rig"),
            (plumb.replace("[12, 400]", "[10, 20]"), "image", "are one"),
            ("rig: {gravity: left}\n", "rest", "does not rest straight"),
        ]
    ):
        with pytest.raises(InputError, match=says):
            load_campaign(_rig(tmp_path / str(place), "", below, camera))
