import pytest
import yaml

from rfea_vision.campaign import load_campaign, read_campaign
from rfea_vision.campaign.check import check_campaign
from rfea_vision.campaign.loading import _merge
from rfea_vision.errors import InputError

from .campaigns import write_campaign, write_experiment


@pytest.fixture
def campaign(tmp_path):
    return write_campaign(tmp_path / "tube-A")


def edit(path, **changes):
    """Set keys of a YAML file; None removes one."""
    content = yaml.safe_load(path.read_text())
    for key, value in changes.items():
        if value is None:
            content.pop(key, None)
        else:
            content[key] = value
    path.write_text(yaml.safe_dump(content, sort_keys=False))


def test_a_campaign_comes_in_si_with_absolute_paths(campaign):
    loaded = load_campaign(campaign)
    assert loaded.name == "tube-A"
    assert loaded.actuator.outer_radius == pytest.approx(0.004)
    assert loaded.actuator.length == pytest.approx(0.155)
    assert loaded.out == campaign / "rfea"
    assert [(item.name, item.role) for item in loaded.experiments] == [("sine", "validate"), ("steps", "train")]
    steps = loaded.experiment("steps")
    assert steps.track is not None and steps.track.file == campaign / "steps" / "track.csv"
    assert steps.pressure.file == campaign / "steps" / "pressure.csv"
    assert steps.actuator == loaded.actuator


def test_results_go_where_they_are_wanted(campaign, tmp_path):
    assert load_campaign(campaign, tmp_path / "elsewhere").out == tmp_path / "elsewhere"


def test_experiments_inherit_and_override(campaign):
    edit(campaign / "campaign.yaml", pressure={"unit": "bar", "reference": "absolute"}, sync="led")
    edit(
        campaign / "steps" / "experiment.yaml", sync={"method": "offset", "value": "12 ms"}, actuator={"bends": "right"}
    )
    edit(campaign / "sine" / "experiment.yaml", sync=None, pressure={"file": "pressure.csv", "unit": "psi"})
    loaded = load_campaign(campaign)
    steps, sine = loaded.experiment("steps"), loaded.experiment("sine")
    assert (steps.pressure.keys.unit, steps.pressure.keys.reference) == ("bar", "absolute")
    assert (sine.pressure.keys.unit, sine.pressure.keys.reference) == ("psi", "absolute")
    assert (steps.sync.method, steps.sync.value) == ("offset", pytest.approx(0.012))
    assert sine.sync.method == "led"
    assert (steps.actuator.bends, sine.actuator.bends) == ("right", "left")
    assert steps.actuator.length == sine.actuator.length


@pytest.mark.parametrize(
    ("shared", "own", "holds"),
    [
        ({"camera": {"photos": "*.png", "plane": "p.png"}}, {"camera": {"file": "c.yaml"}}, {"plane": "p.png", "file": "c.yaml"}),
        ({"actuator": {"mass": "3 g"}}, {"actuator": {"mass_per_length": "2 g/m"}}, {"mass_per_length": "2 g/m"}),
        ({"sync": {"method": "offset", "value": "1 ms"}}, {"sync": {"method": "motion"}}, {"method": "motion"}),
        ({"sync": {"method": "led"}}, {"sync": {"method": "led", "box": [1]}}, {"method": "led", "box": [1]}),
        ({"track": {"scale": "2 mm"}}, {"track": {"file": "t.csv"}}, {"scale": "2 mm", "file": "t.csv"}),
    ],
)  # fmt: skip
def test_what_stands_in_the_place_of_an_inherited_key_replaces_it(shared, own, holds):
    assert list(_merge(shared, own).values()) == [holds]


def test_frames_with_a_rate_need_no_table(campaign):
    (campaign / "steps" / "frames").mkdir()
    edit(
        campaign / "steps" / "experiment.yaml",
        track=None,
        camera={"file": None, "scale": {"points": [[0, 0], [9, 0]], "distance": "1 mm"}},
        frames={"folder": "frames", "rate": "240 Hz"},
    )
    video = read_campaign(campaign).campaign.experiment("steps").video
    assert (video.frames.name, video.times, video.rate_Hz) == ("frames", None, 240.0)
    (campaign / "steps" / "frames.csv").write_text("file\n")
    assert read_campaign(campaign).campaign.experiment("steps").video.times.name == "frames.csv"


def test_a_folder_of_pictures_that_is_named_as_a_film_is_told_its_key(campaign):
    (campaign / "steps" / "shots").mkdir()
    edit(campaign / "steps" / "experiment.yaml", track=None, video={"file": "shots"})
    said = "; ".join(problem.message for problem in read_campaign(campaign).problems)
    assert "write frames: {folder: shots, rate: 240 Hz} in place of video" in said


def test_a_file_shared_by_the_campaign_is_found_there(campaign):
    (campaign / "steps" / "pressure.csv").rename(campaign / "all.csv")
    edit(campaign / "steps" / "experiment.yaml", pressure={"file": "all.csv"})
    assert load_campaign(campaign).experiment("steps").pressure.file == campaign / "all.csv"


def test_a_lone_experiment_is_a_campaign(tmp_path):
    folder = write_experiment(tmp_path / "alone", "alone")
    edit(folder / "experiment.yaml", actuator={"length": "120 mm"})
    loaded = load_campaign(folder)
    assert loaded.root == folder and loaded.out == folder / "rfea"
    assert [item.name for item in loaded.experiments] == ["alone"]
    assert loaded.actuator.length == pytest.approx(0.12)


def test_an_experiment_inside_a_campaign_names_the_campaign(campaign):
    with pytest.raises(InputError, match="belongs to the campaign above it"):
        load_campaign(campaign / "steps")


def test_names_may_be_numbers_and_dates(campaign):
    text = (campaign / "steps" / "experiment.yaml").read_text().replace("name: steps", "name: 2018-03-01")
    (campaign / "steps" / "experiment.yaml").write_text(text)
    assert "2018-03-01" in [item.name for item in load_campaign(campaign).experiments]


def test_what_is_set_aside_may_be_broken(campaign):
    folder = write_experiment(campaign / "broken", "broken", "ignore")
    (folder / "track.csv").unlink()
    assert load_campaign(campaign).experiment("broken").role == "ignore"


# Each case: the file, what is done to it, the key that the sentence names, and words of the sentence.
BOARD = "checkerboard-9x6-12mm"
CHARUCO = {"kind": "charuco", "inner_corners": [9, 6], "square": "12 mm"}
WRONG = [
    ("steps", {"role": "trian"}, "role", "must be 'train', 'validate', 'test' or 'ignore'"),
    ("steps", {"presure": {"file": "x"}}, "presure", "did you mean 'pressure'?"),
    ("steps", {"pressure": {"file": "pressure.csv", "unti": "bar"}}, "pressure.unti", "did you mean 'unit'?"),
    ("steps", {"pressure": {"file": "pressure.csv", "unit": "kpa"}}, "pressure.unit", "did you mean 'kPa'?"),
    ("steps", {"pressure": {"file": "pressure.csv", "unit": "mm"}}, "pressure.unit", "not a unit of the right kind"),
    ("steps", {"pressure": {"file": "gone.csv"}}, "pressure.file", "no file 'gone.csv'"),
    ("steps", {"pressure": {}}, "pressure", "exactly one of 'file' and 'url'"),
    ("steps", {"pressure": {"url": "sqlite:///log.db"}}, "pressure.query", "is missing"),
    ("steps", {"pressure": "pressure.csv"}, "pressure", "write 'pressure: {file: pressure.csv}'"),
    ("steps", {"track": None}, "video", "exactly one of video, frames and track"),
    ("steps", {"video": {"file": "track.csv"}}, "track", "found video and track"),
    ("steps", {"track": {"file": "gone.csv"}}, "track.file", "there is pressure.csv, track.csv"),
    ("steps", {"sync": {"method": "offset"}}, "sync.value", "is missing"),
    ("steps", {"sync": {"method": "offset", "value": 12}}, "sync.value", "12 has no unit"),
    ("steps", {"sync": {"method": "motion", "value": "12 ms"}}, "sync.value", "has no meaning"),
    ("steps", {"sync": "motoin"}, "sync", "must be 'motion'"),
    ("steps", {"format": "rfea-experiment/2"}, "format", "must be 'rfea-experiment/1'"),
    ("steps", {"name": "models"}, "name", "what rfea calls results of its own"),
    (None, {"name": "x" * 200}, "name", "is longer than 150 bytes"),
    ("steps", {"name": "../up"}, "name", "cannot name a folder"),
    ("steps", {"name": "軟" * 51}, "name", "150 bytes at most"),
    ("steps", {"repeat_of": "nobody"}, "repeat_of", "'nobody' is no experiment; a run repeats another one; there are sine"),
    ("steps", {"repeat_of": "steps"}, "repeat_of", "'steps' is this run itself"),
    ("steps", {"recorded_at": "01.03.2026 14:05"}, "recorded_at", "no date and time; write it as 2026-03-01 14:05:30"),
    ("steps", {"actuator": {"length": 155}}, "actuator.length", "155 has no unit; write for example '155 mm'"),
    (None, {"format": "rfea-campaign/2"}, "format", "must be 'rfea-campaign/1'"),
    (None, {"actuator": {"outer_radius": 4}}, "actuator.outer_radius", "4 has no unit"),
    (None, {"actuator": {"outer_radius": "4 kg"}}, "actuator.outer_radius", "not a unit of the right kind"),
    (None, {"actuator": {"outer_radius": "-4 mm"}}, "actuator.outer_radius", "greater than zero"),
    (None, {"actuator": {"outer_radius": "2 mm"}}, "actuator.inner_radius", "smaller than"),
    (None, {"actuator": {"bends": "up"}}, "actuator.bends", "'left' or 'right'"),
    (None, {"actuator": {"lenght": "155 mm"}}, "actuator.lenght", "did you mean 'length'?"),
    (None, {"camera": {"photos": "board_*.png"}}, "camera.board", "is missing"),
    (None, {"camera": {"board": {"inner_corners": [9, 6]}, "photos": "b*"}}, "camera.board.square", "is missing"),
    (None, {"camera": {"board": {"inner_corners": [9, 6], "square": 9}, "photos": "b"}}, "camera.board.square", "unit"),
    (None, {"camera": {"board": "chekerboard-9x6-12mm", "photos": "b*"}}, "camera.board", f"did you mean '{BOARD}'"),
    (None, {"camera": {"board": BOARD, "photos": "b_*.png"}}, "camera.photos", "no photo matches 'b_*.png'"),
    (None, {"camera": {"file": "gone.yaml"}}, "camera.file", "no file 'gone.yaml'"),
    (None, {"camera": {"board": CHARUCO, "photos": "b*"}}, "camera.board.marker", "marker: 15 mm"),
]  # fmt: skip


@pytest.mark.parametrize(("where", "change", "key", "says"), WRONG)
def test_one_sentence_names_file_key_and_remedy(campaign, where, change, key, says):
    file = campaign / "campaign.yaml" if where is None else campaign / where / "experiment.yaml"
    edit(file, **change)
    with pytest.raises(InputError) as caught:
        load_campaign(campaign)
    sentence = str(caught.value)
    assert sentence.startswith(str(file)), sentence
    assert f" {key}: " in sentence and says in sentence, sentence
    assert "\n" not in sentence
    problems = [problem for problem in check_campaign(campaign).problems if problem.severity == "error"]
    assert key in [problem.key for problem in problems]


@pytest.mark.parametrize(
    ("where", "change", "says"),
    [
        (None, {"rig": {"gravity": {"angle": 30}}}, "rig.gravity.angle: 30 has no unit; write for example '30 deg'"),
        (None, {"rig": {"gravity": {"angel": "30 deg"}}}, "rig.gravity.angel: unknown key 'angel'; did you mean 'angle'?"),
        (None, {"rig": "down"}, "rig: found 'down'; a mapping is needed; known here: gravity"),
        (
            "steps",
            {"sync": {"method": "offset", "value": 1, "5 s": None}},  # 1,5 s
            "sync.5 s: '5 s' stands after a comma, which ends a value in braces; write decimals with a point",
        ),
        ("steps", {"sync": {"offset": "1 s"}}, "sync.offset: is no key but a word for 'method'; write 'method: offset'"),
        ("steps", {"clamp": [[1, 2], [3, 4]]}, "clamp: belongs in 'camera', as in 'camera: {clamp: ...}'"),
        ("steps", {"rate": "30 Hz"}, "rate: belongs in 'video' or 'frames' or 'track', as in 'video: {rate: ...}'"),
        ("steps", {"track": {"file": "track.csv", "fps": "30 Hz"}}, "track.fps: unknown key 'fps'; did you mean 'rate'?"),
        (
            None,
            {"actuator": {"section": {"length": "1 m"}}},
            "actuator.section.length: belongs one level up, beside 'section', and not in it",
        ),
        ("steps", {"pressure": "log 1.csv"}, "pressure: found 'log 1.csv'; write 'pressure: {file: log 1.csv}'"),
    ],
)
def test_a_fault_is_told_once_and_by_what_was_meant(campaign, where, change, says):
    """Of an angle without its unit it was said that 'angle' is unknown, asked whether 'angle' is meant, and that 'plumb' is missing."""
    edit(campaign / "campaign.yaml" if where is None else campaign / where / "experiment.yaml", **change)
    errors = [str(problem) for problem in read_campaign(campaign).problems if problem.severity == "error"]
    assert len(errors) == 1 and errors[0].endswith(says), errors


def test_missing_unit_is_found_on_its_line(campaign):
    (campaign / "campaign.yaml").write_text(
        "format: rfea-campaign/1\nname: a\nactuator:\n  length: 155 mm\n  outer_radius: 4\n"
    )
    with pytest.raises(InputError, match=r"campaign.yaml:5: actuator.outer_radius: 4 has no unit"):
        load_campaign(campaign)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"- a\n- b\n", "not a mapping"),
        (b"a: [1\nb: 2\n", ":2: not valid YAML"),
        (b"name: caf\xe9\n", ":1: not UTF-8 text"),
        (b"name: a\nrole: train\nname: b\n", ":3: 'name' stands here and on line 1"),
        (b"a: \x00\n", "not valid YAML"),
        (b"name: 2020-13-45\n", "not valid YAML"),
    ],
)
def test_a_broken_file_is_named_with_its_line(campaign, content, says):
    file = campaign / "steps" / "experiment.yaml"
    file.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_campaign(campaign)
    assert str(caught.value).startswith(str(file)) and says in str(caught.value)


def test_a_name_with_line_breaks_is_told_in_one_line(campaign):
    edit(campaign / "steps" / "experiment.yaml", track={"file": "tr\n\nack\u2028.csv"})
    (problem,) = read_campaign(campaign).problems
    assert "no file 'tr  ack .csv' in" in problem.message


def test_a_byte_order_mark_is_no_fault(campaign):
    file = campaign / "steps" / "experiment.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert load_campaign(campaign).experiment("steps").role == "train"


def test_no_training_experiment_is_said(tmp_path):
    campaign = write_campaign(tmp_path / "c", {"a": "validate", "b": "test"})
    with pytest.raises(InputError, match="no experiment has 'role: train'"):
        load_campaign(campaign)


def test_an_empty_campaign_is_said(tmp_path):
    (tmp_path / "campaign.yaml").write_text("format: rfea-campaign/1\nname: a\n")
    with pytest.raises(InputError, match="no experiment here"):
        load_campaign(tmp_path)


@pytest.mark.parametrize(
    ("name", "said"), [("gone", "no such folder"), ("file.txt", "is a file; give the campaign folder")]
)
def test_no_folder_is_said(tmp_path, name, said):
    (tmp_path / "file.txt").write_text("")
    with pytest.raises(InputError, match=said):
        load_campaign(tmp_path / name)
    with pytest.raises(InputError, match="holds neither"):
        load_campaign(tmp_path)


def test_check_lists_everything_at_once(campaign):
    edit(campaign / "campaign.yaml", actuator={"outer_radius": 4, "bends": "up"}, camera={"photos": "x*"})
    edit(campaign / "steps" / "experiment.yaml", role="trian", pressure={"file": "gone.csv"})
    (campaign / "sine" / "pressure.csv").write_text("time_s,pressure_kPa\n0,1\n0.1,nan\n0.2,3\n")
    (campaign / "sine" / "track.csv").write_text("time_s,tip_x_mm\n0,1\n")
    found = [(problem.experiment, problem.key) for problem in check_campaign(campaign).problems]
    expected = {
        (None, "actuator.outer_radius"),
        (None, "actuator.bends"),
        (None, "camera.board"),
        ("steps", "role"),
        ("steps", "pressure.file"),
        ("sine", "pressure"),
        ("sine", "track"),
    }
    assert expected <= set(found)
    assert len(found) == len(set(found))


def test_runs_with_scales_of_their_own_share_the_rest_of_their_cameras(campaign):
    """`camera: {vertical: rest}` above them had made the campaign unreadable; a track beside them needs no scale."""
    edit(campaign / "campaign.yaml", camera={"vertical": "rest"})
    (campaign / "steps" / "film.mp4").write_bytes(b"")
    scale = {"points": [[20, 30], [320, 30]], "distance": "100 mm"}
    edit(campaign / "steps" / "experiment.yaml", track=None, video={"file": "film.mp4"}, camera={"scale": scale})
    read = load_campaign(campaign)
    assert read.camera is None and read.experiment("sine").camera is None
    camera = read.experiment("steps").camera
    assert camera.vertical == "rest" and camera.scale.distance == pytest.approx(0.1)
    edit(campaign / "steps" / "experiment.yaml", camera=None)
    (problem,) = [problem for problem in read_campaign(campaign).problems if problem.severity == "error"]
    assert problem.experiment == "steps" and problem.key == "camera"
    assert problem.message.startswith("does not tell how long a pixel of 'steps' is; pictures need it: board and photos")


def test_one_broken_experiment_leaves_the_others(campaign):
    edit(campaign / "steps" / "experiment.yaml", role="trian")
    reading = read_campaign(campaign)
    assert reading.campaign is not None and reading.blocked is None
    assert [item.name for item in reading.campaign.experiments] == ["sine"]
    assert {problem.experiment for problem in reading.problems if problem.severity == "error"} == {"steps"}


def test_unknown_experiment_names_those_there_are(campaign):
    with pytest.raises(InputError, match="no experiment 'step'; there are: sine, steps"):
        load_campaign(campaign).experiment("step")


def test_output_of_an_earlier_run_is_no_experiment(campaign):
    write_experiment(campaign / "rfea", "rfea")
    assert "rfea" not in [item.name for item in load_campaign(campaign).experiments]


def test_two_experiments_of_one_name_are_both_named(campaign):
    edit(campaign / "steps" / "experiment.yaml", name="sine")
    problems = [problem for problem in read_campaign(campaign).problems if problem.key == "name"]
    assert [problem.file.parent.name for problem in problems] == ["sine", "steps"]
    assert all("names 2 experiments" in problem.message for problem in problems)


@pytest.mark.parametrize(
    ("actuator", "key", "says"),
    [
        ({"section": {"kind": "rod"}}, "actuator.section.chamber_area", "for example 'chamber_area: 60 mm^2'"),
        (
            {"section": {"kind": "tube", "chamber_area": "60 mm^2"}},
            "actuator.section.chamber_area",
            "of the kind 'tube'",
        ),
        ({"section": {"kind": "rod", "width": "3 mm"}}, "actuator.section.width", "has no meaning"),
        ({"section": {"kind": "rod"}, "inner_radius": "3 mm"}, "actuator.inner_radius", "leave it out"),
    ],
)
def test_a_section_holds_what_its_kind_uses(campaign, actuator, key, says):
    edit(campaign / "campaign.yaml", actuator=actuator)
    found = [problem for problem in read_campaign(campaign).problems if problem.severity == "error"]
    assert found and {problem.key for problem in found} == {key}
    assert all(says in problem.message for problem in found)
    edit(campaign / "campaign.yaml", actuator={"section": {"kind": "rod"}})
    for run in ("steps", "sine"):
        edit(campaign / run / "experiment.yaml", pressure={"value": "0 kPa"})
    assert not [problem for problem in read_campaign(campaign).problems if problem.severity == "error"]


def test_folders_that_look_like_runs_and_are_not_read_are_said(campaign):
    for name in ("spare", "lent", "monday/sine-2"):
        write_experiment(campaign / name, name.rpartition("/")[2])
    for name in ("spare", "lent"):
        (campaign / name / "experiment.yaml").unlink()
    steps = campaign / "steps" / "experiment.yaml"
    steps.write_text(steps.read_text().replace("file: pressure.csv", "file: lent/pressure.csv"))
    write_experiment(campaign / "another" / "sine", "sine")
    (campaign / "another" / "campaign.yaml").write_text("format: rfea-campaign/1\n")
    said = [str(problem) for problem in read_campaign(campaign).problems]
    assert len(said) == 2 and all(str(campaign) in text for text in said), said
    assert "monday/sine-2: is not read; move it up beside campaign.yaml" in said[0]
    assert "spare: is not read, as it has no experiment.yaml; write one" in said[1]


def test_a_run_that_is_not_asked_for_stops_none_that_is(tmp_path):
    """`rfea track -e steps` had stopped with the missing file of another run."""
    folder = write_campaign(tmp_path / "c", {"steps": "train", "other": "train"})
    (folder / "other" / "track.csv").unlink()
    assert [run.name for run in load_campaign(folder, only=["steps"]).experiments] == ["steps"]
    for only in ([], ["other"], ["steps", "other"]):
        with pytest.raises(InputError, match=r"other.*track\.csv"):
            load_campaign(folder, only=only)
    file = folder / "steps" / "experiment.yaml"
    file.write_text(file.read_text() + "memory: carried\n")
    with pytest.raises(InputError, match="steps carries the memory of the runs before it, and needs them"):
        load_campaign(folder, only=["steps"])


def test_a_run_is_told_by_its_name_where_its_folder_is_asked_for(campaign):
    edit(campaign / "steps" / "experiment.yaml", name="first")
    with pytest.raises(InputError, match=r"no experiment 'steps'; there are: .*; the one in that folder has the name 'first'"):
        load_campaign(campaign).experiment("steps")


def test_pictures_without_a_table_of_times_are_told_of_their_rate(campaign):
    """They were asked for frames.csv alone, which an even rate does not need."""
    file = campaign / "steps" / "experiment.yaml"
    file.write_text(file.read_text().replace("track: {file: track.csv}", "frames: {folder: frames}"))
    (campaign / "steps" / "frames").mkdir()
    told = [str(problem) for problem in read_campaign(campaign).problems if problem.key == "frames.times"]
    assert len(told) == 1 and told[0].endswith("or, where they were taken at an even rate, write frames.rate, such as '30 Hz'")
