"""The sentences of the page: what was found, and the text for a methods section, all from artefacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from rfea_vision.artefacts import Parameter
from rfea_vision.report.collect import Evidence, Step
from rfea_vision.report.formatting import listing, number, with_unit

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
}"""

# The tiles give the noise floor and the diagnosis tells why the search ended: once is enough.
_SAID_ELSEWHERE = ("The noise floor is", "Stopped because")

_PACKAGES = (
    "rfea-vision",
    "numpy",
    "scipy",
    "numba",
    "sympy",
    "xarray",
    "opencv-contrib-python-headless",
    "av",
    "scikit-image",
)


@dataclass(frozen=True)
class Finding:
    """One sentence, and the section that holds its evidence."""

    text: str
    section: str
    link: str


@dataclass(frozen=True)
class Tile:
    """A number worth a large type: ``before`` is struck through beside it where there is one."""

    heading: str
    value: str
    before: str = ""
    note: str = ""
    section: str = ""


def versions() -> dict[str, str]:
    """Installed versions of the packages that made the artefacts."""
    found = {}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def effect_titles(evidence: Evidence) -> dict[str, str]:
    """Effect id -> title, from the laws of the models and the candidates; else the id in words."""
    titles: dict[str, str] = {}
    for step in evidence.steps:
        for candidate in step.diagnosis.candidates if step.diagnosis else []:
            named = (candidate.model_extra or {}).get("title")
            titles[candidate.effect] = str(named) if named else titles.get(candidate.effect, _words(candidate.effect))
        named_effects = [*(step.diagnosis.named if step.diagnosis else []), *step.fit.effects, step.rung.added or ""]
        for effect in named_effects:
            titles.setdefault(effect, _words(effect))
    for step in evidence.steps:
        titles |= {effect: law["title"] for effect, law in step.fit.laws.items() if law.get("title")}
    return titles


def _words(effect: str) -> str:
    text = effect.replace("_", " ")
    return text[:1].upper() + text[1:]


def last_step(evidence: Evidence) -> Step | None:
    """The top rung of the ladder, or the last model fitted."""
    climbed = [step for step in evidence.steps if step.on_ladder]
    return (climbed or list(evidence.steps) or [None])[-1]


def headline(evidence: Evidence, titles: Mapping[str, str]) -> str:
    """The verdict as one sentence."""
    step = last_step(evidence)
    if step is None:
        return "The motion is measured; no model has been fitted yet."
    diagnosis = step.diagnosis
    added = [_lower(titles[effect]) for effect in _added(evidence)]
    if diagnosis is None:
        return "The model is fitted; what it lacks has not been looked for yet."
    if diagnosis.verdict == "complete":
        if not added:
            return "The model of the paper is complete here: nothing that matters is missing."
        if len(added) == 1:
            return f"The model of the paper lacked one thing: {added[0]}. With it, nothing that matters is missing."
        things = "; ".join(added)
        return (
            f"The model of the paper lacked {len(added)} things: {things}. With them, nothing that matters is missing."
        )
    if diagnosis.verdict == "unexplained":
        return "Something is missing that no effect in the catalogue explains."
    named = [_lower(titles[effect]) for effect in diagnosis.named]
    return f"The model still lacks something: {'; '.join(named)}." if named else "The model still lacks an effect."


def _added(evidence: Evidence) -> list[str]:
    return [rung.added for rung in evidence.ladder.rungs if rung.added] if evidence.ladder else []


def _lower(title: str) -> str:
    """A title inside a sentence, without what follows its colon."""
    head = title.split(":")[0].strip()
    return head if head[:2].isupper() else head[:1].lower() + head[1:]


def findings(evidence: Evidence) -> Iterator[Finding]:
    """What the artefacts say in sentences, each with the place of its evidence."""
    step = last_step(evidence)
    if evidence.ladder:
        for sentence in evidence.ladder.findings:
            if not sentence.startswith(_SAID_ELSEWHERE):
                yield Finding(sentence, "ladder", "ladder")
    if step and step.diagnosis and step.diagnosis.sentence:
        yield Finding(step.diagnosis.sentence, "why", "evidence")
    first = evidence.steps[0] if evidence.steps else None
    if first and first.comparison:
        for sentence in first.comparison.sentences[:2]:
            yield Finding(f"{_stop(sentence)}", "where", "where")
    if step and step.comparison and step.comparison.elongation.get("sentence"):
        yield Finding(str(step.comparison.elongation["sentence"]), "elongation", "elongation")
    if evidence.ladder and evidence.ladder.stopped_because and not (step and step.diagnosis):
        yield Finding(f"The search ended: {evidence.ladder.stopped_because}", "ladder", "ladder")
    for reason in evidence.absent.values():
        yield Finding(reason, "trust", "")


def _stop(sentence: str) -> str:
    return sentence if sentence.endswith((".", "!", "?")) else f"{sentence}."


def tiles(evidence: Evidence, titles: Mapping[str, str]) -> Iterator[Tile]:
    """The few numbers that a reader takes away."""
    step = last_step(evidence)
    ladder = evidence.ladder
    if ladder and ladder.rungs:
        added = [titles[effect].split(":")[0] for effect in _added(evidence)]
        note = "added to the model of the paper" if added else "nothing had to be added"
        yield Tile("Missing physics", "; ".join(added) or "None found", note=note, section="why")
        held_out = [rung.validate_tip_rmse_mm for rung in ladder.rungs]
        rows = held_out if held_out[0] is not None else [rung.train_tip_rmse_mm for rung in ladder.rungs]
        which = "held-out" if held_out[0] is not None else "training"
        yield Tile(
            f"Tip error, {which} runs", with_unit(rows[-1], "mm"), number(rows[0]) if len(rows) > 1 else "",
            "root mean square", "ladder",
        )  # fmt: skip
        test = ladder.test or {}
        if test.get("tip_rmse_mm") is not None:
            first = number(test.get("first_model_tip_rmse_mm")) if len(rows) > 1 else ""
            yield Tile(
                "Tip error, test run", with_unit(test["tip_rmse_mm"], "mm"), first, "scored once, at the end", "ladder"
            )
    elif step:
        for role, heading in (("train", "training"), ("validate", "held-out")):
            metrics = step.fit.metrics.get(role)
            if metrics:
                note = metrics.notes.get("tip_rmse_mm", "root mean square")
                yield Tile(
                    f"Tip error, {heading} runs", with_unit(metrics.tip_rmse_mm, "mm"), note=note, section="ladder"
                )
    if step and step.fit.noise_floor_mm is not None:
        source = f"from {step.fit.noise_floor_source}" if step.fit.noise_floor_source else "no model can do better"
        yield Tile("Noise floor", with_unit(step.fit.noise_floor_mm, "mm"), note=source, section="trust")


def methods(evidence: Evidence, step: Step) -> list[str]:
    """Paragraphs for a methods section, about the model of `step`."""
    paragraphs = [part for part in (_measurement(evidence), _model(step), _selection(evidence), _software()) if part]
    return paragraphs


def _measurement(evidence: Evidence) -> str:
    runs = [experiment for experiment in evidence.experiments if experiment.recording is not None]
    text = ""
    if evidence.camera:
        camera = evidence.camera
        rms = camera.get("rms", camera.get("rms_px"))
        text += (
            f"The camera ({camera.get('image_width')} x {camera.get('image_height')} pixels) was calibrated with "
            "the lens model "
            f"{camera.get('model', 'of OpenCV')} (Zhang 2000); the root mean square reprojection error was "
            f"{number(rms)} pixels. "
        )
    if runs:
        names = listing(f"{run.name} ({run.role})" for run in runs)
        text += f"The runs were {names}. "
        methods_used = sorted(
            {str(run.recording.attrs.get("sync_method", "")) for run in runs if run.recording is not None} - {""}
        )
        if methods_used:
            text += f"Camera and pressure log were brought onto one clock by {listing(methods_used)}. "
    if any(run.recording is not None and "midline" in run.recording for run in runs):
        text += "The centre line was taken from the two sides of the silhouette, with a standard error at every node. "
    return text.strip()


def _model(step: Step) -> str:
    fit = step.fit
    effects = f" with {listing(effect.replace('_', ' ') for effect in fit.effects)} added" if fit.effects else ""
    values = "; ".join(f"{name} = {_estimate(parameter)}" for name, parameter in fit.parameters.items())
    scores = listing(
        f"{with_unit(metrics.tip_rmse_mm, 'mm')} ({role})"
        for role, metrics in fit.metrics.items()
        if metrics.tip_rmse_mm is not None
    )
    text = (
        f"The motion was modelled by the rigid-segment chain with spring-damper joints of Momeni Kelageri et al. "
        f"(2018){effects}, "
        f"with {fit.segments} segments (joints at the {fit.joints} of their arc), fitted to the "
        f"{fit.observe.replace('_', ' ')} of the "
        f"training runs by least squares. The fitted values were {values} (standard errors)."
    )
    if scores:
        text += f" The root mean square tip error was {scores}"
        text += (
            f"; the noise floor was {with_unit(fit.noise_floor_mm, 'mm')}." if fit.noise_floor_mm is not None else "."
        )
    return text


def _estimate(parameter: Parameter) -> str:
    text = with_unit(parameter.value, parameter.unit, 4)
    if parameter.fixed:
        return f"{text} (fixed)"
    return f"{text} ± {with_unit(parameter.stderr, parameter.unit, 2)}" if parameter.stderr else text


def _selection(evidence: Evidence) -> str:
    if not evidence.ladder:
        return ""
    added = _added(evidence)
    chosen = (
        f"In this way {listing(added)} {'was' if len(added) == 1 else 'were'} added. " if added else "None was added. "
    )
    text = (
        "Effects were added one at a time. One was accepted if it lowered the error on the held-out runs by at "
        "least 10 % and by at "
        f"least 0.2 noise floors with physically admissible values; the Bayesian information criterion (Schwarz "
        f"1978) is given beside it. {chosen}"
    )
    if evidence.ladder.test:
        text += "Test runs took no part in fitting or choosing and were scored once, at the end."
    return text.strip()


def _software() -> str:
    return "Software: " + ", ".join(f"{name} {number_}" for name, number_ in versions().items()) + "."
