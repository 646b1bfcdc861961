"""What each address answers. All arguments come from the page; campaigns are known by number, files are never named by it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.responses import JSONResponse, Response

from rfea_vision.errors import InputError
from rfea_vision.workbench.app_state import AppState, shown
from rfea_vision.workbench.clocks import write_sync
from rfea_vision.workbench.curves import write_curve
from rfea_vision.workbench.loading import loaded
from rfea_vision.workbench.orders import order
from rfea_vision.workbench.packets import packet
from rfea_vision.workbench.state import state_of

if TYPE_CHECKING:
    from rfea_vision.workbench.play import Chosen

BINARY = "application/octet-stream"
#: A page of no origin: it can draw itself, save figures and print, and ask this server for nothing.
SANDBOX = "sandbox allow-scripts allow-downloads allow-modals"
#: Seconds of a film that are tracked for a trial: several swings of a tube, and an answer while a person waits.
LONGEST_TRIAL_S = 10.0


def campaigns(app: AppState, asked: dict[str, Any]) -> Response:
    """Every campaign with where it stands."""
    found = []
    for index, folder in enumerate(app.campaigns):
        state = state_of(folder, app.out)
        keep = ("name", "problems", "models", "next")
        measured = [item["recorded"] is not None for item in state["experiments"]]
        found.append(
            {key: state[key] for key in keep} | {"index": index, "folder": shown(folder), "measured": measured}
        )
    app.seen.set()
    return JSONResponse({"folder": shown(app.folder), "campaigns": found, "job": app.worker.told()})


def state(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """Where one campaign stands."""
    found = state_of(app.campaigns[index], app.out, app.failed.get(index, ""))
    path, step = shown(app.campaigns[index]), found["next"]
    if step["do"]:
        step["command"] = order(path, app.out, step["do"], step["options"])[1]
    elif "file" in step:
        step["command"] = shown(Path(step["file"]))
    return JSONResponse(found | {"path": path, "job": app.worker.told(), "log": app.log[-20:]})


def evidence(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """Series and records for the figures."""
    found = app.opened(index).evidence()[1]
    app.seen.set()
    return Response(found, media_type=BINARY)


def clip(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """The small rectified film of one experiment; InputError if there is none."""
    experiments = app.opened(index).evidence()[0].experiments
    film = experiments[number].clip if number < len(experiments) else None
    if film is None:
        raise InputError("there is no film of this run")
    return Response(film, media_type="video/mp4")


def report(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """The report that lies in the campaign: in a sandbox, as whoever has the folder may have written it."""
    content = (app.opened(index).out / "report" / "index.html").read_bytes()
    policy = f"{SANDBOX}; {loaded('report.page').POLICY}"
    return Response(content, media_type="text/html", headers={"content-security-policy": policy})


def effects(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """The catalogue, and the laws of one's own that are open."""
    known = loaded("effects.catalogue")
    own = [effect for file in app.laws() for effect in known.load_effect_file(file)]
    listed = [*own, *known.catalogue().values()]
    return JSONResponse([
        {"id": item.id, "title": item.title, "kind": item.kind, "shows": item.shows, "own": item in own} for item in listed
    ])  # fmt: skip


def model(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """Sliders of a model; its law is compiled meanwhile."""
    chosen, player = _chosen(app, index, asked), app.opened(index).player()
    sliders = [slider.as_dict() for slider in player.open(chosen)]
    return JSONResponse({"sliders": sliders, "ready": player.ready(chosen)})


def play(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """One look at a model under the sliders."""
    values = {str(name): float(value) for name, value in asked["values"].items()}
    chosen, run, exact = _chosen(app, index, asked), str(asked["experiment"]), bool(asked.get("exact"))
    data = packet(*app.opened(index).player().play(chosen, values, run, exact=exact))
    return Response(data, media_type=BINARY)


def job(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """Begin a command."""
    return _begun(app.begin(index, str(asked["do"]), dict(asked.get("options", {})), str(asked.get("label", ""))))


def stop(app: AppState, asked: dict[str, Any]) -> Response:
    """Stop the command that is under way."""
    app.worker.stop()
    return JSONResponse({"stopped": True})


def _chosen(app: AppState, index: int, asked: dict[str, Any]) -> Chosen:
    """The model that is asked for; its effect files are those that this user has opened, and no others."""
    wanted = {str(effect).partition("@")[0] for effect in asked["effects"]}
    files = [file for file in app.laws() if wanted & loaded("workbench.laws").ids_of(file)]
    return app.opened(index).chosen(str(asked["model"]), tuple(map(str, asked["effects"])), tuple(files))


# -- pointing ------------------------------------------------------------------------------------------------------------


def film(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """Size and times of an experiment's film."""
    return JSONResponse(loaded("workbench.pointing").film(app.opened(index).experiment(number)))


def columns(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """Columns of an experiment's log: one of them may hold the signal of a lamp."""
    log = app.opened(index).experiment(number).pressure.file
    return JSONResponse({"columns": [] if log is None else list(loaded("readers.tables").read_table(log).columns)})


def picture(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """One frame of a film."""
    return Response(
        loaded("workbench.pointing").picture(app.opened(index).experiment(number), int(asked["frame"])),
        media_type="image/jpeg",
    )


def photo(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """One photo of the board."""
    return Response(loaded("workbench.pointing").photo(app.opened(index).campaign(), number), media_type="image/jpeg")


def outline(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """What was tracked in one frame."""
    opened = app.opened(index)
    return JSONResponse(
        loaded("workbench.pointing").outline(opened.campaign(), opened.experiment(number), int(asked["frame"]))
    )


def refused(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """Frames that were refused for one reason."""
    opened = app.opened(index)
    return JSONResponse(
        {
            "frames": loaded("workbench.pointing").refused(
                opened.campaign(), opened.experiment(number), str(asked["reason"])
            )
        }
    )


def hint(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """Write a hint into the files, or take it away."""
    opened = app.opened(index)
    experiment, key, value = opened.experiment(number), str(asked["key"]), asked["value"]
    file = loaded("workbench.pointing").write_hint(
        opened.campaign(), experiment, key, value, everywhere=bool(asked["all"])
    )
    return JSONResponse({"file": shown(file)})


def sync(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """Write how the clocks of a run are brought together."""
    file = write_sync(app.opened(index).experiment(number), asked)
    return JSONResponse({"file": shown(file)})


def trial(app: AppState, index: int, number: int, asked: dict[str, Any]) -> Response:
    """Follow the tube through the first seconds of a film; the lines come as events."""
    experiment = app.opened(index).experiment(number)
    options = {"name": experiment.name, "seconds": min(float(asked["seconds"]), LONGEST_TRIAL_S)}
    return _begun(app.submit(index, "try", options, f"Try the first {options['seconds']:g} s of {experiment.name}"))


def _begun(begun: bool) -> Response:
    if not begun:
        raise InputError("another command is under way; wait for it, or stop it")
    return JSONResponse({"begun": True})


# -- laws, curves, batches -----------------------------------------------------------------------------------------------


def law_template(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """A new law to begin with."""
    file, text = loaded("workbench.laws").new_law()
    return JSONResponse({"file": str(file), "text": text})


def law_new(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """Where a law is written under a name that the user gives: a file that is not there yet."""
    file = loaded("workbench.laws").named_file(str(asked["file"]), app.campaigns)
    loaded("workbench.laws").refuse_taken(file)
    return JSONResponse({"file": str(file)})


def law_open(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """The text of a law that the user names."""
    file = loaded("workbench.laws").named_file(str(asked["file"]), app.campaigns)
    text = loaded("workbench.laws").opened(file)
    app.begun_files.add(file)
    return JSONResponse({"file": str(file), "text": text})


def law_check(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """Say what is wrong with a law or what it declares; with ``keep`` write it, and count it as the user's."""
    file = loaded("workbench.laws").named_file(str(asked["file"]), app.campaigns)
    return JSONResponse(app.check_law(file, str(asked["text"]), keep=bool(asked["keep"])))


def curve(app: AppState, index: int, asked: dict[str, Any]) -> Response:
    """Write an edited pressure curve beside the model whose diagnosis asked for it."""
    file = write_curve(app.opened(index).out, str(asked["model"]), asked["points"])
    return JSONResponse({"file": shown(file), "command": f"rfea simulate OUT --pressure {shown(file)}"})


def batch(app: AppState, asked: dict[str, Any]) -> Response:
    """Run all campaigns."""
    return _begun(app.begin_all())
