"""Commands around the twin: simulate, demo."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from rfea_vision.campaign.specs import GRAVITY_DEG
from rfea_vision.cli.console import ConsoleListener, print_json, print_table, say, say_next
from rfea_vision.cli.model import print_ladder
from rfea_vision.cli.options import PATH, Quantity, ask, opened, output_options, refuse_beside, typed
from rfea_vision.errors import InputError
from rfea_vision.options import CritiqueOptions
from rfea_vision.units import counted, parse_quantity

if TYPE_CHECKING:
    from rfea_vision.drive import ValveCommands
    from rfea_vision.twin.excitation import Programme

_DEMO = "hidden-effect"
_BESIDE_LIKE = {"like", "hidden", "seed", "write_truth", "as_json", "debug"}  # parameters that have a meaning beside --like


@click.command("simulate")
@click.argument("out", type=PATH)
@click.option(
    "--hidden",
    multiple=True,
    metavar="EFFECT.PARAMETER=VALUE",
    help="Hide this, such as maxwell.T=1.2s; may be repeated.",
)
@click.option(
    "--seed", type=int, default=0, show_default=True, help="Draws tube, excitations, clocks, camera and noise."
)
@click.option("--experiments", type=click.IntRange(1), help="How many; roles are then train ..., validate, test.")
@click.option(
    "--roles", metavar="ROLE,ROLE,...", help="The role of each experiment; default train, train, validate, test."
)
@click.option("--duration", "duration_s", type=Quantity("s", "6s"), help="Length of each experiment; default 6s.")
@click.option("--rate", "rate_Hz", type=Quantity("Hz", "240Hz"), help="Frames per second; default 240Hz.")
@click.option("--video/--no-video", default=False, show_default=True, help="Board photos and video, or a track.csv.")
@click.option(
    "--observe", type=click.Choice(["midline", "tip", "angle"]), help="What a track.csv holds; default midline."
)
@click.option(
    "--noise", "noise_mm", type=Quantity("mm", "0.06mm"), help="Noise of a tracked coordinate; default 0.06mm."
)
@click.option(
    "--pressure",
    metavar="QUANTITY|FILE",
    help="Highest pressure (default 270kPa), or a log (time_s,pressure_kPa) that every run plays.",
)
@click.option(
    "--paper", is_flag=True, help="The paper's 8-DoF tube, stepped to 270 kPa (train) and 220 kPa (validate)."
)
@click.option(
    "--gravity",
    metavar="down|left|right|up|none|ANGLE",
    help="Where gravity points where the unloaded tube points down; an angle such as 30deg is positive in the direction of the bend.",
)
@click.option("--bends", type=click.Choice(["left", "right"]), default="left", show_default=True)
@click.option(
    "--sync", type=click.Choice(["motion", "offset", "common_clock"]), help="What the files say of the clocks."
)
@click.option("--offset", "offset_s", type=Quantity("s", "20ms"), help="Log clock minus camera clock; default drawn.")
@click.option(
    "--drive",
    is_flag=False,
    flag_value="duty",
    metavar="[VALVES.csv]",
    help="A digital hydraulic drive makes the pressure: from its valve commands (time_s,supply,drain), or without a file "
    "following the drawn pressure with a duty cycle.",
)
@click.option("--repeat", is_flag=True, help="Record the first experiment twice.")
@click.option(
    "--scene",
    multiple=True,
    metavar="NAME[=VALUE]",
    help="Make the pictures hard: light, dark, busy, uneven, flicker, hose, landscape, vfr, slow-motion, dropped, "
    "duplicated, highlight, shadow, bright, shutter, band, sleeve; may be repeated.",
)
@click.option(
    "--like",
    type=PATH,
    metavar="CAMPAIGN",
    help="Tracks with the pressure logs, roles, frames, clocks and noise of this campaign, and the tube fitted to it.",
)
@click.option(
    "--truth/--no-truth", "write_truth", default=True, show_default=True, help="Write OUT-truth.json beside it."
)
@output_options
def simulate_command(
    out: Path, like: Path | None, paper: bool, hidden: tuple[str, ...], scene: tuple[str, ...], seed: int, write_truth: bool,
    experiments: int | None, roles: str | None, repeat: bool, duration_s: float | None, rate_Hz: float | None, video: bool,
    observe: str | None, noise_mm: float | None, pressure: str | None, drive: str | None, gravity: str | None,
    bends: Literal["left", "right"], sync: str | None, offset_s: float | None, as_json: bool,
) -> None:  # fmt: skip
    """A twin: a tube whose physics you choose.

    Writes a campaign with pressure logs, board photos and video (or tracks), and beside it what it hides.
    """
    try:
        from rfea_vision.twin import TwinOptions, paper_campaign, parse_hidden, parse_scene, simulate
    except ImportError as error:
        raise InputError(f"simulate: needs the module '{error.name}'; pip install 'rfea-vision[twin]'") from error
    from dataclasses import replace

    from rfea_vision.artefacts import Actuator

    values = parse_hidden(hidden)
    if like is not None:
        refuse_beside("--like", sorted(typed().keys() - _BESIDE_LIKE), "the campaign's recordings say it")
        _report_twin(out, _simulate_like(out, like, values, seed, write_truth), as_json)
        return
    chosen = _roles(experiments, roles)
    highest_kPa, programme = (None, None) if pressure is None else _played(pressure)
    if programme is not None:  # one run of its length, where nothing else is said
        chosen, duration_s = chosen or ("train",), duration_s or float(programme.time_s[-1])
    start = TwinOptions()
    if paper:
        start = paper_campaign() if chosen is None else paper_campaign(chosen)
    asked = {
        "roles": chosen, "duration_s": duration_s, "rate_Hz": rate_Hz, "observe": observe, "noise_mm": noise_mm, "sync": sync,
        "offset_s": offset_s, "pressure_max_kPa": highest_kPa, "given": programme, "gravity": _gravity(gravity),
        "drive": _valves(drive),
    }  # fmt: skip
    start = replace(start, **{name: value for name, value in asked.items() if value is not None})
    options = replace(
        start, hidden=values, seed=seed, video=video, actuator=Actuator(bends=bends), repeat=repeat, scene=parse_scene(scene),
        write_truth=write_truth,
    )  # fmt: skip
    with ConsoleListener().shown() as listener:
        truth = simulate(out, options, listener.begin("simulate", out.name))
    _report_twin(out, truth, as_json)


def _valves(given: str | None) -> ValveCommands | str | None:
    """What --drive asks for: the valve commands of a file, or the word for a duty cycle."""
    if given in (None, "duty"):
        return given
    from rfea_vision.drive import read_commands

    return read_commands(Path(given))


def _gravity(given: str | None) -> str | float | None:
    """A direction by its word, or as an angle (deg)."""
    if given is None or given in (*GRAVITY_DEG, "none"):
        return given
    try:
        return parse_quantity(given, "deg", example="30deg")
    except ValueError as error:
        raise InputError(f"--gravity: {error}, or one of down, left, right, up and none") from error


def _played(pressure: str) -> tuple[float | None, Programme | None]:
    """What --pressure asks for: a highest pressure (kPa), or a log to play."""
    path = Path(pressure)
    if not path.exists():
        try:
            return Quantity("kPa", "270kPa").convert(pressure, None, None), None
        except click.BadParameter:
            if not path.suffix or path.suffix[1:2].isdigit():  # the digits of a number, not the ending of a file
                raise
    from rfea_vision.campaign.specs import PressureSpec
    from rfea_vision.readers.pressure import read_pressure
    from rfea_vision.twin.excitation import given_programme

    log = read_pressure(PressureSpec(folder=path.parent, file=path), path.name)
    return None, given_programme(log.time_s, 1e3 * log.pressure_kPa)


def _simulate_like(out: Path, campaign: Path, hidden: dict[str, float], seed: int, write_truth: bool) -> dict[str, object]:
    """A twin of a campaign: fit the base model if there is no model yet, then play its logs to a tube like that."""
    from rfea_vision.artefacts import Actuator
    from rfea_vision.twin import TwinOptions
    from rfea_vision.twin.like import base_like, simulate_like, tube_like

    with opened(campaign, None) as work:
        tube_like(work.campaign.actuator)  # before anything is fitted
        fit = work.model("base") if "base" in work.model_names() else work.fit()
        recordings = work.recordings("train", "validate", "test")
    base = base_like({name: item.value for name, item in fit.parameters.items()}, fit.segments)
    options = TwinOptions(
        hidden=hidden, actuator=tube_like(Actuator(**fit.actuator)), base=base, seed=seed, write_truth=write_truth
    )
    with ConsoleListener().shown() as listener:
        return simulate_like(out, recordings, options, listener.begin("simulate", out.name))


def _report_twin(out: Path, truth: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json({"folder": str(out), "truth": truth})
        return
    values, units = truth["parameters"].items(), truth["units"]
    hidden = ", ".join(f"{name}={value:g} {units[name]}".removesuffix(" 1") for name, value in values) or "nothing"
    say(f"{out}: {counted(len(truth['experiments']), 'experiment')}; hidden: {hidden}")
    say_next("rfea improve", out)


def _roles(count: int | None, roles: str | None) -> tuple[str, ...] | None:
    """Return the roles: those given, or for a number of experiments the last ones set aside."""
    if roles is not None:
        names = tuple(name.strip() for name in roles.split(","))
        for name in names:
            if name not in ("train", "validate", "test", "ignore"):
                raise InputError(f"--roles: '{name}' is unknown; use train, validate, test or ignore")
        if count not in (None, len(names)):
            raise InputError(f"--roles names {len(names)} experiments, --experiments says {count}; keep one of them")
        return names
    if count is None:
        return None
    aside = {1: (), 2: ("validate",)}.get(count, ("validate", "test"))
    return ("train",) * (count - len(aside)) + aside


@click.command("demo")
@click.argument("place", metavar="[FOLDER]", required=False, type=PATH)
@click.option(
    "--folder", type=PATH, default="demo", show_default=True, help="Where it is copied to."
)
@ask("demo", options=CritiqueOptions)
@click.option("--force", is_flag=True, help="Redo the ladder even if nothing has changed.")
@output_options
def demo_command(place: Path | None, folder: Path, options: CritiqueOptions, force: bool, as_json: bool) -> None:
    """The example campaign, all the way to the report.

    It is copied to FOLDER and worked on there.
    """
    from rfea_vision.artefacts import Diagnosis
    from rfea_vision.data import data_folder

    example = data_folder("examples") / _DEMO
    if not example.is_dir():
        raise InputError(f"{example}: not found; use a whole checkout, or make a campaign with 'rfea simulate'")
    campaign = (place or folder) / _DEMO
    if not (campaign / "campaign.yaml").is_file():
        shutil.copytree(example, campaign, ignore=shutil.ignore_patterns("rfea", ".*"), dirs_exist_ok=True)
    with opened(campaign, None, "improve", force=force) as work:
        ladder = work.improve(critique=options)
        report = work.report()
        models = work.out / "models"
    answer = example.with_name(f"{_DEMO}-truth.json")
    truth = json.loads(answer.read_text(encoding="utf-8"))["effects"] if answer.is_file() else None
    if as_json:
        print_json({**ladder.model_dump(mode="json"), "hidden": truth, "report": str(report)})
        return
    print_ladder(ladder)
    diagnoses = [Diagnosis.load(models / rung.model / "diagnosis.json") for rung in ladder.rungs]
    rows = [[item.model, item.said, ", ".join(item.named)] for item in diagnoses]
    click.echo("")
    print_table("what was missing", ["model", "verdict", "named"], rows, left=3)
    if truth is not None:
        say(f"what the example hides: {', '.join(truth)}")
    click.echo(f"report: {report.resolve()}")
    say_next("open in a browser:", report.resolve(), why="then 'rfea init DIR' for your own tube")
