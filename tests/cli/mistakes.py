"""Mistakes of a beginner: how each is seeded into a campaign that is right, and what is to be said of it."""

import av
import cv2
import numpy as np
import pandas as pd


def text(old, new, file="campaign.yaml"):
    """Write something else in a file."""

    def spoil(folder):
        before = (folder / file).read_text()
        assert old in before
        (folder / file).write_text(before.replace(old, new, 1))

    return spoil


def log(change):
    """Change the pressure log of a run: `change` takes its rows as text, the header first."""

    def spoil(folder):
        path = folder / "steps" / "pressure.csv"
        path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")

    return spoil


def pressures(change):
    """Change the numbers of the pressure log."""

    def spoil(folder):
        table = pd.read_csv(folder / "steps" / "pressure.csv")
        table["pressure_kPa"] = change(table["pressure_kPa"])
        table.to_csv(folder / "steps" / "pressure.csv", index=False)

    return spoil


def content(file, data):
    return lambda folder: (folder / file).write_bytes(data)


def renamed(old, new):
    return lambda folder: (folder / old).rename(folder / new)


def in_a_folder_of_windows(folder):
    (folder / "steps" / "data").mkdir()
    renamed("steps/track.csv", "steps/data/track.csv")(folder)
    text("file: track.csv", "file: data\\track.csv", RUN)(folder)


def a_folder_called(name):
    def spoil(folder):
        (folder / name).unlink()
        (folder / name).mkdir()

    return spoil


def few_rows(folder):
    path = folder / "steps" / "track.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:6]) + "\n")


def film_of_nothing(folder):
    text("track: {file: track.csv}", "video: {file: v.mp4}", RUN)(folder)
    (folder / "steps" / "v.mp4").touch()


def copied(file):
    return lambda folder: (folder / "steps" / file).write_bytes((folder / "sine" / file).read_bytes())


def copied_film(folder):
    for name in ("steps", "sine"):
        text("track: {file: track.csv}", "video: {file: v.mp4}", f"{name}/experiment.yaml")(folder)
        (folder / name / "v.mp4").write_bytes(b"the same in both")


def turned_film(folder):
    """Frames that lie, and a photo of the board that stands."""
    text("track: {file: track.csv}", "frames: {folder: frames, times: times.csv}", RUN)(folder)
    (folder / "steps" / "frames").mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / "steps" / "frames" / f"{number}.png"), np.full((48, 64), 90, np.uint8))
    pd.DataFrame({"file": ["0.png", "1.png", "2.png"], "time_s": [0.0, 0.1, 0.2]}).to_csv(
        folder / "steps" / "times.csv", index=False
    )
    cv2.imwrite(str(folder / "photo.png"), np.full((64, 48), 90, np.uint8))
    with (folder / "campaign.yaml").open("a") as file:
        file.write("camera: {board: {kind: checkerboard, inner_corners: [9, 6], square: 12 mm}, photos: photo.png}\n")


def plane_by_another(folder):
    turned_film(folder)
    cv2.imwrite(str(folder / "plane.png"), np.full((72, 96), 90, np.uint8))
    text("photos: photo.png", "photos: photo.png, plane: plane.png")(folder)


def marks_of_the_logger(pressure_kPa):
    return pressure_kPa.where(pressure_kPa.index % 50 != 0, 9999.0)


def track_in_min(folder):
    path = folder / "steps" / "track.csv"
    table = pd.read_csv(path)
    table["time_s"] /= 60.0
    table.to_csv(path, index=False)


def nodes_from_the_tip(folder):
    table = pd.read_csv(folder / "steps" / "track.csv")
    line = {f"{axis}{k:02d}_mm": table[f"tip_{axis}_mm"] * (1 - k / 4) for k in range(5) for axis in "xy"}
    pd.DataFrame({"time_s": table["time_s"], **line}).to_csv(folder / "steps" / "track.csv", index=False)


def hole_in_the_track(folder):
    path = folder / "steps" / "track.csv"
    table = pd.read_csv(path)
    table[(table["time_s"] < 0.2) | (table["time_s"] > 0.3)].to_csv(path, index=False)


def hole_in_the_frames(folder):
    """Pictures that are numbered through, of which some were not copied."""
    text("track: {file: track.csv}", "frames: {folder: frames, rate: 100 Hz}", RUN)(folder)
    (folder / "steps" / "frames").mkdir()
    for number in [*range(20), *range(40, 60)]:
        cv2.imwrite(str(folder / "steps" / "frames" / f"f_{number:03d}.png"), np.full((48, 64), 90, np.uint8))
    with (folder / "campaign.yaml").open("a") as file:
        file.write(f"camera: {{{SCALE}}}\n")


def hole_in_slow_motion(folder):
    """A film of which 20 pictures were dropped, and whose own times a rate replaces."""
    text("track: {file: track.csv}", "video: {file: v.mp4, rate: 240 Hz}", RUN)(folder)
    with av.open(str(folder / "steps" / "v.mp4"), "w") as container:
        stream = container.add_stream("mpeg4", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for number in [*range(20), *range(40, 90), None]:
            frame = number if number is None else av.VideoFrame.from_ndarray(np.full((72, 64), 90, np.uint8), "yuv420p")
            if frame is not None:
                frame.pts = number
            container.mux(stream.encode(frame))
    with (folder / "campaign.yaml").open("a") as file:
        file.write(f"camera: {{{SCALE}}}\n")


def every_log_in_bar(folder):
    for name in ("steps", "sine"):
        table = pd.read_csv(folder / name / "pressure.csv")
        table.assign(pressure_kPa=table["pressure_kPa"] / 100).to_csv(folder / name / "pressure.csv", index=False)


def angle_of_a_full_turn(folder):
    table = pd.read_csv(folder / "steps" / "track.csv")
    bend_deg = 60 * np.sin(2 * np.pi * table["time_s"] / table["time_s"].max())
    pd.DataFrame({"time_s": table["time_s"], "angle_deg": (bend_deg + 20) % 360}).to_csv(folder / "steps" / "track.csv", index=False)


def nodes_in_cm(folder):
    y_mm = {f"y{k:02d}_mm": np.linspace(-3.8 * k, -3.9 * k, 120) for k in range(5)}
    line = {f"x{k:02d}_mm": np.full(120, -0.1 * k) for k in range(5)}
    pd.DataFrame({"time_s": np.arange(120) / 240, **line, **y_mm}).to_csv(folder / "steps" / "track.csv", index=False)


def two_points_swapped(folder):
    table = pd.read_csv(folder / "steps" / "track.csv")
    places = [0, 1, 3, 2, 4, 5, 6]
    line = {f"{axis}{k:02d}_mm": table[f"tip_{axis}_mm"] * place / 6 for k, place in enumerate(places) for axis in "xy"}
    pd.DataFrame({"time_s": table["time_s"], **line}).to_csv(folder / "steps" / "track.csv", index=False)


def points_along(folder, run, count=7, from_mm=0):
    table = pd.read_csv(folder / run / "track.csv")
    line = {f"{axis}{k:02d}_mm": from_mm * (axis == "x") + table[f"tip_{axis}_mm"] * k / 6 for k in range(count) for axis in "xy"}
    pd.DataFrame({"time_s": table["time_s"], **line}).to_csv(folder / run / "track.csv", index=False)


def places_from_a_corner(folder):
    points_along(folder, "steps", from_mm=300)


def last_point_missing(folder):
    points_along(folder, "sine")
    points_along(folder, "steps", count=6)


def points_and_commas(rows):
    return [rows[0].replace(",", ";"), *(row.replace(",", ";").replace(".", ",", 1) for row in rows[1:])]


def standard_errors(sigma_mm):
    """Give every row of a track this standard error."""

    def spoil(folder):
        table = pd.read_csv(folder / "steps" / "track.csv")
        table.assign(sigma_mm=sigma_mm).to_csv(folder / "steps" / "track.csv", index=False)

    return spoil


def part_with_fewer_digits(folder):
    table = pd.read_csv(folder / "sine" / "track.csv")
    table.iloc[20:90].to_csv(folder / "steps" / "track.csv", index=False, float_format="%.3f")


def repeat_of_another(folder):
    text("role: train", "role: train\nrepeat_of: sine", RUN)(folder)
    pressures(lambda p: 50 + 50 * np.sin(np.arange(p.size) / 20))(folder)


def summer_time(rows):
    begins = pd.Timestamp("2026-10-25 02:59:59.8")
    times = [begins + pd.Timedelta(float(row.split(",")[0]) - 3600 * (k > 200), "s") for k, row in enumerate(rows[1:])]
    return [rows[0], *(f"{time.isoformat(' ')},{100 + k % 9}" for k, time in enumerate(times))]


def psi_in_the_head(folder):
    log(lambda rows: ["time_s,p [psi]", *rows[1:]])(folder)
    text("{file: pressure.csv}", "{file: pressure.csv, pressure: 'p [psi]', unit: kPa}", RUN)(folder)


def mirrored_track(folder):
    table = pd.read_csv(folder / "steps" / "track.csv")
    table.assign(tip_x_mm=-table["tip_x_mm"]).to_csv(folder / "steps" / "track.csv", index=False)


def log_by_the_time_of_the_day(folder):
    table = pd.read_csv(folder / "steps" / "pressure.csv")
    date = pd.Timestamp("2026-03-01 10:00") + pd.to_timedelta(table["time_s"], unit="s")
    table.assign(time_s=date).to_csv(folder / "steps" / "pressure.csv", index=False)


def column_without_numbers(folder):
    table = pd.read_csv(folder / "steps" / "track.csv")
    table.assign(tip_y_mm=np.nan).to_csv(folder / "steps" / "track.csv", index=False)


def link_to_itself(folder):
    (folder / "steps" / "track.csv").unlink()
    (folder / "steps" / "track.csv").symlink_to("track.csv")


def thousands(rows):
    return [
        rows[0],
        *(
            f'{row.split(",")[0]},"{number}"' if number < 100 else f'{row.split(",")[0]},"1,{number:03d}"'
            for number, row in enumerate(rows[1:])
        ),
    ]


RUN = "steps/experiment.yaml"
SCALE = "scale: {points: [[2, 8], [2, 40]], distance: 155 mm}"
IN_FILES = [
    ("length without unit", text("length: 155 mm", "length: 155"), 2, "actuator.length: 155 has no unit"),
    ("length in cm as mm", text("length: 155 mm", "length: 15.5 mm"), 0, "is the length in cm"),
    ("decimal comma", text("outer_radius: 4 mm", "outer_radius: '4,0 mm'"), 2, "decimal comma; write '4.0 mm'"),
    ("radii swapped", text("inner_radius: 3 mm", "inner_radius: 5 mm"), 2, "smaller than actuator.outer_radius"),
    ("density of a star", text("965 kg/m^3", "965 g/cm^3"), 0, "more than lead's; is the unit right?"),
    ("density without its power", text("965 kg/m^3", "965 kg/m"), 2, "not a unit of the right kind"),
    ("side in another language", text("bends: left", "bends: links"), 2, "must be 'left' or 'right'"),
    ("key misspelt", text("inner_radius", "inner_radus"), 2, "did you mean 'inner_radius'?"),
    ("tab", text("\nname: tube-A", "\n\tname: tube-A"), 2, "write blanks in place of the tab"),
    ("colon forgotten", text("name: tube-A", "name tube-A"), 2, "campaign.yaml:"),
    ("bracket forgotten", text("bends: left}", "bends: left"), 2, "campaign.yaml:"),
    ("umlaut of Windows", content("campaign.yaml", "name: Röhre\n".encode("latin-1")), 2, "save the file as UTF-8"),
    ("campaign.yml", renamed("campaign.yaml", "campaign.yml"), 2, "there is campaign.yml: call it campaign.yaml"),
    ("campaign.yaml.txt", renamed("campaign.yaml", "campaign.yaml.txt"), 2, "call it campaign.yaml"),
    ("role misspelt", text("role: train", "role: training", RUN), 2, "must be 'train', 'validate', 'test' or 'ignore'"),
    ("no validation", text("role: validate", "role: train", "sine/experiment.yaml"), 0, "set one aside"),
    ("two of one name", text("name: steps", "name: sine", RUN), 2, "steps/experiment.yaml:2: name: 'sine' names 2 experiments"),
    ("track renamed", renamed("steps/track.csv", "steps/Track.CSV"), 2, "(there is Track.CSV"),
    ("path of Windows", in_a_folder_of_windows, 2, "no file 'data\\track.csv'"),
    ("no ending", text("file: track.csv", "file: track", RUN), 2, "(there is track.csv)"),
    ("length in m as mm", text("length: 155 mm", "length: 0.155 mm"), 0, "is the length in m?"),
    ("track in a lower folder", text("file: track.csv", "file: data/track.csv", RUN), 2, "no file 'data/track.csv'"),
    ("film turned", turned_film, 2, "photos have 48 x 64; one of them is turned: turn the video, or photograph the board"),
    ("film empty", film_of_nothing, 2, "is empty (0 bytes)"),
    ("rate without unit", text("track: {file: track.csv}", "video: {file: v.mp4, rate: 240}", RUN), 2, "write for example '240 Hz'"),
    ("clock misspelt", text("common_clock", "comon_clock", RUN), 2, "sync.method"),
    ("offset without unit", text("{method: common_clock}", "{method: offset, value: 12}", RUN), 2, "write for example '12 ms'"),
    ("payload misspelt", text("role: train", "role: train\nconditions: {paylaod: 10 g}", RUN), 2, "did you mean 'payload'?"),
    ("pressure in Pa", pressures(lambda p: 1000 * p), 0, "is it in Pa?"),
    ("pressure in bar", pressures(lambda p: p / 100), 0, "is it in bar or MPa?"),
    ("pressure absolute", pressures(lambda p: p + 101.3), 0, "write pressure.reference: absolute"),
    ("columns renamed", log(lambda rows: ["t,P [bar]", *rows[1:]]), 2, """time: t, pressure: "P [bar]"}'"""),
    ("time runs back", log(lambda rows: [*rows[:400], *rows[100:]]), 2, "split the log there if another recording begins"),
    ("newest row first", log(lambda rows: [rows[0], *rows[:0:-1]]), 2, "turn the order of the rows round"),
    ("log empty", content("steps/pressure.csv", b""), 2, "steps/pressure.csv"),
    ("log a workbook", content("steps/pressure.csv", b"PK\x03\x04" + bytes(200)), 2, "save the table as CSV"),
    ("log packed", content("steps/pressure.csv", b"\x1f\x8b\x08" + bytes(200)), 2, "is no text, whatever its name says; unpack it"),
    ("log of an instrument", content("steps/pressure.csv", bytes(range(256)) * 9), 2, "is no text, whatever its name says"),
    ("lamp without a film", text("{method: common_clock}", "{method: led}", RUN), 2, "looks for a lamp in the film, and this run has"),
    ("no column of a trigger", text("{method: common_clock}", "{method: trigger}", RUN), 2, "or write sync.method: motion"),
    ("angle from 0 to 360", angle_of_a_full_turn, 0, "jumps by more than half a turn from row to row, 2 times"),
    ("log copied", copied("pressure.csv"), 0, "the same log, row by row, as that of 'sine'; was it copied by mistake?"),
    ("track copied", copied("track.csv"), 0, "the same track, row by row, as that of 'sine'; was it copied by mistake?"),
    ("blank of a web page", text("name: tube-A", "name: tube-A\n \u00a0note: hangs"), 2, "holds a blank that is none to YAML"),
    ("such a blank before colons", text("length: 155", "length\u00a0: 155"), 2, "'length' has a blank beside it that is none"),
    ("inches by their sign", text("length: 155 mm", "length: 6.1\""), 2, "unknown unit '\"'; write 'in'"),
    ("list of one file", text("pressure: {file: pressure.csv", "pressure: {file: [pressure.csv]", RUN), 2, "such as 'pressure.csv'"),
    ("folder as a log", a_folder_called("steps/pressure.csv"), 2, "is a folder; name the file, with its folder"),
    ("decimal commas between commas", log(lambda rows: [r.replace(".", ",") for r in rows]), 2, "with semicolons between"),
    ("length times ten", text("length: 155 mm", "length: 1550 mm"), 0, "sine/experiment.yaml:4: track: the tip never"),
    ("track cut short", few_rows, 0, "there are 5 pictures of the run"),
    ("yes as a name", text("name: steps", "name: yes", RUN), 2, "put quotes around the text, as in 'yes'"),
    ("marks of a logger", pressures(marks_of_the_logger), 0, "reaches 9999 kPa, in 10 of 500 rows only"),
    ("track in min", track_in_min, 0, "does the time of the pictures count in min?"),
    ("nodes from the tip on", nodes_from_the_tip, 0, "are the points written from tip to clamp?"),
    ("column without numbers", column_without_numbers, 2, "column 'tip_y_mm' holds no number in any row"),
    ("link that leads nowhere", link_to_itself, 2, "is a link that leads to no file"),
    ("separators of thousands", log(thousands), 2, "export it without separators of thousands"),
    ("rows missing", hole_in_the_track, 0, "pictures are missing from 0.20 to 0.30 s"),
    ("frames missing", hole_in_the_frames, 0, "pictures are missing from 0.19 to 0.40 s"),
    ("frames missing in slow motion", hole_in_slow_motion, 0, "from 0.63 to 1.33 s of the file's own clock, and video.rate counts"),
    ("every log in bar", every_log_in_bar, 0, "by less pressure than its own weight takes"),
    ("bore in another place", text("inner_radius: 3 mm", "inner_radius: 0.3 mm"), 0, "is 0.56 % of its section"),
    ("pressure misspelt", text("pressure:", "presure:", RUN), 2, "unknown key 'presure'; did you mean 'pressure'?"),
    ("track misspelt", text("track:", "trak:", RUN), 2, "unknown key 'trak'; did you mean 'track'?"),
    ("actuator misspelt", text("actuator:", "actuater:"), 2, "unknown key 'actuater'; did you mean 'actuator'?"),
    ("mass in kg for g", text("density: 965 kg/m^3", "mass: 7.5 kg"), 0, "actuator.mass: the tube would weigh 7.5e+03 g"),
    ("mass in mg for g", text("density: 965 kg/m^3", "mass: 7.5 mg"), 0, "actuator.mass: the tube would weigh 0.0075 g"),
    ("angle alone", text("name: tube-A", "name: tube-A\nrig: {gravity: 30}"), 2, "is written {angle: 30 deg}"),
    ("held without unit", text("role: train", "role: train\nstart: {held_until: 2}", RUN), 2, "write for example '2 s'"),
    ("track in cm", nodes_in_cm, 0, "is the track in cm?"),
    ("track mirrored", mirrored_track, 0, "is that right, is the track mirrored, or does it run backwards?"),
    ("offset in s for ms", text("{method: common_clock}", "{method: offset, value: 12 s}", RUN), 0, "and never meet"),
    ("times of the day", log_by_the_time_of_the_day, 0, "the log has the time of the day and the track has not"),
    ("kPa of a column in psi", psi_in_the_head, 0, "'p [psi]' is in psi by its own head, and in kPa by pressure.unit"),
    ("two columns of one name", log(lambda r: [f"{r[0]},pressure_kPa", *(f"{x},0" for x in r[1:])]), 0, "is the name of two columns"),
    ("standard errors in um", standard_errors(50.0), 0, "sigma_mm, are 50 mm, and the tube 155 mm long; are they in um?"),
    ("standard errors in m", standard_errors(5e-5), 0, "and its rows scatter by 0.065 mm; are they in m?"),
    ("density of feet and pounds", text("965 kg/m^3", "965 lb/ft^3"), 0, "15457.8 kg/m^3 is more than lead's"),
    ("payload in kg for g", text("role: train", "role: train\nconditions: {payload: 10 kg}", RUN), 0, "holds this tube straight"),
    ("end of summer time", log(summer_time), 2, "goes from summer to winter time there: add 3600 s (an hour)"),
    ("two points swapped", two_points_swapped, 0, "goes back on itself at point 02 and 03; are points of it swapped?"),
    ("places from a corner", places_from_a_corner, 0, "its line begins at x = 300, y = 0 mm, and the clamp is where both"),
    ("points and commas", log(points_and_commas), 2, "other columns have decimal points"),
    ("last point missing", last_point_missing, 0, "its line has 6 points over 121.4 mm, that of 'sine' 7 over"),
    ("part of a run with fewer digits", part_with_fewer_digits, 0, "is the same track as that of 'sine', or a part of it"),
    ("repeat of another run", repeat_of_another, 0, "repeat_of: its pressure is that of 'sine' to 0 % only"),
    ("plane by another camera", plane_by_another, 2, "plane.png has 96 x 72 px, and photo.png 48 x 64; photograph the board in"),
    ("run among the results", renamed("steps", "rfea"), 2, "is the folder of the results, and the run in it is not read"),
    ("film copied", copied_film, 2, "the same film, byte by byte, as that of 'sine'; was it copied by mistake?"),
]  # fmt: skip
IN_COMMANDS = [
    (("check", "CAMPAIGN/steps/track.csv"), "is a file; give the campaign folder"),
    (("fit", "CAMPAIGN-typo"), "no such folder"),
    (("check", "CAMPAIGN/.."), "give the folder tube-A in it"),
    (("fit", "CAMPAIGN", "--add", "Maxwell"), "did you mean 'maxwell'?"),
    (("fit", "CAMPAIGN", "--add", "maxwell", "coulomb"), "as in --add maxwell --add coulomb"),
    (("fit", "CAMPAIGN", "--segments", "many"), "is no whole number, nor auto"),
    (("fit", "CAMPAIGN", "--add", "coulomb@40"), "must be a whole number from 1 to 16"),
    (("fit", "CAMPAIGN", "--fix", "stiffness=3N*m/rad"), "the base model's are k_ref"),
    (("fit", "CAMPAIGN", "--prior", "payload.m=2g±0.1g"), "is no parameter of this model, which is fitted without payload"),
    (("simulate", "CAMPAIGN-new", "--hidden", "maxwel.k1=0.1"), "did you mean 'maxwell.k1'?"),
    (("fit", "CAMPAIGN", "--start", "r_hyd=3.6kg"), "--start r_hyd=3.6kg: 'kg' is not a unit of the right kind"),
    (("fit", "CAMPAIGN", "--effect-file", "CAMPAIGN/steps/track.csv"), "not a Python file"),
    (("improve", "CAMPAIGN", "--effect-file", "CAMPAIGN/steps/track.csv"), "not a Python file"),
    (("improve", "CAMPAIGN", "--budget", "5"), "write for example '5min'"),
    (("diagnose", "CAMPAIGN", "bsae"), "no model 'bsae'"),
    (("sync", "CAMPAIGN", "-e", "stepps"), "stepps"),
    (("calibrate", "CAMPAIGN", "--out", "CAMPAIGN/campaign.yaml"), "is a file; the results need a folder"),
    (("report", "CAMPAIGN", "--out", "CAMPAIGN/campaign.yaml"), "is a file; the results need a folder"),
    (("simulate", "CAMPAIGN"), "already there and not empty"),
    (("simulate", "CAMPAIGN-new", "--hidden", "maxwell.k1=0,1"), "decimal comma"),
    (("simulate", "CAMPAIGN-new", "--rate", "60"), "write for example"),
    (("simulate", "CAMPAIGN-new", "--pressure", "CAMPAIGN-new.csv"), "not found"),
    (("simulate", "CAMPAIGN-new", "--pressure", "1.5"), "'1.5' has no unit; write for example '1.5bar'"),
    (("simulate", "CAMPAIGN-new", "--pressure", "1.5baar"), "unknown unit 'baar'; did you mean 'bar'?"),
    (("simulate", "CAMPAIGN-new", "--like", "CAMPAIGN", "--rate", "60Hz"), "--rate has no effect with --like"),
    (("simulate", "CAMPAIGN-new", "--like", "CAMPAIGN", "--scene", "dark"), "--scene has no effect with --like"),
    (("report", "CAMPAIGN", "--group", "--notebook"), "--notebook has no effect with --group"),
    (("report", "CAMPAIGN", "--group", "--compare", "CAMPAIGN"), "--compare has no effect with --group"),
    (("export", "CAMPAIGN", "CAMPAIGN-tube", "--step", "0s"), "--step must be longer than zero"),
    (("export", "CAMPAIGN", "CAMPAIGN-tube", "--step", "-1ms"), "--step must be longer than zero"),
    (("export", "CAMPAIGN", "CAMPAIGN-tube", "--force"), "No such option '--force'."),
    (("export", "CAMPAIGN", "CAMPAIGN-tube", "--crate", "--step", "1ms"), "--step has no effect with --crate"),
    (
        ("export", "CAMPAIGN", "CAMPAIGN-tube", "--poses", "--iterations", "4"),
        "--iterations has no effect with --poses",
    ),
    (("export", "CAMPAIGN", "base", "CAMPAIGN-tube", "--poses"), "tracks have no MODEL"),
    (("compare", "CAMPAIGN", "bsae"), "no model 'bsae'"),
    (("open", "CAMPAIGN-typo", "--no-browser"), "no such folder"),
    (("figures", "CAMPAIGN", "--format", "pfd"), "'pfd' is unknown; choose of pdf, svg, png"),
    (("report", "CAMPAIGN", "--compare", "CAMPAIGN-old"), "no such folder; give a campaign, or an earlier folder"),
]
