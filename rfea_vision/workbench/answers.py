"""What each address answers: JSON, or bytes of a kind. All that is asked comes from the page; files are never named by it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.responses import Response

from rfea_vision.errors import InputError
from rfea_vision.workbench.app_state import Asked, shown
from rfea_vision.workbench.clocks import write_sync
from rfea_vision.workbench.curves import write_curve
from rfea_vision.workbench.loading import loaded
from rfea_vision.workbench.orders import order
from rfea_vision.workbench.packets import packet
from rfea_vision.workbench.state import state_of

if TYPE_CHECKING:
    from rfea_vision.workbench.play import Chosen

Json = dict[str, Any] | list[dict[str, Any]]
BINARY = "application/octet-stream"
#: A page of no origin: it can draw itself, save figures and print, and ask this server for nothing.
SANDBOX = "sandbox allow-scripts allow-downloads allow-modals"
#: Seconds of a film that are tracked for a trial: several swings of a tube, and an answer while a person waits.
LONGEST_TRIAL_S = 10.0


def campaigns(asked: Asked) -> Json:
    """Every campaign with where it stands."""
    app, found = asked.app, []
    for index, folder in enumerate(app.campaigns):
        state = state_of(folder, app.out)
        kept = {key: state[key] for key in ("name", "problems", "models", "next")}
        measured = [item["recorded"] is not None for item in state["experiments"]]
        found.append(kept | {"index": index, "folder": shown(folder), "measured": measured})
    app.seen.set()
    return {"folder": shown(app.folder), "campaigns": found, "job": app.worker.told()}


def state(asked: Asked) -> Json:
    """Where one campaign stands."""
    app = asked.app
    folder = app.campaigns[asked.index]
    found = state_of(folder, app.out, app.failed.get(asked.index, ""))
    path, step = shown(folder), found["next"]
    if step["do"]:
        step["command"] = order(path, app.out, step["do"], step["options"])[1]
    elif "file" in step:
        step["command"] = shown(Path(step["file"]))
    return found | {"path": path, "job": app.worker.told(), "log": app.log[-20:]}


def evidence(asked: Asked) -> Response:
    """Series and records for the figures."""
    found = asked.opened.evidence()[1]
    asked.app.seen.set()
    return Response(found, media_type=BINARY)


def clip(asked: Asked) -> Response:
    """The small rectified film of one experiment; InputError if there is none."""
    experiments = asked.opened.evidence()[0].experiments
    film = experiments[asked.number].clip if asked.number < len(experiments) else None
    if film is None:
        raise InputError("there is no film of this run")
    return Response(film, media_type="video/mp4")


def report(asked: Asked) -> Response:
    """The report that lies in the campaign: in a sandbox, as whoever has the folder may have written it."""
    content = (asked.opened.out / "report" / "index.html").read_bytes()
    policy = f"{SANDBOX}; {loaded('report.page').POLICY}"
    return Response(content, media_type="text/html", headers={"content-security-policy": policy})


def effects(asked: Asked) -> Json:
    """The catalogue, and the laws of one's own that are open."""
    known = loaded("effects.catalogue")
    own = [effect for file in asked.app.laws() for effect in known.load_effect_file(file)]
    told = ("id", "title", "kind", "shows")
    every = [*own, *known.catalogue().values()]
    return [{key: getattr(item, key) for key in told} | {"own": item in own} for item in every]


def model(asked: Asked) -> Json:
    """Sliders of a model; its law is compiled meanwhile."""
    chosen, player = _chosen(asked), asked.opened.player()
    sliders = [slider.as_dict() for slider in player.open(chosen)]
    return {"sliders": sliders, "ready": player.ready(chosen)}


def play(asked: Asked) -> Response:
    """One look at a model under the sliders."""
    values = {str(name): float(value) for name, value in asked["values"].items()}
    chosen, run, exact = _chosen(asked), str(asked["experiment"]), bool(asked.get("exact"))
    data = packet(*asked.opened.player().play(chosen, values, run, exact=exact))
    return Response(data, media_type=BINARY)


def job(asked: Asked) -> Json:
    """Begin a command."""
    do, options, label = str(asked["do"]), dict(asked.get("options", {})), str(asked.get("label", ""))
    return _begun(asked.app.begin(asked.index, do, options, label))


def stop(asked: Asked) -> Json:
    """Stop the command that is under way."""
    asked.app.worker.stop()
    return {"stopped": True}


def _chosen(asked: Asked) -> Chosen:
    """The model that is asked for; its effect files are those that this user has opened, and no others."""
    wanted = {str(effect).partition("@")[0] for effect in asked["effects"]}
    files = [file for file in asked.app.laws() if wanted & loaded("workbench.laws").ids_of(file)]
    return asked.opened.chosen(str(asked["model"]), tuple(map(str, asked["effects"])), tuple(files))


# -- pointing ------------------------------------------------------------------------------------------------------------


def film(asked: Asked) -> Json:
    """Size and times of an experiment's film."""
    return loaded("workbench.pointing").film(asked.experiment)


def columns(asked: Asked) -> Json:
    """Columns of an experiment's log: one of them may hold the signal of a lamp."""
    log = asked.experiment.pressure.file
    return {"columns": [] if log is None else list(loaded("readers.tables").read_table(log).columns)}


def picture(asked: Asked) -> Response:
    """One frame of a film."""
    return Response(loaded("workbench.pointing").picture(asked.experiment, int(asked["frame"])), media_type="image/jpeg")


def photo(asked: Asked) -> Response:
    """One photo of the board."""
    return Response(loaded("workbench.pointing").photo(asked.opened.as_far_as_read(), asked.number), media_type="image/jpeg")


def outline(asked: Asked) -> Json:
    """What was tracked in one frame."""
    return loaded("workbench.pointing").outline(asked.opened.as_far_as_read(), asked.experiment, int(asked["frame"]))


def refused(asked: Asked) -> Json:
    """Frames that were refused for one reason."""
    campaign, reason = asked.opened.as_far_as_read(), str(asked["reason"])
    return {"frames": loaded("workbench.pointing").refused(campaign, asked.experiment, reason)}


def hint(asked: Asked) -> Json:
    """Write a hint into the files, or take it away."""
    campaign, key, everywhere = asked.opened.as_far_as_read(), str(asked["key"]), bool(asked["all"])
    write = loaded("workbench.pointing").write_hint
    return {"file": shown(write(campaign, asked.experiment, key, asked["value"], everywhere=everywhere))}


def sync(asked: Asked) -> Json:
    """Write how the clocks of a run are brought together."""
    return {"file": shown(write_sync(asked.experiment, asked.given))}


def trial(asked: Asked) -> Json:
    """Follow the tube through the first seconds of a film; the lines come as events."""
    name, seconds = asked.experiment.name, min(float(asked["seconds"]), LONGEST_TRIAL_S)
    options = {"name": name, "seconds": seconds}
    return _begun(asked.app.submit(asked.index, "try", options, f"Try the first {seconds:g} s of {name}"))


def _begun(begun: bool) -> Json:
    if not begun:
        raise InputError("another command is under way; wait for it, or stop it")
    return {"begun": True}


# -- laws, curves, batches -----------------------------------------------------------------------------------------------


def law_template(asked: Asked) -> Json:
    """A new law to begin with."""
    file, text = loaded("workbench.laws").new_law()
    return {"file": str(file), "text": text}


def law_new(asked: Asked) -> Json:
    """Where a law is written under a name that the user gives: a file that is not there yet."""
    file = _law_file(asked)
    loaded("workbench.laws").refuse_taken(file)
    return {"file": str(file)}


def law_open(asked: Asked) -> Json:
    """The text of a law that the user names."""
    file = _law_file(asked)
    text = loaded("workbench.laws").opened(file)
    asked.app.begun_files.add(file)
    return {"file": str(file), "text": text}


def law_check(asked: Asked) -> Json:
    """Say what is wrong with a law or what it declares; with ``keep`` write it, and count it as the user's."""
    return asked.app.check_law(_law_file(asked), str(asked["text"]), keep=bool(asked["keep"]))


def _law_file(asked: Asked) -> Path:
    """The one file that a page names: a law, which the user has typed."""
    return loaded("workbench.laws").named_file(str(asked["file"]), asked.app.campaigns)


def curve(asked: Asked) -> Json:
    """Write an edited pressure curve beside the model whose diagnosis asked for it."""
    file = shown(write_curve(asked.opened.out, str(asked["model"]), asked["points"]))
    return {"file": file, "command": f"rfea simulate OUT --pressure {file}"}


def batch(asked: Asked) -> Json:
    """Run all campaigns."""
    return _begun(asked.app.begin_all())
