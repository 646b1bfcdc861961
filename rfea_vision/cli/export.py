"""The command that takes a fitted model out of the campaign: export."""

from __future__ import annotations

import json
import math
import re
import shlex
from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from rfea_vision import __version__
from rfea_vision.cli.console import print_json, say, say_next
from rfea_vision.cli.options import Quantity, campaign_argument, code_option, opened, refuse_beside
from rfea_vision.errors import DataError, InputError
from rfea_vision.units import counted

if TYPE_CHECKING:
    from rfea_vision.artefacts import ModelFit
    from rfea_vision.stages import Workspace

#: What is written beside a model's code.
Kind = Literal["crate", "poses", "csv", "nwb"]


@click.command("export")
@code_option
@campaign_argument
@click.argument("places", nargs=-1, required=True, metavar="[MODEL] OUT")
@click.option("--fmu", is_flag=True, help="Write an FMU (FMI 2.0, co-simulation) instead of C.")
@click.option("--crate", is_flag=True, help="Write the fit with its files and hashes as an RO-Crate, the folder OUT.")
@click.option(
    "--poses", is_flag=True, help="Write the measured centre lines as movement's netCDF, one file per run in OUT."
)
@click.option("--csv", is_flag=True, help="Write tip and bend angle over time as CSV, one file per run in OUT.")
@click.option("--nwb", is_flag=True, help="Write centre lines and pressures as NWB, one file per run in OUT.")
@click.option("--step", "step_s", type=Quantity("s", "1ms"), default="1ms", show_default=True, help="Length of a step.")
@click.option(
    "--iterations",
    type=click.IntRange(1, 50),
    default=3,
    show_default=True,
    help="Newton iterations per stage, two stages a step; sharp dry friction wants 6.",
)
def export_command(
    campaign: Path,
    places: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    fmu: bool,
    crate: bool,
    poses: bool,
    csv: bool,
    nwb: bool,
    step_s: float,
    iterations: int,
) -> None:
    """A fitted model as C, for real time; or fit and tracks for other tools.

    Writes OUT.c and OUT.h (C99, self-contained), or with --fmu OUT.fmu; of the model named, or of the one fitted last.
    """
    *models, last = places
    asked: dict[Kind, bool] = {"crate": crate, "poses": poses, "csv": csv, "nwb": nwb}
    kind: Kind | None = next((name for name, given in asked.items() if given), None)
    if len(models) > 1 or (models and kind not in (None, "crate")):
        at_most = "at most one MODEL, and OUT" if kind in (None, "crate") else "and OUT: tracks have no MODEL"
        raise InputError(f"export: give CAMPAIGN, {at_most}")
    if not step_s > 0:
        raise InputError("export: --step must be longer than zero, for example 1ms")
    if sum((fmu, *asked.values())) > 1:
        raise InputError("export: give one of --fmu, --crate, --poses, --csv and --nwb")
    if kind:
        refuse_beside(f"--{kind}", ("step_s", "iterations"), "it writes no code that steps")
        _export_files(campaign, out, models, Path(last), kind=kind, as_json=as_json)
    else:
        _export_code(campaign, out, models, Path(last), step_s, iterations, fmu=fmu, as_json=as_json)


def _export_files(
    campaign: Path, out: Path | None, models: list[str], folder: Path, *, kind: Kind, as_json: bool
) -> None:
    """The fit as an RO-Crate, or what was measured as netCDF, CSV or NWB."""
    if kind == "crate":
        files = _write_crate(campaign, out, models, folder)
    else:
        files = _write_measured(campaign, out, folder, kind)
    if as_json:
        print_json({"files": [str(path) for path in files]})
        return
    say(f"{folder}: {', '.join(path.name for path in files)}")
    if kind == "crate":
        say_next("look into", files[0], why="the list of what the crate holds, an RO-Crate 1.1")
    elif kind == "csv":
        say_next("look into", files[0], why="'track: {file: ...}' reads it, too")
    elif kind == "nwb":
        say_next("python -m pynwb.validate", files[0], why="what NWB says of it")
    else:
        shown = f"import xarray; print(xarray.open_dataset({json.dumps(str(files[0]))}))"  # no quotes within those of a shell
        say_next("python -c", shown, why="movement opens it, too")


def _export_code(
    campaign: Path,
    out: Path | None,
    models: list[str],
    target: Path,
    step_s: float,
    iterations: int,
    *,
    fmu: bool,
    as_json: bool,
) -> None:
    """The fitted model as C99, or as an FMU."""
    from rfea_vision.export import c_files, fitted_model, fmu_content
    from rfea_vision.export.c_source import not_of_the_tube
    from rfea_vision.files import whole_file, write_text

    target = target.with_suffix("") if target.suffix in (".c", ".h", ".fmu") else target
    name = re.sub(r"\W", "_", target.name, flags=re.ASCII)
    name = name if re.match(r"[A-Za-z_]", name) else f"tube_{name}"
    fit, others, gravity, mounting = _model_and_gravity(campaign, out, models)
    model, par = fitted_model(fit, gravity, mounting)
    if outside := not_of_the_tube(model):
        without = next((one.name for one in others() if not not_of_the_tube(fitted_model(one, gravity, mounting)[0])), None)
        command = shlex.join(["rfea", *(["export", str(campaign), without, str(target)] if without else ["fit", str(campaign)])])
        what = f"export {without}, a model without it" if without else "fit a model without it"
        raise InputError(f"export: '{outside[0]}' belongs to the camera or the clocks, not to the tube; {what}: {command}")
    about = f"Model '{fit.name}' of {campaign.name}: {counted(fit.segments, 'segment')}"
    about += f", {', '.join(fit.effects)}" if fit.effects else ""
    about += (
        f", gravity {math.degrees(mounting):.4g} deg from the hanging tube" if gravity else ", no gravity in its plane"
    )
    if fmu:
        written = [target.with_name(f"{target.name}.fmu")]
        content = fmu_content(model, par, name, step_s, about, iterations)
        with whole_file(written[0]) as temporary:
            temporary.write_bytes(content)
    else:
        written = [target.with_name(f"{name}.c"), target.with_name(f"{name}.h")]
        header, source = c_files(model, par, name, step_s, about, iterations)
        write_text(written[1], header)
        write_text(written[0], source)
    if as_json:
        print_json({"model": fit.name, "step_s": step_s, "files": [str(path) for path in written]})
        return
    say(f"{fit.name}: {', '.join(str(path) for path in written)}; a step is {step_s * 1e3:g} ms")
    if fmu:
        say_next("rfea compare", campaign, fit.name, why="how far the model in it is to be trusted")
    else:
        say_next("cc -O2 -c", written[0], why="C99, needs nothing else")


def _model_and_gravity(
    campaign: Path, out: Path | None, models: list[str]
) -> tuple[ModelFit, Callable[[], Iterator[ModelFit]], float, float]:
    """The model that is asked for, the others, gravity (m/s^2) in the plane of the training runs, and from where it pulls (rad)."""
    from rfea_vision.artefacts import ModelFit, Recording
    from rfea_vision.dynamics.simulation import STANDARD_GRAVITY
    from rfea_vision.fitting.observation import rig_of
    from rfea_vision.stages import mechanics

    with opened(campaign, out) as work:
        fit = _asked_model(work, models)
        files = [mechanics.model_folder(work, name) / "model.json" for name in mechanics.model_names(work) if name != fit.name]
        runs = [work.out / run.name / "recording.nc" for run in work.campaign.experiments if run.role == "train"]
    rigs = {rig_of(Recording.load(path).dataset) for path in runs if path.is_file()}
    if len(rigs) > 1:
        raise DataError(
            f"{campaign}: its training runs stand under gravity from {len(rigs)} sides, and an exported tube under one; "
            "export from a folder that holds the runs of one of them"
        )
    return fit, lambda: map(ModelFit.load, files), *(rigs.pop() if rigs else (STANDARD_GRAVITY, 0.0))


def _asked_model(work: Workspace, models: list[str]) -> ModelFit:
    """The model that is named, or the one fitted last; of one that was refused a warning says so."""
    from rfea_vision.stages import mechanics

    fit = work.model(models[0] if models else mechanics.last_model(work) or "base")
    if fit.refused:
        why = fit.refused.removeprefix("Refused: ")
        click.echo(f"warning: {fit.name} was refused when it was fitted, and is no model of this tube: {why}", err=True)
    return fit


def _write_crate(campaign: Path, out: Path | None, models: list[str], folder: Path) -> list[Path]:
    """The fit, what it predicts, the recordings that it was made from, and the campaign's own files."""
    from rfea_vision.export.crate import write_crate
    from rfea_vision.report.methods import versions
    from rfea_vision.stages import mechanics

    with opened(campaign, out) as work:
        fit = _asked_model(work, models)
        rooms = [mechanics.model_folder(work, fit.name), *(work.out / run.name for run in work.campaign.experiments)]
        kept = [path for room in rooms for path in sorted(room.glob("*")) if path.suffix in (".json", ".nc", ".csv")]
        files = {path.relative_to(work.out).as_posix(): path for path in kept if not path.name.startswith(".")}
        root = work.campaign.root
        words = [*root.glob("campaign.yaml"), *(run.file for run in work.campaign.experiments)]
        files |= {f"campaign/{path.relative_to(root).as_posix()}": path for path in words if path.is_file()}
        name = work.campaign.name
    today = date.today().isoformat()
    return [write_crate(folder, fit, files, name=name, made_on=today, versions=versions().items())]


def _write_measured(campaign: Path, out: Path | None, folder: Path, kind: Kind) -> list[Path]:
    """One file per run, of its own name; NWB holds the pressure, the others do without a log."""
    from rfea_vision.export.poses import write_movement
    from rfea_vision.export.tips import write_tip

    if kind == "nwb":
        from rfea_vision.export.nwb import write_nwb
    written = []
    with opened(campaign, out) as work:
        for name, measured in (work.sync() if kind == "nwb" else work.measured()).items():
            path = folder / f"{name}.{'nc' if kind == 'poses' else kind}"
            path.parent.mkdir(parents=True, exist_ok=True)
            if kind == "nwb":
                write_nwb(path, measured.dataset, name=name, campaign=work.campaign.name, version=__version__)
            elif kind == "csv":
                write_tip(path, measured.dataset)
            else:
                write_movement(path, measured.dataset, name=name)
            written.append(path)
    return written
