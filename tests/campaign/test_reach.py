"""What a campaign of a stranger may make this machine read: what lies below its own folder."""

from __future__ import annotations

import sqlite3

import pytest

from rfea_vision.campaign import read_campaign
from rfea_vision.campaign.yaml_file import read_yaml
from rfea_vision.cli.root import run
from rfea_vision.errors import InputError
from rfea_vision.readers.database import read_query
from rfea_vision.units import parse_quantity

from .campaigns import write_campaign


@pytest.fixture
def stranger(tmp_path):
    """A campaign, beside a log that is none of its business."""
    folder = write_campaign(tmp_path / "campaign")
    (tmp_path / "secret.csv").write_text((folder / "steps" / "pressure.csv").read_text())
    return folder


def _pressure(folder, text):
    path = folder / "steps" / "experiment.yaml"
    path.write_text(path.read_text().replace("pressure: {file: pressure.csv}", f"pressure: {text}"))


def _absolute(folder):
    _pressure(folder, f"{{file: {folder.parent / 'secret.csv'}}}")


def _above(folder):
    _pressure(folder, "{file: ../../secret.csv}")


def _home(folder):
    _pressure(folder, "{file: ~/secret.csv}")


def _link(folder):
    (folder / "steps" / "pressure.csv").unlink()
    (folder / "steps" / "pressure.csv").symlink_to(folder.parent / "secret.csv")


def _linked_experiment(folder):
    (folder / "steps").rename(folder.parent / "elsewhere")
    (folder / "steps").symlink_to(folder.parent / "elsewhere")


def _linked_results(folder):
    (folder.parent / "mine").mkdir()
    (folder / "rfea").symlink_to(folder.parent / "mine")


def _link_in_results(folder):
    (folder.parent / "mine").mkdir()
    (folder / "rfea").mkdir()
    (folder / "rfea" / "models").symlink_to(folder.parent / "mine")


def _database_outside(folder):
    _pressure(folder, "{url: 'sqlite:///../../log.db', query: 'SELECT t, p FROM log'}")


def _database_as_file_url(folder):
    _pressure(folder, f"{{url: 'sqlite:///file:{folder.parent}/log.db?uri=true', query: 'SELECT t, p FROM log'}}")


def _server(folder):
    _pressure(folder, "{url: 'postgresql://me:secret@host/db', query: 'SELECT t, p FROM log'}")


def _environment(folder):
    _pressure(folder, "{url: 'sqlite:///${HOME}', query: 'SELECT t, p FROM log'}")


def _photos_everywhere(folder):
    file = folder / "campaign.yaml"
    board = "board: {kind: checkerboard, inner_corners: [9, 6], square: 12 mm}"
    file.write_text(file.read_text() + f"camera: {{{board}, photos: '/**/*.png'}}\n")


OUTSIDE = [
    _absolute, _above, _link, _linked_experiment, _linked_results, _link_in_results, _database_outside,
    _database_as_file_url, _server, _environment, _photos_everywhere,
]  # fmt: skip


@pytest.mark.parametrize("spoil", OUTSIDE, ids=lambda item: item.__name__[1:])
def test_what_lies_outside_is_not_read_unasked(stranger, spoil):
    spoil(stranger)
    reading = read_campaign(stranger)
    said = [str(problem) for problem in reading.problems if problem.severity == "error"]
    assert said and all("--trust" in text for text in said[:1]), said
    assert "secret@" not in said[0]


@pytest.mark.parametrize("spoil", [_absolute, _above, _link, _linked_experiment, _linked_results, _link_in_results])
def test_trust_lets_it(stranger, spoil):
    spoil(stranger)
    assert [problem for problem in read_campaign(stranger, trust=True).problems if problem.severity == "error"] == []


def test_a_home_folder_is_none_of_its_business(stranger):
    _home(stranger)
    assert any("~/secret.csv" in str(problem) for problem in read_campaign(stranger).problems)


def test_links_and_dots_that_stay_inside_are_fine(stranger):
    (stranger / "logs").mkdir()
    (stranger / "steps" / "pressure.csv").rename(stranger / "logs" / "one.csv")
    (stranger / "steps" / "pressure.csv").symlink_to("../logs/one.csv")
    file = stranger / "sine" / "experiment.yaml"
    file.write_text(file.read_text().replace("file: pressure.csv", "file: ../logs/one.csv"))
    assert [problem for problem in read_campaign(stranger).problems if problem.severity == "error"] == []


def test_the_command_line_refuses_and_lets(stranger, capsys):
    _absolute(stranger)
    assert run(["check", str(stranger)]) == 2
    assert "--trust" in capsys.readouterr().out
    assert run(["check", str(stranger), "--trust"]) == 0


@pytest.mark.parametrize("name", ["a\\0b", "x" * 5000, "~nobody-of-that-name/x.csv"])
def test_names_that_no_file_can_have_are_not_found(stranger, name):
    _pressure(stranger, f'{{file: "{name}"}}')
    assert any(problem.key.startswith("pressure") for problem in read_campaign(stranger).problems)


ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x, x FROM c"


@pytest.mark.parametrize(
    "query", ["ATTACH '{out}' AS other", "PRAGMA writable_schema = 1", "CREATE TABLE x (a)", ENDLESS, "SELECT zeroblob(1e9)",
              "VACUUM INTO '{out}'", "SELECT load_extension('x')", "SELECT 1; SELECT 2"],
)  # fmt: skip
def test_a_query_selects_and_ends(tmp_path, query, monkeypatch):
    monkeypatch.setattr("rfea_vision.readers.database.LONGEST_QUERY_S", 0.5)
    monkeypatch.setattr("rfea_vision.readers.database.MOST_VALUES", 100_000_000)
    with sqlite3.connect(tmp_path / "log.db") as database:
        database.execute("CREATE TABLE log (t, p)")
    says = "does not end within 0.5.* s of processor time on this machine" if query == ENDLESS else "sqlite:///log.db"
    with pytest.raises(InputError, match=rf"pressure.query: .*{says}"):
        read_query("sqlite:///log.db", query.format(out=tmp_path / "made.db"), tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.db"]


_BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 10)
)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (_BOMB, "aliases stand for more than"),
        ("a: &a [*a]\n", "aliases stand for more than"),
        ("a: " + "[" * 100_000, "nested more than"),
        ("a: " + "{b: " * 5000, "nested more than"),
        ("".join(f"{' ' * i}k:\n" for i in range(200)), "nested more than"),
        ("a: " + "1" * 100_000, "not valid YAML"),
        ("a: " + "x" * 2_000_000, "is larger than 1 MB"),
    ],
)
def test_settings_that_would_stop_the_machine_are_refused(tmp_path, text, says):
    path = tmp_path / "campaign.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        read_yaml(path)


def test_aliases_within_reason_are_read(tmp_path):
    path = tmp_path / "campaign.yaml"
    path.write_text("a: &a {b: [1, 2]}\nc: *a\nd: {<<: *a, e: 1}\n")
    assert read_yaml(path).content["d"] == {"b": [1, 2], "e": 1}


@pytest.mark.parametrize("unit", ["mm**9**9**9", "(mm**9)**9", "mm" + "*mm" * 1000, "mm**99", "9**9**9**9 mm"])
def test_units_are_not_worked_out(unit):
    with pytest.raises(ValueError, match="unknown unit"):
        parse_quantity(f"1 {unit}", "m", example="4 mm")


@pytest.mark.parametrize("unit", ["kg/m^3", "kg / m ** 3", "g/cm³", "N m"])
def test_units_as_people_write_them(unit):
    assert parse_quantity(f"2 {unit}", "N m" if unit == "N m" else "kg/m^3", example="4 mm") > 0
