"""Text for a methods section, its references and the software's versions, all from artefacts."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

from rfea_vision.artefacts import Parameter
from rfea_vision.artefacts.clocks import SYNC_METHODS
from rfea_vision.artefacts.measurement import TENSION_kPa
from rfea_vision.report.collect import Evidence, LadderStep
from rfea_vision.report.formatting import inner_title, lens_words, listing, number, with_error, with_unit
from rfea_vision.report.prose import parameter_words
from rfea_vision.report.shown import errors_of
from rfea_vision.units import counted

BIBTEX = r"""@misc{kelageri2018kinematics,
  title         = {Kinematics and Dynamic Modeling of a Planar Hydraulic Elastomer Actuator},
  author        = {Momeni Kelageri, Mahdi and Heikkil{\"a}, Mikko and Jokinen, Jarno and Linjama, Matti
                   and Ghabcheloo, Reza},
  year          = {2018},
  eprint        = {1806.04907},
  archivePrefix = {arXiv}
}
@article{zhang2000flexible,
  title   = {A Flexible New Technique for Camera Calibration},
  author  = {Zhang, Zhengyou},
  journal = {IEEE Transactions on Pattern Analysis and Machine Intelligence},
  volume  = {22}, number = {11}, pages = {1330--1334}, year = {2000},
  doi     = {10.1109/34.888718}
}
@article{schwarz1978estimating,
  title   = {Estimating the Dimension of a Model},
  author  = {Schwarz, Gideon},
  journal = {The Annals of Statistics},
  volume  = {6}, number = {2}, pages = {461--464}, year = {1978},
  doi     = {10.1214/aos/1176344136}
}
@article{kennedy2001bayesian,
  title   = {Bayesian Calibration of Computer Models},
  author  = {Kennedy, Marc C. and O'Hagan, Anthony},
  journal = {Journal of the Royal Statistical Society: Series B},
  volume  = {63}, number = {3}, pages = {425--464}, year = {2001},
  doi     = {10.1111/1467-9868.00294}
}"""

_PACKAGES = (
    "rfea-vision",
    "numpy",
    "scipy",
    "numba",
    "sympy",
    "xarray",
    "opencv-python-headless",
    "av",
)

_OF_CAMERAS = {"opencv-python-headless", "av"}  # no part in what began with a track of another tool

_ROLES = {"train": "training", "validate": "held out", "test": "test"}
_LOSSES = {"huber": "the robust loss of Huber (least squares, in which what lies far off counts linearly)"}
_OBSERVED = {"midline": "centre line", "tip": "tip", "tip_y": "height of the tip", "angle": "bend angle"}


def references(evidence: Evidence) -> str:
    """What a methods section refers to, as BibTeX: the calibration by a board only where there was one."""
    entries = BIBTEX.split("\n@")
    return "\n@".join(entry for entry in entries if "zhang2000" not in entry or "(Zhang 2000)" in _measurement(evidence))


def versions() -> dict[str, str]:
    """Installed versions of the packages that made the artefacts."""
    found = {}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def methods(evidence: Evidence, step: LadderStep, titles: Mapping[str, str]) -> list[str]:
    """Paragraphs for a methods section, about the model of `step`."""
    used = {name: number_ for name, number_ in versions().items() if evidence.camera or name not in _OF_CAMERAS}
    software = "Software: " + ", ".join(f"{name} {number_}" for name, number_ in used.items()) + "."
    parts = (_measurement(evidence), _model(evidence, step, titles), _selection(evidence, titles), software)
    return [part for part in parts if part]


def _measurement(evidence: Evidence) -> str:
    runs = [experiment for experiment in evidence.experiments if experiment.recording is not None]
    text = ""
    if evidence.camera:
        camera, quality = evidence.camera, evidence.camera.get("quality")
        note = str(quality.get("note") or "") if isinstance(quality, dict) else ""
        rms = camera.get("rms", camera.get("rms_px"))
        text += (
            f"Pixels were turned into millimetres by a {note}. "
            if note.startswith("scale")
            else (
                f"The camera ({camera.get('image_width')} x {camera.get('image_height')} pixels) was calibrated as a "
                f"{lens_words(camera.get('model'))} (Zhang 2000); the root mean square reprojection error was "
                f"{number(rms)} pixels. "
            )
        )
    if runs:
        names = listing(f"{run.name} ({_ROLES.get(run.role, run.role)})" for run in runs)
        text += f"The runs were {names}. "
        methods_used = sorted(
            {str(run.recording.attrs.get("sync_method", "")) for run in runs if run.recording is not None} - {""}
        )
        if methods_used:
            other = "Camera" if evidence.camera else "Track"
            text += f"{other} and pressure log were brought onto one clock by {listing(SYNC_METHODS.get(m, m) for m in methods_used)}. "
    logged = [str(run.recording["pressure"].attrs.get("long_name", "")) for run in runs if run.recording is not None]
    if any(name.startswith("tension") for name in logged):
        text += f"What was logged is the tension of a tendon: {TENSION_kPa:g} kPa of pressure stand for 1 N in every figure and table. "
    if any(run.recording is not None and "edges" in run.recording for run in runs):  # else it came with a track
        text += "The centre line was taken from the two sides of the silhouette, with a standard error at every node. "
    return text.strip()


def _model(evidence: Evidence, step: LadderStep, titles: Mapping[str, str]) -> str:
    fit, shown = step.fit, errors_of(step, evidence)
    effects = f" with {listing(inner_title(titles[effect]) for effect in fit.effects)} added" if fit.effects else ""
    words = parameter_words(evidence, titles)
    values = "; ".join(f"{name} ({words[name]}) = {_estimate(parameter)}" for name, parameter in fit.told.items())
    key = "tip_rmse_mm" if shown.unit == "mm" else "angle_rmse_deg"
    scores = listing(
        f"{with_unit(getattr(metrics, key), shown.unit)} ({_ROLES.get(role, role)})"
        for role, metrics in fit.metrics.items()
        if getattr(metrics, key) is not None
    )
    text = (
        f"The motion was modelled by the rigid-segment chain with spring-damper joints of Momeni Kelageri et al. "
        f"(2018){effects}, with {counted(fit.segments, 'segment')} (joints at the {fit.joints} of their arc), fitted to the "
        f"{_OBSERVED.get(fit.observe, fit.observe)} of the training runs by {_LOSSES.get(fit.loss or '', 'least squares')}. "
        f"The fitted values were {values} (standard errors)."
    )
    if scores:
        text += f" The root mean square {shown.what.lower()} was {scores}"
        text += f"; the noise floor was {with_unit(shown.floor, shown.unit)}." if shown.floor is not None else "."
    return text


def _estimate(parameter: Parameter) -> str:
    if parameter.fixed:
        return f"{with_unit(parameter.value, parameter.unit, 4)} (fixed)"
    return with_error(parameter.value, parameter.stderr, parameter.unit, 4)


def _selection(evidence: Evidence, titles: Mapping[str, str]) -> str:
    if not evidence.ladder:
        return ""
    grown = dict.fromkeys(rung.added for rung in evidence.ladder.rungs if rung.added and rung.added != "segments")
    added = [inner_title(titles[effect]) for effect in grown]
    finer = sum(rung.added == "segments" for rung in evidence.ladder.rungs)
    chosen = (
        f"In this way {listing(added)} {'was' if len(added) == 1 else 'were'} added. " if added else "None was added. "
    )
    chosen += f"The chain was made finer {'once' if finer == 1 else f'{finer} times'}, as the critique asked. " if finer else ""
    for step in evidence.steps:
        if step.on_ladder and step.rung.added and step.rung.tied:
            one, *others = (inner_title(titles.get(effect, effect)) for effect in (step.rung.added, *step.rung.tied))
            chosen += f"These data cannot tell {one} from {listing(others, 'or')}. "
    held = any(run.role == "validate" for run in evidence.experiments)
    runs, error = ("training and on held-out runs", "held-out error") if held else ("the training runs (none was held out)", "error")
    text = (
        f"Effects were added one at a time. Sets of up to four of them were weighed by the squared error that they leave on {runs}, "
        "under a model that admits a structured remainder (Kennedy and O'Hagan 2001), against "
        "prior odds of one effect among those of the catalogue. An effect was accepted if its probability was a half at least and "
        f"it lowered the {error} by at least 10 % and by at least 0.2 noise floors with physically admissible values. "
        f"{chosen}"
    )
    helping = [
        inner_title(titles[rung.added]) for rung in evidence.ladder.rungs if rung.added and rung.grade == "stand-in"
    ]
    if helping:
        text += f"Not so {listing(helping)}: added because the held-out error falls, not as a likely cause. "
    if evidence.ladder.test:
        text += "Test runs took no part in fitting or choosing and were scored once, at the end."
    return text.strip()
