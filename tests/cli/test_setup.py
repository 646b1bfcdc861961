"""Commands that need no data, and what every command has in common."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest
from campaign.campaigns import write_campaign

from rfea_vision.cli.root import _HOME_OF
from rfea_vision.cli.root import rfea as root_command

from .console import rfea

COMMANDS = [
    "init",
    "check",
    "schema",
    "doctor",
    "board",
    "calibrate",
    "track",
    "sync",
    "fit",
    "compare",
    "diagnose",
    "improve",
    "power",
    "propose",
    "effects",
    "report",
    "run",
    "batch",
    "table",
    "open",
    "figures",
    "reproduce",
    "export",
    "simulate",
    "demo",
]


def test_the_commands_are_those_of_the_documents():
    assert list(_HOME_OF) == COMMANDS


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_json_and_debug(name):
    answer = rfea(name, "--help")
    assert answer.code == 0 and "--json" in answer.out and "--debug" in answer.out
    command = root_command.get_command(click.Context(root_command), name)
    assert command is not None and command.get_short_help_str(70).endswith(".")


@pytest.mark.parametrize("name", COMMANDS)
def test_help_breaks_and_cuts_off_no_word_at_a_narrow_terminal(name):
    command = root_command.get_command(click.Context(root_command), name)
    others = command.commands.values() if isinstance(command, click.Group) else ()

    def words(item, columns):
        settings = {**root_command.context_settings, "terminal_width": columns, "max_content_width": columns}
        context = click.Context(item, info_name=f"rfea {name}", **settings)
        return set(re.split(r"[\s-]+", item.get_help(context)))

    for item in (command, *others):
        assert words(item, 58) <= words(item, 500)


@pytest.mark.parametrize(
    ("done", "heavy"),
    [
        ("from rfea_vision.cli.root import run; run(['-h'])", {"cv2", "numba", "av", "xarray", "distributed"}),
        ("from rfea_vision.workbench.routes import of_report; of_report('report.js')", {"cv2", "numba", "sympy", "xarray"}),
        ("import rfea_vision.workbench.answers, rfea_vision.workbench.opened", {"cv2", "numba", "sympy", "distributed"}),
    ],
    ids=["help", "scripts of the workbench", "first page of the workbench"],
)
def test_what_comes_first_is_quick_to_load(done, heavy):
    # the libraries that take seconds to import are not needed to read the help, or to see a campaign
    code = f"import sys; {done}; print(sorted({heavy} & set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip().endswith("[]")


def test_a_campaign_with_a_board_is_quick_to_read(tmp_path):
    folder = write_campaign(tmp_path / "tube")
    with (folder / "campaign.yaml").open("a") as file:
        file.write(
            "camera: {board: {kind: checkerboard, inner_corners: [9, 6], square: 12 mm}, photos: 'photo_*.png'}\n"
        )
    (folder / "photo_1.png").write_bytes(b"not looked at yet")
    code = (
        "import sys; from rfea_vision.campaign import load_campaign; campaign = load_campaign(sys.argv[1]); "
        "print(campaign.camera.board, {'cv2', 'numba', 'pandas', 'xarray', 'pint', 'sympy'} & set(sys.modules))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code, folder], capture_output=True, text=True, check=True, timeout=120
    )
    assert "inner_corners=(9, 6)" in result.stdout and result.stdout.strip().endswith("set()")


def test_what_was_not_asked_for_is_written_without_loading_the_laws():
    # a command that has nothing to do writes the commands that lead to it
    code = (
        "import sys; from rfea_vision.options import FitOptions; from rfea_vision.options.asking import written; "
        "print(repr(written('fit', FitOptions())), {'pint', 'sympy'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.strip() == "'' set()"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["trak"], "Did you mean 'track'?"),
        (["fit"], "Missing argument 'CAMPAIGN'"),
        (["fit", "x", "--segmnts", "3"], "'--segments'"),
        (["improve", "x", "--add", "maxwell"], "It is an option of 'rfea fit'"),
        (
            ["compare", "x", "--model", "base"],
            "Give MODEL by its place, without a name: rfea compare CAMPAIGN [MODEL]...",
        ),
        (["fit", "x", "--segments", "0"], "must be 1 or more"),
        (["fit", "x", "--observe", "toe"], "'toe' is not one of"),
        (["improve", "x", "--budget", "5"], "'5' has no unit; write for example '5min'"),
        (["improve", "x", "--budget", "5 kg"], "not a unit of the right kind"),
        (["schema", "model"], "there are campaign.yaml"),
        (["effects", "show", "maxwel"], "did you mean 'maxwell'?"),
        (["effects", "show", "mine.py"], "'rfea effects show ID --effect-file mine.py'"),
        (["run", "papre", "x"], "there are default, paper"),
        (["simulate", "x", "--hidden", "maxwell.k2=1"], "maxwell.k1"),
        (["simulate", "x", "--roles", "trian"], "use train, validate, test or ignore"),
        (["board", "checkerbord-9x6-12mm"], "did you mean 'checkerboard-9x6-12mm'?"),
        (["check", "nowhere"], "no such folder"),
        (["batch", "x", "--recipe", "papre"], "there are default, paper"),
    ],
)
def test_wrong_usage_is_one_sentence_and_two(arguments, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    answer = rfea(*arguments)
    assert answer.code == 2
    assert says in answer.err + answer.out
    assert "Traceback" not in answer.err
    assert list(tmp_path.iterdir()) == []


def test_errors_are_json_where_json_is_asked_for(tmp_path):
    answer = rfea("track", tmp_path, "--json")
    assert answer.code == 2
    assert answer.json["exit_code"] == 2 and "neither campaign.yaml" in answer.json["error"]
    assert rfea("track", "--json").json["status"] == "error"


def test_an_unforeseen_fault_is_one_line_and_says_how_to_see_more(tmp_path, monkeypatch):
    def broken(*arguments, **options):
        raise ZeroDivisionError("division by zero")

    campaign = write_campaign(tmp_path / "c")
    monkeypatch.setattr("rfea_vision.campaign.load_campaign", broken)
    answer = rfea("track", campaign)
    assert answer.code == 1
    assert answer.err.count("\n") == 1 and "--debug" in answer.err and "ZeroDivisionError" in answer.err
    assert "Traceback" in rfea("track", campaign, "--debug").err


def test_init_writes_a_campaign_that_only_lacks_its_files(tmp_path):
    answer = rfea("init", tmp_path / "new")
    assert answer.code == 0
    checked = rfea("check", tmp_path / "new", "--json")
    assert checked.code == 2
    keys = {problem["key"] for problem in checked.json["problems"]}
    assert keys == {"camera.photos", "camera.plane", "video.file", "pressure.file"}
    again = rfea("init", tmp_path / "new")
    assert again.code == 2 and "left as it is" in again.err


def test_init_copes_with_any_folder_name(tmp_path):
    folder = tmp_path / "tube: 'A' #3"
    assert rfea("init", folder).code == 0
    assert "not valid YAML" not in rfea("check", folder).out


def test_check_says_what_is_right_and_what_is_wrong(tmp_path):
    campaign = write_campaign(tmp_path / "c")
    good = rfea("check", campaign, "--json")
    assert good.code == 0 and good.json["ok"] and good.json["problems"] == []
    assert good.json["experiments"] == {"sine": "validate", "steps": "train"}
    (campaign / "steps" / "pressure.csv").write_text("time_s,pressure_kPa\n0,1\n0,2\n")
    bad = rfea("check", campaign)
    assert bad.code == 2 and "repeats the row before" in bad.out and "1 error, 0 warnings" in bad.out
    assert not (campaign / "rfea").exists()


def test_schemas_describe_the_files(tmp_path):
    schemas = rfea("schema").json
    assert {"campaign.yaml", "experiment.yaml", "model.json", "diagnosis.json", "ladder.json"} <= set(schemas)
    one = rfea("schema", "campaign.yaml").json
    assert one == schemas["campaign.yaml"] and "actuator" in one["properties"]
    assert one["additionalProperties"] is False


def test_the_doctor_finds_this_machine_well():
    answer = rfea("doctor", "--json")
    assert answer.code == 0 and answer.json["ok"]
    assert {"python", "numpy", "av", "mujoco"} <= {item["what"] for item in answer.json["findings"]}
    extras = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    named = " ".join(item["purpose"] for item in answer.json["findings"])
    assert [extra for extra in extras if extra != "dev" and f"[{extra}]" not in named] == []


def test_boards_are_listed_and_printed(tmp_path):
    names = rfea("board", "--json").json
    assert "checkerboard-9x6-12mm" in names
    answer = rfea("board", "checkerboard-9x6-12mm", "-o", tmp_path / "board.pdf")
    assert answer.code == 0 and (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")


def test_effects_are_listed_shown_and_begun(tmp_path):
    assert {"maxwell", "coulomb", "time_offset"} <= {item["id"] for item in rfea("effects", "--json").json}
    shown = rfea("effects", "show", "maxwell")
    assert "relaxation time" in shown.out and "split by" in shown.out
    own = tmp_path / "stiffer.py"
    assert rfea("effects", "new", own).code == 0
    mine = rfea("effects", "show", "stiffer", "--effect-file", own, "--json").json
    assert mine["parameters"]["c"]["absent"] == 0.0
    assert rfea("effects", "new", own).code == 2
    assert rfea("effects", "new", tmp_path / "stiffer.txt").code == 2


def test_recipes_of_the_package_are_right():
    from rfea_vision.data import list_recipes
    from rfea_vision.stages.recipes import load_recipe

    assert set(list_recipes()) >= {"default", "paper"}
    steps = load_recipe("paper").calls()
    assert [name for name, _ in steps] == ["fit", "fit", "compare", "report"]
    assert [told[0].joints for name, told in steps if name == "fit"] == ["start", "start"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("steps: [fitt]", "unknown step 'fitt'; did you mean 'fit'?"),
        ("steps: []", "steps is empty"),
        ("steps: [{fit: {segmets: 3}}]", "did you mean 'segments'?"),
        ("steps:\n  - track\n  - improve: {budget: 5}", ":3: improve: budget: 5 has no unit"),
        ("stepps: [fit]", "did you mean 'steps'?"),
        ("steps: [fit", "not valid YAML"),
    ],
)
def test_a_wrong_recipe_is_named(tmp_path, text, says):
    campaign = write_campaign(tmp_path / "c")
    recipe = tmp_path / "mine.yaml"
    recipe.write_text(text)
    answer = rfea("run", recipe, campaign)
    assert answer.code == 2 and says in answer.err and str(recipe) in answer.err


def test_json_is_all_there_is_on_stdout(tmp_path):
    campaign = write_campaign(tmp_path / "c")
    answer = rfea("track", campaign, "--json")
    assert answer.code == 0
    tracks = json.loads(answer.out)["tracks"]
    assert [item["experiment"] for item in tracks] == ["sine", "steps"]
    assert all(item["status"] == "done" and item["frames"] == item["valid"] == 120 for item in tracks)
    assert "unchanged" in rfea("track", campaign, "--again").err
    assert all(item["status"] == "unchanged" for item in rfea("track", campaign, "--json").json["tracks"])
    forced = rfea("track", campaign, "--force", "-e", "steps", "--json").json["tracks"]
    assert [(item["experiment"], item["status"]) for item in forced] == [("steps", "done")]
