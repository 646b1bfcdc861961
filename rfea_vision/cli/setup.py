"""Commands before any data: init, check, schema, doctor, board."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rfea_vision.cli.console import ConsoleListener, print_json, print_table, say, say_next
from rfea_vision.cli.options import PATH, output_options, trust_option, trusted
from rfea_vision.errors import InputError
from rfea_vision.files import is_file
from rfea_vision.units import counted

if TYPE_CHECKING:
    from rfea_vision.campaign.problems import FileProblem


@click.command("init")
@click.argument("folder", metavar="DIR", type=PATH)
@click.option("--from", "first", metavar="FILES...", type=PATH, help="Files or folders to look at.")
@click.argument("files", nargs=-1, metavar="", type=PATH)
@output_options
def init_command(folder: Path, first: Path | None, files: tuple[Path, ...], as_json: bool) -> None:
    """A campaign to fill in, or one guessed from files.

    'rfea init DIR --from FILES...' looks at films, photos of the board, logs and tracks, brings together what belongs
    together, and writes the campaign. Every guess is marked in it with '# guessed:'; what nobody can guess, with '# needed:'.
    """
    if files and first is None:
        raise click.UsageError(f"Got unexpected '{files[0]}': write 'rfea init {folder} --from {files[0]}'.")
    if first is not None:
        _init_from(folder, (first, *files), as_json)
        return
    from rfea_vision.campaign.template import write_campaign_template

    written = write_campaign_template(folder)
    if as_json:
        print_json({"folder": str(folder), "files": [str(path) for path in written]})
        return
    for path in written:
        click.echo(str(path))
    say("fill these in and put your files beside them")
    say_next("rfea check", folder, why="what is still wrong, all at once")


def _init_from(folder: Path, files: tuple[Path, ...], as_json: bool) -> None:
    from rfea_vision.campaign.from_files import write_campaign_from

    written = write_campaign_from(folder, files)
    if as_json:
        shown = {"guessed": list(written.guesses), "left_out": list(written.left_out)}
        print_json({"folder": str(folder), "files": [str(path) for path in written.files], **shown})
        return
    for path in written.files:
        click.echo(str(path))
    for sentence in guessed_once(written.guesses, {path.parent.name for path in written.files}):
        say(f"guessed: {sentence}")
    for sentence in written.left_out:
        say(f"left out: {sentence}")
    say("look at the lines marked '# guessed:' and '# needed:'; those marked '# if needed:' wait for their '#' to be taken away")
    say_next("rfea check", folder, why="what is still wrong, all at once")


def guessed_once(guesses: Sequence[str], runs: Collection[str]) -> list[str]:
    """Each guess that runs have alike once, with the other runs that have it."""
    alike = dict[str, list[str]]()
    for sentence in guesses:
        run = max((name for name in runs if sentence.startswith(f"{name}.")), key=len, default="")
        alike.setdefault(sentence.removeprefix(run), []).append(run)
    return [f"{first}{said}" + (f" (likewise {', '.join(others)})" if others else "") for said, (first, *others) in alike.items()]


def told_once(problems: Sequence[FileProblem]) -> list[tuple[FileProblem, list[str]]]:
    """Each warning that runs have alike, but for its figures, once, with the other runs that have it; errors each for itself."""
    found: dict[tuple[str, ...], tuple[FileProblem, list[str]]] = {}
    for item in problems:
        run = item.experiment or ""
        words = re.sub(r"[-+\d.e]*\d", "#", item.message.replace(str(item.file.parent), "").replace(run, ""))
        alone = "" if run and item.severity == "warning" else f"{item.file}:{item.line}"
        kind = (item.severity, item.key, words, alone)
        first, others = found.setdefault(kind, (item, []))
        if first is not item and run not in (first.experiment, *others):
            others.append(run)
    return list(found.values())


@click.command("check")
@click.argument("campaign", type=PATH)
@trust_option
@output_options
def check_command(campaign: Path, as_json: bool) -> int:
    """What is wrong with a campaign, all at once.

    Nothing is written.
    """
    from rfea_vision.campaign.check import check_campaign

    with ConsoleListener().shown() as listener:
        checked = check_campaign(campaign, listener.begin("check", campaign.name), trust=trusted())
    errors = [item for item in checked.problems if item.severity == "error"]
    if as_json:
        problems = [item.as_dict() for item in checked.problems]
        print_json(
            {"campaign": str(campaign), "ok": not errors, "experiments": checked.experiments, "problems": problems}
        )
    else:
        for item, others in told_once(checked.problems):
            say(f"{item.severity}: {item}" + (f" (likewise {', '.join(others)})" if others else ""))
        found = ", ".join(f"{name} ({role})" for name, role in checked.experiments.items()) or "none"
        say(f"experiments: {found}")
        warnings = len(checked.problems) - len(errors)
        click.echo(f"{counted(len(errors), 'error')}, {counted(warnings, 'warning')}")
        if errors and not checked.experiments and not (campaign / "campaign.yaml").is_file():
            above = [folder for folder in campaign.resolve().parents[:2] if is_file(folder / "campaign.yaml")]
            if above:
                say_next("rfea check", above[0], why="the campaign that it belongs to")
            else:
                say_next("rfea init DIR", why="writes a campaign to fill in, or guesses one with --from FILES")
        elif errors:
            say_next("rfea check", campaign, why="again, once these are mended")
        elif "train" not in checked.experiments.values():
            say_next("rfea check", campaign, why="again, once a run has 'role: train'; 'rfea track' needs none")
        elif checked.unpressed:
            say_next("rfea check", campaign, why="again, once every run has its pressure; 'rfea track' needs none")
        else:
            say_next("rfea improve", campaign, why="or step by step: rfea track, sync, fit, compare, diagnose")
    return InputError.exit_code if errors else 0


@click.command("schema")
@click.argument("name", required=False)
@output_options
def schema_command(name: str | None, as_json: bool) -> None:
    """JSON Schema of what goes in and comes out: all files, or one."""
    from rfea_vision.stages.schemas import schemas

    found = schemas()
    if name is None:
        print_json(found)
    elif name in found:
        print_json(found[name])
    else:
        raise InputError(f"schema: '{name}' is unknown; there are {', '.join(found)}")


@click.command("doctor")
@output_options
def doctor_command(as_json: bool) -> int:
    """Whether this machine has what rfea needs."""
    from rfea_vision.cli.doctor import examine

    findings = examine()
    broken = [item for item in findings if item.state == "broken"]
    if as_json:
        print_json({"ok": not broken, "findings": [vars(item) for item in findings]})
    else:
        print_table("", ["what", "state", "found", "for"], [list(vars(item).values()) for item in findings], left=4)
        say_next("rfea demo" if not broken else "pip install rfea-vision", why="mends what is broken" if broken else "")
    return 1 if broken else 0


@click.command("board")
@click.argument("name", required=False)
@click.option("-o", "--output", type=PATH, help="PDF to write; default NAME.pdf.")
@output_options
def board_command(name: str | None, output: Path | None, as_json: bool) -> None:
    """A calibration board as PDF, at true scale.

    Without a name, the boards there are.
    """
    from rfea_vision.data import board_titles, read_board

    if name is None:
        titles = board_titles()
        if as_json:
            print_json(titles)
        else:
            print_table("", ["board", "what"], list(titles.items()), left=2)
            say_next("rfea board NAME", why="writes it as PDF")
        return
    from rfea_vision.campaign.schema import BoardPart
    from rfea_vision.files import whole_file

    try:
        keys = BoardPart.model_validate(read_board(name))
    except ValueError as error:
        raise InputError(str(error)) from error
    from rfea_vision.calibration.board import Board
    from rfea_vision.calibration.printing import board_pdf

    path = output or Path(f"{name}.pdf")
    board = Board(keys.kind, keys.inner_corners, keys.square, keys.marker, keys.dictionary)
    with whole_file(path) as temporary:
        temporary.write_bytes(board_pdf(board, name))
    if as_json:
        print_json({"file": str(path)})
    else:
        say(f"{path}: print it at 100 %, measure a square, and write what you measured as camera.board.square")
        say_next("rfea init DIR", why="a campaign to photograph it for")
