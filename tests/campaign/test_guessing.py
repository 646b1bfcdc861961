"""`rfea init --from`: what is guessed is right, and marked; what cannot be guessed is asked for."""

import re

import av
import numpy as np
import pandas as pd
import pytest
import yaml

from rfea_vision.campaign import load_campaign, read_campaign
from rfea_vision.campaign.check import check_campaign
from rfea_vision.campaign.from_files import write_campaign_from
from rfea_vision.campaign.guess import look
from rfea_vision.campaign.schema import CampaignFile
from rfea_vision.campaign.template import write_campaign_template
from rfea_vision.cli.setup import guessed_once
from rfea_vision.errors import InputError
from rfea_vision.readers.pressure import read_pressure
from rfea_vision.readers.tracks import read_track

TIME_S = np.arange(400) * 0.01
PRESSURE_kPa = 60.0 - 60.0 * np.cos(2 * np.pi * 0.5 * TIME_S)
ANGLE_deg = 0.3 * PRESSURE_kPa

HEADERS = [
    ({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa}, 0),
    ({"Zeit [s]": TIME_S, "Druck [mbar]": PRESSURE_kPa * 10}, 2),
    ({"temps (ms)": TIME_S * 1e3, "pression (bar)": PRESSURE_kPa / 100}, 2),
    ({"Tiempo (s)": TIME_S, "Presión (kPa)": PRESSURE_kPa, "Temperatura": np.full(400, 21.5)}, 2),
    ({"aika": TIME_S * 1e3, "paine_kPa": PRESSURE_kPa}, 3),
    ({"время": TIME_S, "давление [hPa]": PRESSURE_kPa * 10}, 3),
    ({"时间 [s]": TIME_S, "压力 [kPa]": PRESSURE_kPa}, 2),
    ({"A": TIME_S, "B": PRESSURE_kPa}, 4),
    ({"time_s": TIME_S, "p": PRESSURE_kPa / 100}, 2),
    ({"time_s": TIME_S, "p": 10 * PRESSURE_kPa + 1013.25}, 3),
    ({"sample_t": TIME_S, "p_abs [kPa]": PRESSURE_kPa + 101.3, "p_atm [kPa]": np.full(400, 101.3)}, 5),
    ({"t": TIME_S, "p_psig": PRESSURE_kPa / 6.894757293168361}, 3),
    ({"millis": np.round(1e3 * TIME_S), "p_kPa": PRESSURE_kPa}, 2),
    ({"time_ms": np.round(1e3 * TIME_S), "kPa": PRESSURE_kPa}, 2),
    ({"millis": np.round(1e3 * TIME_S), "adc": np.round(20 * PRESSURE_kPa), "psi": PRESSURE_kPa / 6.894757293168361}, 2),
]


def a_film(path):
    """A film of three pictures."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("gif" if path.suffix == ".gif" else "mpeg4", rate=25, width=64, height=48)
        stream.pix_fmt = "rgb8" if path.suffix == ".gif" else "yuv420p"
        for grey in (60, 90, 120):
            picture = av.VideoFrame.from_ndarray(np.full((48, 64, 3), grey, np.uint8), format="rgb24")
            container.mux(stream.encode(picture.reformat(format=stream.pix_fmt)))
        container.mux(stream.encode())


def tip_track(bends, beside_mm=0.0):
    x = beside_mm + np.sin(np.deg2rad(ANGLE_deg)) * 120.0 * (-1 if bends == "left" else 1)
    return pd.DataFrame({"time_s": TIME_S, "tip_x_mm": x, "tip_y_mm": -120.0 * np.cos(np.deg2rad(ANGLE_deg))})


@pytest.mark.parametrize(("columns", "guesses"), HEADERS)
def test_time_and_pressure_are_told_in_many_languages(tmp_path, columns, guesses):
    (tmp_path / "data").mkdir()
    pd.DataFrame(columns).to_csv(tmp_path / "data" / "run1_log.csv", index=False)
    tip_track("right").to_csv(tmp_path / "data" / "run1_track.csv", index=False)
    written = write_campaign_from(tmp_path / "tube", [tmp_path / "data"])
    run = load_campaign(tmp_path / "tube").experiment("run1")
    log = read_pressure(run.pressure)
    np.testing.assert_allclose(log.time_s, TIME_S, atol=1e-9)
    np.testing.assert_allclose(log.pressure_kPa, PRESSURE_kPa, atol=1e-6)
    text = (tmp_path / "tube" / "run1" / "experiment.yaml").read_text()
    inside = text[text.index("pressure:") : text.index("sync:")]
    assert inside.count("# guessed:") - 1 == guesses  # one is that the two files belong together
    assert sum(item.startswith("run1.pressure.") for item in written.guesses) == guesses
    assert (tmp_path / "tube" / "run1" / "run1_log.csv").stat().st_size > 0


def test_a_line_that_was_never_open_is_told_by_the_air_beside_it(tmp_path):
    table = pd.DataFrame({"t": TIME_S, "Druck [hPa]": 10 * PRESSURE_kPa + 1163.2, "Umgebung [hPa]": 963.2})
    table.to_csv(tmp_path / "labor.csv", index=False, sep=";", decimal=",")
    keys = {key.name: key.value for key in look(tmp_path / "labor.csv").pressure}
    assert keys["reference"] == "absolute" and keys["ambient"] == "Umgebung [hPa]"


@pytest.mark.parametrize("bends", ["left", "right"])
def test_markers_beside_the_line_do_not_turn_the_side(tmp_path, bends):
    """The tip of a real arm stood 23 mm beside the middle of its clamp's markers, and was driven back over it by 4 to 40 mm."""
    track = tip_track(bends, 150.0 if bends == "left" else -150.0)
    track.to_csv(tmp_path / "arm_track.csv", index=False)
    pd.DataFrame({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa}).to_csv(tmp_path / "arm_pressure.csv", index=False)
    write_campaign_from(tmp_path, [tmp_path])
    assert load_campaign(tmp_path).actuator.bends == bends


@pytest.mark.parametrize("bends", ["left", "right"])
def test_several_runs_and_what_the_tracks_tell_of_the_tube(tmp_path, bends):
    for index in (1, 2, 3):
        tip_track(bends).to_csv(tmp_path / f"step{index}_tracking.csv", index=False)
        pd.DataFrame({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa}).to_csv(
            tmp_path / f"step{index}-pressure.csv", index=False
        )
    (tmp_path / "readme.pdf").write_text("what was done")
    written = write_campaign_from(tmp_path, [tmp_path])
    campaign = load_campaign(tmp_path)
    assert [(run.name, run.role) for run in campaign.experiments] == [
        ("step1", "train"), ("step2", "train"), ("step3", "validate")]  # fmt: skip
    assert campaign.actuator.bends == bends and campaign.actuator.length == pytest.approx(0.120, rel=1e-3)
    assert campaign.experiment("step2").pressure.file == (tmp_path / "step2-pressure.csv").resolve()
    assert any("readme.pdf" in item for item in written.left_out)
    assert not (tmp_path / "step1" / "step1_tracking.csv").exists()  # what lies inside stays where it is


def test_an_encoder_beside_the_pressure_is_one_run_on_one_clock(tmp_path):
    frame = pd.DataFrame({"Zeit [s]": TIME_S, "Winkel [rad]": np.deg2rad(ANGLE_deg), "Druck [bar]": PRESSURE_kPa / 100})
    frame.to_csv(tmp_path / "messung.csv", index=False, sep=";", decimal=",", encoding="cp1252")
    write_campaign_from(tmp_path / "tube", [tmp_path / "messung.csv"])
    run = load_campaign(tmp_path / "tube").experiments[0]
    assert run.sync.method == "common_clock"
    track = read_track(run.track.file, spec=run.track.keys)
    np.testing.assert_allclose(track.dataset["bend_angle"], ANGLE_deg, atol=1e-6)
    np.testing.assert_allclose(read_pressure(run.pressure).pressure_kPa, PRESSURE_kPa, atol=1e-9)


def test_a_track_has_the_unit_and_the_clock_of_its_columns(tmp_path):
    """Neither header says a unit; a set point and a simulated angle are not what was measured."""
    columns = {"time": 1e3 * TIME_S, "pressure": PRESSURE_kPa, "reference_angle": 0.5, "simulated_angle": 2.0}
    pd.DataFrame({**columns, "sensor": np.deg2rad(ANGLE_deg)}).to_csv(tmp_path / "run.csv", index=False)
    write_campaign_from(tmp_path / "tube", [tmp_path / "run.csv"])
    run = load_campaign(tmp_path / "tube").experiments[0]
    track = read_track(run.track.file, spec=run.track.keys)
    np.testing.assert_allclose(track.time_s, TIME_S, atol=1e-9)
    np.testing.assert_allclose(track.dataset["bend_angle"], ANGLE_deg, atol=1e-6)
    np.testing.assert_allclose(read_pressure(run.pressure).time_s, TIME_S, atol=1e-9)


def test_columns_beside_a_clock_of_another_name_are_points(tmp_path):
    frame = pd.DataFrame({"t [ms]": 1e3 * TIME_S, "p [bar]": PRESSURE_kPa / 100, "base_x_mm": 0.0, "base_y_mm": 0.0})
    frame["tip_x_mm"], frame["tip_y_mm"] = tip_track("left")["tip_x_mm"], tip_track("left")["tip_y_mm"]
    frame.rename(columns={"tip_x_mm": "end_x_mm", "tip_y_mm": "end_y_mm"}).to_csv(tmp_path / "run.csv", index=False)
    write_campaign_from(tmp_path / "tube", [tmp_path / "run.csv"])
    run = load_campaign(tmp_path / "tube").experiments[0]
    np.testing.assert_allclose(read_track(run.track.file, spec=run.track.keys).time_s, TIME_S, atol=1e-9)
    np.testing.assert_allclose(read_pressure(run.pressure).pressure_kPa, PRESSURE_kPa, atol=1e-9)


def test_points_of_a_picture_in_a_table_tell_how_the_tube_hangs(tmp_path):
    """Nothing in a table of bare numbers says that y counts downwards, but that the tip hangs below the clamp."""
    hanging = tip_track("right")
    frame = pd.DataFrame({"time": TIME_S, "base_pos_x": 560.0, "base_pos_y": 340.0, "tip_pos_x": 560 + hanging["tip_x_mm"]})
    frame["tip_pos_y"] = 340 - hanging["tip_y_mm"]
    frame.to_csv(tmp_path / "run.csv", index=False)
    write_campaign_from(tmp_path / "tube", [tmp_path / "run.csv"])
    text = next((tmp_path / "tube").glob("*/experiment.yaml")).read_text()
    assert yaml.safe_load(text)["track"]["axes"] == ["x", "-y"] and "the tip lies along y" in text


def test_points_in_space_tell_how_the_tube_hangs(tmp_path):
    """The file's y points down, and its z away from where the tube bends; the clamp stands at another place than 0."""
    hanging = tip_track("left")
    frame = pd.DataFrame({"time_s": TIME_S, "base_x_m": 0.3, "base_y_m": 1.0, "base_z_m": 0.1, "tip_x_m": 0.3001})
    frame["tip_y_m"], frame["tip_z_m"] = 1.0 - hanging["tip_y_mm"] / 1e3, 0.1 - hanging["tip_x_mm"] / 1e3
    frame.to_csv(tmp_path / "run.csv", index=False)
    write_campaign_from(tmp_path / "tube", [tmp_path / "run.csv"])
    campaign = load_campaign(tmp_path / "tube")
    run, bends = campaign.experiments[0], campaign.actuator.bends
    assert bends == "right" and campaign.actuator.length == pytest.approx(0.120, rel=1e-3)
    tip = read_track(run.track.file, spec=run.track.keys).dataset["tip"]
    np.testing.assert_allclose(tip, hanging[["tip_x_mm", "tip_y_mm"]] * [-1.0, 1.0], atol=1e-6)


def test_two_nameless_columns_are_an_angle_where_nothing_else_moves(tmp_path):
    for name in ("small", "large"):
        np.savetxt(tmp_path / f"{name}.txt", np.stack([TIME_S, ANGLE_deg], axis=1))
    write_campaign_from(tmp_path / "tube", [tmp_path / "small.txt", tmp_path / "large.txt"])
    run = load_campaign(tmp_path / "tube").experiments[0]
    np.testing.assert_allclose(read_track(run.track.file, spec=run.track.keys).dataset["bend_angle"], ANGLE_deg, atol=1e-6)


def test_a_temperature_beside_the_pressure_is_no_angle(tmp_path):
    pd.DataFrame({"time_s": TIME_S, "p [bar]": PRESSURE_kPa / 100, "T [°C]": 20 + TIME_S}).to_csv(tmp_path / "log.csv", index=False)
    assert [key.name for key in look(tmp_path / "log.csv").motion] == ["file"]


def test_numbers_without_a_header_are_asked_for_one(tmp_path):
    np.savetxt(tmp_path / "rig.txt", np.stack([TIME_S, PRESSURE_kPa, ANGLE_deg, PRESSURE_kPa], axis=1), delimiter="|")
    with pytest.raises(
        InputError, match="write a line of names above its numbers, for example 'time_s,p_kPa,angle_deg'"
    ):
        write_campaign_from(tmp_path / "tube", [tmp_path / "rig.txt"])


def test_what_nobody_can_guess_is_asked_for(tmp_path):
    header = "scorer,n,n,n,n,n,n\nbodyparts,tip,tip,tip,clamp,clamp,clamp\ncoords,x,y,likelihood,x,y,likelihood\n"
    rows = "".join(f"{i},{i},5,0.9,1,2,0.9\n" for i in range(5))
    (tmp_path / "aDLC_resnet50.csv").write_text(header + rows)
    written = write_campaign_from(tmp_path / "tube", [tmp_path / "aDLC_resnet50.csv"])
    text = next((tmp_path / "tube").glob("*/experiment.yaml")).read_text()
    assert "points: [clamp, tip]  # guessed: by their names" in text
    assert "# scale: 0.25 mm  # needed:" in text and "# rate: 100 Hz  # needed:" in text and "# pressure:" in text
    assert sum("needed, and not guessed" in item for item in written.guesses) == 3
    assert yaml.safe_load(text)["track"]["points"] == ["clamp", "tip"]


def test_a_film_without_a_board_is_asked_for_one_or_for_a_scale_in_lines_that_can_be_uncommented(tmp_path):
    """The board's line had been cut in two at its first colon."""
    a_film(tmp_path / "a.mkv")
    written = write_campaign_from(tmp_path / "tube", [tmp_path / "a.mkv"])
    lines = (tmp_path / "tube" / "campaign.yaml").read_text().splitlines()[1:]
    asked = yaml.safe_load("\n".join(line.replace("# ", "", 1) for line in lines if "needed: " in line or "# " not in line))["camera"]
    assert asked["board"] == {"kind": "checkerboard", "inner_corners": [9, 6], "square": "12 mm"}
    assert asked["scale"] == {"points": [["x", "y"], ["x", "y"]], "distance": "155 mm"}
    assert "camera.board: needed, and not guessed: a board, with 'photos' of it; or 'scale'" in written.guesses


def test_an_animated_picture_is_a_film(tmp_path):
    """The tracker reads it, and it had been left out as a file without a reader."""
    a_film(tmp_path / "arm.gif")
    write_campaign_from(tmp_path / "tube", [tmp_path / "arm.gif"])
    assert "video:\n  file: arm.gif\n" in (tmp_path / "tube" / "arm" / "experiment.yaml").read_text()


def test_a_film_that_cannot_be_opened_is_left_out_and_told_why(tmp_path):
    """It became a run, the one that was to judge the model, and nothing was said."""
    for name in "ab":
        a_film(tmp_path / f"{name}.mp4")
        pd.DataFrame({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa}).to_csv(tmp_path / f"{name}.csv", index=False)
    whole = (tmp_path / "a.mp4").read_bytes()
    (tmp_path / "c.mp4").write_bytes(whole[: len(whole) // 2])
    written = write_campaign_from(tmp_path / "tube", sorted(tmp_path.glob("*.*")))
    assert [path.parent.name for path in written.files[:-1]] == ["a", "b"]
    assert len(written.left_out) == 1 and "c.mp4: holds no video stream" in written.left_out[0]


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ("time_s,pressure_kPa\n0,1\n1,OVL\n2,3\n", "column 'pressure_kPa', row 2: 'OVL' is not a number; correct or remove the row"),
        ("p [kPa]\n1\n3\n2\n", "column 'p [kPa]' has no time beside it that rises from row to row; add a column 'time_s'"),
        ("14:03:11.5 12.5\n14:03:11.6 13\n", "no header line; name the columns, for example 'time_s,pressure_kPa'"),
    ],
)
def test_why_a_log_is_none_is_told(tmp_path, text, note):
    """Of each it was said that no column looks like a pressure, a tip or an angle."""
    (tmp_path / "log.csv").write_text(text)
    assert look(tmp_path / "log.csv").note == note


def test_a_workbook_is_told_to_be_saved_as_text(tmp_path):
    assert look(tmp_path / "log.xlsx").note == "no reader for '.xlsx'; save it as CSV"


def test_pictures_of_a_film_are_told_how_they_are_read(tmp_path):
    """That none of them is a film was all that was said."""
    for number in range(31):
        (tmp_path / f"{number}.png").touch()
    with pytest.raises(InputError, match=r"of pictures that are a film .*'frames: \{folder: NAME, rate: 30 Hz\}' in it"):
        write_campaign_from(tmp_path / "tube", [tmp_path])


def test_the_run_that_judges_has_a_pressure(tmp_path):
    """The last one was set aside, with a log or without."""
    for name in "abc":
        a_film(tmp_path / f"{name}.mp4")
    for name in "ab":
        pd.DataFrame({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa}).to_csv(tmp_path / f"{name}.csv", index=False)
    write_campaign_from(tmp_path / "tube", sorted(tmp_path.glob("*.*")))
    roles = [yaml.safe_load((tmp_path / "tube" / name / "experiment.yaml").read_text())["role"] for name in "abc"]
    assert roles == ["train", "validate", "train"]


@pytest.mark.parametrize("guessed", [False, True])
def test_what_most_films_need_stands_in_lines_that_can_be_uncommented(tmp_path, guessed):
    """Clamp, tip, vertical and rig were to be looked up, and where they belong; untouched these lines say nothing."""
    a_film(tmp_path / "a.mkv")
    write_campaign_from(tmp_path / "tube", [tmp_path / "a.mkv"]) if guessed else write_campaign_template(tmp_path / "tube")
    text = (tmp_path / "tube" / "campaign.yaml").read_text()
    before = yaml.safe_load(text)
    plain = re.sub(r"^( *)# (\w+: .*# if needed: )", r"\1\2", text, flags=re.MULTILINE)
    keys = CampaignFile.model_validate(yaml.safe_load(plain.replace("[x, y]", "[3, 4]")))
    assert keys.camera is not None and keys.rig is not None
    assert (keys.camera.clamp, keys.camera.tip, keys.camera.vertical) == (((3, 4), (3, 4)), (3, 4), "rest")
    assert "rig" not in before and not {"clamp", "tip", "vertical"} & set(before["camera"] or {})


def test_groups_of_markers_are_the_clamp_and_the_tip(tmp_path, shared_data):
    write_campaign_from(tmp_path / "beam", [shared_data / "clamped-beam"])
    text = (tmp_path / "beam" / "gravity-a" / "experiment.yaml").read_text()
    assert "points: [[base1, base2, base3], [tip1, tip2, tip3]]  # guessed: by their names" in text
    axes = yaml.safe_load(text)["track"]["axes"]
    assert "# guessed: from the clamp the tip lies along" in text and len(axes) == 2 and text.count("scale") == 0


def test_names_cannot_write_yaml(tmp_path):
    odd = tmp_path / 'log "x" role: test #.csv'
    pd.DataFrame({"t": TIME_S, 'p: "} [kPa]': PRESSURE_kPa, "angle_deg": ANGLE_deg}).to_csv(odd, index=False)
    write_campaign_from(tmp_path / "tube", [odd])
    reading = read_campaign(tmp_path / "tube")
    assert not [item for item in reading.problems if item.severity == "error"]
    run = reading.campaign.experiments[0]
    assert run.role == "train" and run.pressure.keys.pressure == 'p: "} [kPa]' and run.pressure.file.name == odd.name


def test_nothing_is_overwritten_and_nothing_is_made_of_nothing(tmp_path):
    (tmp_path / "note.txt").write_text("hello\n")
    with pytest.raises(InputError, match="none of the files holds a film or a track"):
        write_campaign_from(tmp_path / "tube", [tmp_path / "note.txt"])
    tip_track("left").to_csv(tmp_path / "a.csv", index=False)
    write_campaign_from(tmp_path / "tube", [tmp_path / "a.csv"])
    with pytest.raises(InputError, match="is there already"):
        write_campaign_from(tmp_path / "tube", [tmp_path / "a.csv"])
    with pytest.raises(InputError, match="not found"):
        write_campaign_from(tmp_path / "other", [tmp_path / "gone.csv"])


@pytest.mark.parametrize("cell", ["nan", "inf", "text"])
def test_a_track_without_a_number_is_looked_at_all_the_same(tmp_path, cell):
    rows = "".join(f"{time / 100},{cell},{cell},{cell}\n" for time in range(20))
    (tmp_path / "a.csv").write_text(f"time_s,tip_x_mm,tip_y_mm,pressure_kPa\n{rows}")
    found = look(tmp_path / "a.csv")
    assert found.what in ("track", "unknown") and not found.actuator


def test_a_track_without_a_log_is_told_what_stands_for_one(tmp_path):
    """Of a beam that is let go there is no log: the lines that it needs stand in the file, and hold once uncommented."""
    tip_track("left").to_csv(tmp_path / "beam.csv", index=False)
    write_campaign_from(tmp_path / "made", [tmp_path / "beam.csv"])
    (path,) = (tmp_path / "made").glob("*/experiment.yaml")
    kept = [line for line in path.read_text().splitlines() if "{file: pressure.csv}" not in line]
    path.write_text("\n".join(line.removeprefix("# ") for line in kept))
    campaign = load_campaign(tmp_path / "made")
    (run,) = campaign.experiments
    assert run.pressure.constant_kPa == 0.0 and run.rig.held


def test_a_log_in_two_parts_is_told_to_be_joined(tmp_path):
    tip_track("left").to_csv(tmp_path / "a.csv", index=False)
    log = pd.DataFrame({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa})
    for part, rows in (("x-1", log[:200]), ("x-2", log[200:])):
        rows.to_csv(tmp_path / f"{part}.csv", index=False)
    left_out = write_campaign_from(tmp_path / "made", [tmp_path]).left_out
    assert len(left_out) == 2 and all("join the parts of one run into one file" in item for item in left_out)


CHAMBERS = [
    (("p_left_kPa", "p_right_kPa"), ("left", "right"), (1, -1)),
    (("chamber 1 [bar]", "chamber 2 [bar]", "chamber 3 [bar]"), ("chamber1", "chamber2", "chamber3"), (1, 1, 1)),
    (("Druck oben [mbar]", "Druck unten [mbar]"), ("oben", "unten"), (1, -1)),
    (("pressureExtensor (kPa)", "pressureFlexor (kPa)"), ("extensor", "flexor"), (-1, 1)),
]


@pytest.mark.parametrize(("headers", "chambers", "signs"), CHAMBERS)
@pytest.mark.filterwarnings("ignore")
def test_pressures_that_are_called_chambers_are_written_as_such(tmp_path, headers, chambers, signs):
    factor = next(value for unit, value in {"kPa": 1, "mbar": 10, "bar": 0.01}.items() if unit in headers[0])
    columns = {name: factor * (index + 1) * PRESSURE_kPa for index, name in enumerate(headers)}
    supply = {"supply [kPa]": np.full(400, 600.0)}
    pd.DataFrame({"t [s]": TIME_S, **supply, **columns}).to_csv(tmp_path / "log.csv", index=False)
    tip_track("left").to_csv(tmp_path / "log_track.csv", index=False)
    written = write_campaign_from(tmp_path / "tube", [tmp_path])
    parts = load_campaign(tmp_path / "tube").experiments[0].pressure.chambers
    assert [part.name for part in parts] == list(chambers) and [part.keys.sign for part in parts] == list(signs)
    log = read_pressure(load_campaign(tmp_path / "tube").experiments[0].pressure)
    for index, chamber in enumerate(chambers):
        np.testing.assert_allclose(log.chambers[chamber], (index + 1) * PRESSURE_kPa, atol=1e-6)
    assert sum(".sign: " in item for item in written.guesses) == len(chambers)


@pytest.mark.parametrize(("lowest", "references"), [((100.0, 109.0), {"absolute"}), ((0.0, 100.0), {None})])
def test_sensors_of_one_rig_are_all_absolute_or_none(tmp_path, lowest, references):
    """One reads a little above the air's pressure at rest; in another rig a chamber is never open."""
    columns = {f"{side}_pressure": low + PRESSURE_kPa for side, low in zip(("left", "right"), lowest, strict=True)}
    pd.DataFrame({"t": TIME_S, **columns, "angle_deg": ANGLE_deg}).to_csv(tmp_path / "run.csv", index=False)
    write_campaign_from(tmp_path / "tube", [tmp_path / "run.csv"])
    text = next((tmp_path / "tube").glob("*/experiment.yaml")).read_text()
    assert {chamber.get("reference") for chamber in yaml.safe_load(text)["pressure"]} == references


@pytest.mark.parametrize("headers", [("p1", "p2"), ("p_left_kPa", "p_2_kPa"), ("p chamber [kPa]", "p chamber (kPa)")])
def test_pressures_that_nothing_calls_chambers_are_asked_for(tmp_path, headers):
    pd.DataFrame({"t": TIME_S, headers[0]: PRESSURE_kPa, headers[1]: PRESSURE_kPa}).to_csv(
        tmp_path / "a.csv", index=False
    )
    guess = look(tmp_path / "a.csv")
    assert guess.chambers == () and "of several chambers" in next(
        key.why for key in guess.pressure if key.name == "pressure"
    )


def test_a_column_that_never_changes_is_no_pressure_of_a_chamber(tmp_path):
    """Loggers write the zero of each sensor beside its pressure; of chambers those that move are asked about."""
    table = {"t": TIME_S, "p01": 1011.7, "p1": 10 * PRESSURE_kPa + 1011.7, "p02": 1006.5, "p2": PRESSURE_kPa + 1006.5}
    pd.DataFrame(table).to_csv(tmp_path / "a.csv", index=False)
    (key,) = (key for key in look(tmp_path / "a.csv").pressure if key.name == "pressure")
    assert key.value == "p1" and "also p2:" in key.why
    pd.DataFrame({"t": TIME_S, "p1 [kPa]": 0.0}).to_csv(tmp_path / "b.csv", index=False)  # a run without a push
    assert any(key.value == "p1 [kPa]" for key in look(tmp_path / "b.csv").pressure)


def test_every_run_has_a_name_of_its_own_and_yaml_reads_no_other_thing_into_it(tmp_path):
    names = ("r-3.csv", "r.csv", "sub/r.csv", "no.csv", "null.csv")
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        tip_track("left").assign(pressure_kPa=PRESSURE_kPa).to_csv(tmp_path / name, index=False)
    write_campaign_from(tmp_path / "tube", [tmp_path / name for name in names])
    reading = read_campaign(tmp_path / "tube")
    assert not [item for item in reading.problems if item.severity == "error"]
    assert {item.name for item in reading.campaign.experiments} == {"r-3", "r", "r-2", "no", "null"}


def test_runs_in_folders_of_their_own_are_called_as_these_where_their_files_are_called_alike(tmp_path):
    """Ten runs, each `RUN/webcam.mp4` and `RUN/log.csv`, had been called webcam, webcam-2, ... webcam-10."""
    for name in ("01_stairs", "02_ramp"):
        (tmp_path / name).mkdir()
        a_film(tmp_path / name / "front_view.mp4")
        log = {"millis": np.round(1e3 * TIME_S + 48213), "pressure_psi": PRESSURE_kPa / 6.894757}
        pd.DataFrame(log).to_csv(tmp_path / name / "log.csv", index=False)
    written = write_campaign_from(tmp_path / "finger", [tmp_path / "01_stairs", tmp_path / "02_ramp"])
    assert {path.parent.name for path in written.files} == {"finger", "01_stairs", "02_ramp"}


@pytest.mark.parametrize("followed", ["p1", "p3"])
def test_of_several_pressures_the_one_is_taken_that_the_motion_follows(tmp_path, followed):
    """Boards log every line there is; the first had been taken, whatever bent the body."""
    rng = np.random.default_rng(3)
    other = 40.0 + 30.0 * np.sin(2 * np.pi * 0.31 * TIME_S + 1.0)
    table = {"t": TIME_S, **{name: other + rng.standard_normal(400) for name in ("p1", "p2", "p3")}}
    table |= {followed: PRESSURE_kPa, "angle": ANGLE_deg + rng.standard_normal(400)}
    pd.DataFrame(table).to_csv(tmp_path / "a.csv", index=False)
    (key,) = (key for key in look(tmp_path / "a.csv").pressure if key.name == "pressure")
    assert key.value == followed and "the motion follows this one best" in key.why
    assert "also" in key.why and followed not in key.why.partition("also")[2]


def test_how_a_rigid_body_is_turned_is_told_to_need_an_angle(tmp_path):
    """Pressure and the pose of a body in one table had been taken for a log that belongs to no track."""
    time_s = np.arange(0, 4, 0.05)
    half = 0.4 * np.sin(time_s) ** 2
    turned = {"qx": np.sin(half), "qy": 0 * half, "qz": 0 * half, "qw": np.cos(half)}
    run = pd.DataFrame({"time_s": time_s, "p_kPa": 100 * half, "x": 0.1 * half, "y": 0 * half, "z": 0 * half - 0.2, **turned})
    run.to_csv(tmp_path / "run.csv", index=False)
    with pytest.raises(InputError, match=r"run.csv: a log, and how a body is turned \(qx, qy, qz, qw\).*a column angle_deg"):
        write_campaign_from(tmp_path / "new", [tmp_path / "run.csv"])
    run.assign(angle_deg=np.degrees(2 * half)).to_csv(tmp_path / "run.csv", index=False)
    assert look(tmp_path / "run.csv").what == "both"



def test_a_log_whose_clock_cannot_be_read_is_told_by_its_clock(tmp_path):
    """It was said that no column looks like a pressure."""
    file = tmp_path / "log.csv"
    file.write_text("Zeit;Druck [bar]\n" + "".join(f"03/11/2026 14:03:1{k};0,{3 * k % 5}\n" for k in range(5)))
    found = look(file)
    assert found.what == "unknown" and found.note.startswith("column 'Zeit' holds no numbers") and "day or the month" in found.note


def test_a_leap_of_a_track_is_not_taken_for_the_tubes_length_or_side(tmp_path):
    """Of a finger of 120 mm, whose marker was mistaken in a few rows, the length was guessed as 127 mm and doubted as 141 mm."""
    table = tip_track("left")
    table.loc[20, ["tip_x_mm", "tip_y_mm"]] = [139.0, -30.0]
    table.to_csv(tmp_path / "step_tracking.csv", index=False)
    pd.DataFrame({"time_s": TIME_S, "pressure_kPa": PRESSURE_kPa}).to_csv(tmp_path / "step-pressure.csv", index=False)
    write_campaign_from(tmp_path, [tmp_path])
    campaign = load_campaign(tmp_path)
    assert campaign.actuator.bends == "left" and campaign.actuator.length == pytest.approx(0.120, rel=2e-3)
    assert not [item for item in check_campaign(tmp_path).problems if "actuator.length" in str(item)]


def test_a_guess_that_runs_have_alike_is_printed_once():
    """Of six runs the seven guesses about each were 36 lines, and those about the tube came last."""
    guesses = ["a.role: train: a", "b.role: train: a", "b-2.role: train: a", "b.pressure: b.csv: names", "actuator.length: 9 mm: paper"]
    assert guessed_once(guesses, {"a", "b", "b-2"}) == [
        "a.role: train: a (likewise b, b-2)", "b.pressure: b.csv: names", "actuator.length: 9 mm: paper"]  # fmt: skip
