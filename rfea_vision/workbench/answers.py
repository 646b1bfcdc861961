"""What each address answers. All arguments come from the page; campaigns are known by number, files are never named by it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from starlette.responses import JSONResponse, Response

from rfea_vision.errors import InputError
from rfea_vision.workbench.desk import Desk, shown
from rfea_vision.workbench.packets import packet
from rfea_vision.workbench.state import state_of

if TYPE_CHECKING:
    from rfea_vision.workbench.play import Chosen

BINARY = "application/octet-stream"


def campaigns(desk: Desk, asked: dict[str, Any]) -> Response:
    """Every campaign on the desk with where it stands."""
    found = []
    for index, folder in enumerate(desk.campaigns):
        state = state_of(folder, desk.out)
        keep = ("name", "problems", "models", "next")
        measured = [item["recorded"] is not None for item in state["experiments"]]
        found.append(
            {key: state[key] for key in keep} | {"index": index, "folder": shown(folder), "measured": measured}
        )
    return JSONResponse({"folder": shown(desk.folder), "campaigns": found, "job": desk.worker.job})


def state(desk: Desk, index: int, asked: dict[str, Any]) -> Response:
    """Where one campaign stands."""
    found = state_of(desk.campaigns[index], desk.out)
    path = shown(desk.campaigns[index])
    job = {key: desk.worker.job.get(key) for key in ("index", "do", "label", "command")} if desk.worker.job else None
    return JSONResponse(found | {"path": path, "job": job, "log": desk.log[-20:], "single": desk.single})


def evidence(desk: Desk, index: int, asked: dict[str, Any]) -> Response:
    """Series and records for the figures."""
    return Response(desk.bench(index).evidence()[1], media_type=BINARY)


def clip(desk: Desk, index: int, number: int, asked: dict[str, Any]) -> Response:
    """The small rectified film of one experiment."""
    experiments = desk.bench(index).evidence()[0].experiments
    film = experiments[number].clip if number < len(experiments) else None
    if film is None:
        raise InputError("there is no film of this run")
    return Response(film, media_type="video/mp4")


def effects(desk: Desk, index: int, asked: dict[str, Any]) -> Response:
    """The catalogue, and the laws of one's own that are open."""
    from rfea_vision.effects.catalogue import catalogue, load_effect_file

    own = [effect for file in sorted(desk.own_files) for effect in load_effect_file(file)]
    listed = [*own, *catalogue().values()]
    return JSONResponse([
        {"id": item.id, "title": item.title, "kind": item.kind, "shows": item.shows, "own": item in own} for item in listed
    ])  # fmt: skip


def model(desk: Desk, index: int, asked: dict[str, Any]) -> Response:
    """Sliders of a model; its law is compiled meanwhile."""
    chosen, player = _chosen(desk, index, asked), desk.bench(index).player()
    sliders = [slider.as_dict() for slider in player.open(chosen)]
    return JSONResponse({"sliders": sliders, "ready": player.ready(chosen)})


def play(desk: Desk, index: int, asked: dict[str, Any]) -> Response:
    """One look at a model under the sliders."""
    values = {str(name): float(value) for name, value in asked["values"].items()}
    chosen, run, exact = _chosen(desk, index, asked), str(asked["experiment"]), bool(asked.get("exact"))
    data = packet(*desk.bench(index).player().play(chosen, values, run, exact=exact))
    return Response(data, media_type=BINARY)


def job(desk: Desk, index: int, asked: dict[str, Any]) -> Response:
    """Begin a command."""
    if not desk.begin(index, str(asked["do"]), dict(asked.get("options", {})), str(asked.get("label", ""))):
        raise InputError("another command is under way; wait for it, or stop it")
    return JSONResponse({"begun": True})


def stop(desk: Desk, asked: dict[str, Any]) -> Response:
    """Stop the command that is under way."""
    desk.worker.stop()
    return JSONResponse({"stopped": True})


def _chosen(desk: Desk, index: int, asked: dict[str, Any]) -> Chosen:
    """The model that is asked for; its effect files are those that this user has opened, and no others."""
    from rfea_vision.effects.catalogue import load_effect_file

    wanted = {str(effect).partition("@")[0] for effect in asked["effects"]}
    files = [file for file in sorted(desk.own_files) if wanted & {effect.id for effect in load_effect_file(file)}]
    return desk.bench(index).chosen(str(asked["model"]), tuple(map(str, asked["effects"])), tuple(files))
