"""Warnings about a track or recording: sentences that its file holds, told once in a session."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

from rfea_vision.artefacts import Recording, Track
from rfea_vision.artefacts.reasons import reason_of
from rfea_vision.campaign import ExperimentSpec, following, plausibility, repeats
from rfea_vision.campaign.sensors import of_pauses, of_standstill
from rfea_vision.campaign.tracked import motion_of
from rfea_vision.campaign.tubes import modulus_of, of_moduli, of_tube

if TYPE_CHECKING:
    import xarray as xr

    from rfea_vision.arrays import FloatArray
    from rfea_vision.readers.pressure import PressureLog
    from rfea_vision.stages.runner import Runner
    from rfea_vision.stages.stored import Stored

#: With less than this share of its frames measured, a run is not what was asked for.
LEAST_MEASURED = 0.5


def reasons_of(track: Track) -> dict[str, int]:
    """Count the rejected frames by reason, most frequent first."""
    return dict(Counter(str(reason) for reason in track.dataset["reason"].values[~track.valid]).most_common())


def few_frames(track: Track) -> str:
    """A sentence where too little of a run was measured; empty else."""
    reasons = reasons_of(track)
    # A copy of the frame before tells nothing, nor anything against the film.
    frames = len(track.time_s) - reasons.pop("duplicate", 0)
    measured = int(track.valid.sum())
    if measured >= LEAST_MEASURED * frames:
        return ""
    reason, count = next(iter(reasons.items()))
    return f"only {measured} of {frames} frames were measured ({count} {reason}); {reason_of(reason).remedy}"


def warnings_of(measured: Track | Recording) -> list[str]:
    """Every doubt that a track or recording carries, each as a sentence."""
    found = [few_frames(measured)] if isinstance(measured, Track) else []
    return [*filter(None, found), *_written(measured.dataset, after_sync=isinstance(measured, Recording))]


def log_doubts(log: PressureLog, seen_s: FloatArray) -> list[str]:
    """Doubts about how a log is declared, by itself and beside the times (frames,) of a track."""
    return plausibility.of_pressure(log) + plausibility.of_times(log.time_s, seen_s)


def misdeclared(log: PressureLog, seen_s: FloatArray) -> list[str]:
    """Those of them that keep it from being used: a stretch in which its rows stand still, or are missing, does not."""
    passing = {*of_standstill(log.pressure_kPa), *of_pauses(log.time_s)}
    return [text for text in log_doubts(log, seen_s) if "?" in text and text not in passing]


def log_warnings(
    experiment: ExperimentSpec, recording: Recording, log: PressureLog, own_s: FloatArray | None = None
) -> dict[str, str]:
    """These, and doubts whether the log is that of the run, as an attribute of the recording; `own_s` as in `following.of_pair`."""
    seen_s = recording.time_s
    data, value_s = recording.dataset, experiment.sync.value if experiment.sync.method == "offset" else None
    turned = following.of_sign(data, seen_s, log.time_s, log.pressure_kPa, value_s)
    said = log_doubts(log, seen_s) or ([turned] if turned else []) or following.of_pair(
        data, seen_s, log.time_s, log.pressure_kPa, log.pushes_kPa, own_s, held=experiment.rig.held
    )
    return {"pressure_doubts": "; ".join(f"pressure: {text}" for text in said)} if said else {}


def say_warnings(work: Runner, experiment: ExperimentSpec, measured: Track | Recording) -> None:
    """Say every doubt that a track or recording carries, once in a session."""
    for doubt in warnings_of(measured):
        work.tell(f"warning: {experiment.name}: {doubt}")


def warn_of_copies(
    work: Runner, about: Sequence[ExperimentSpec], motions: Mapping[str, FloatArray] = MappingProxyType({})
) -> None:
    """Warn where the film, track, log or motion (rows, columns) of one of these runs is that of another run, too."""
    for experiment, key, text in repeats.alike(work.active(), motions):
        if experiment in about or any(f"'{item.name}'" in text for item in about):
            work.tell(f"warning: {experiment.name}: {key} {text}")


def warn_of_fitted(work: Runner, recordings: Mapping[str, Stored[Recording]]) -> None:
    """Say what makes one doubt the runs that a model is fitted to."""
    experiments = [work.campaign.experiment(name) for name in recordings]
    for tube in dict.fromkeys(item.actuator for item in experiments):
        for key, text in of_tube(tube):
            work.tell(f"warning: actuator.{key}: {text}")
    lines = {name: repeats.line_of(item.value.dataset) for name, item in recordings.items()}
    responses, moduli = dict[str, plausibility.Response](), list[float | None]()
    for experiment in experiments:
        recording = recordings[experiment.name].value
        say_warnings(work, experiment, recording)
        if not experiment.pressure.constant and not recording.dataset.attrs.get("pressure_doubts"):
            data, pressure_kPa = recording.dataset, recording.dataset["pressure"].values
            moved = plausibility.response(data, pressure_kPa)
            responses |= {} if moved is None else {experiment.name: moved}
            moduli.append(modulus_of(data, pressure_kPa, experiment.actuator, experiment.rig.gravity_deg))
    if text := of_moduli(moduli):
        work.tell(f"warning: pressure: {text}")
    for experiment in experiments:
        if text := plausibility.of_response(experiment.name, responses):
            work.tell(f"warning: {experiment.name}: pressure: {text}")
        if text := repeats.of_line(experiment.name, lines):
            work.tell(f"warning: {experiment.name}: track: {text}")
    warn_of_copies(work, experiments, {name: motion_of(item.value.dataset)[0] for name, item in recordings.items()})


#: Attributes of a track and its recording that may hold a doubt about the run itself, and not about how it was brought on one clock.
DOUBTS = ("doubts", "length_check", "pressure_doubts")


def is_doubt(attribute: str, text: str) -> bool:
    """Whether one of `DOUBTS` needs attention: every film has a check of its length, which holds a remedy only where it fails."""
    return bool(text) and (attribute != "length_check" or ": " in text)


def _written(dataset: xr.Dataset, *, after_sync: bool) -> list[str]:
    """Sentences among the attributes that ask for something to be done."""
    length = str(dataset.attrs.get("length_check", ""))
    length = length if is_doubt("length_check", length) else ""
    if after_sync:
        from rfea_vision.sync.motion import REMARKS

        notes = str(dataset.attrs.get("sync_notes", "")).split("; ")
        clock = "; ".join(note for note in notes if note not in REMARKS)
        said = [dataset.attrs.get("doubts", ""), length, clock, dataset.attrs.get("pressure_doubts", "")]
    else:
        said = [dataset.attrs.get("doubts", ""), length]
    return [str(text) for text in said if text]
