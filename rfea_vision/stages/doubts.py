"""What a measurement says against itself: sentences that its file holds, said once where people look."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from rfea_vision.artefacts import Recording, Track

if TYPE_CHECKING:
    import xarray as xr

#: With less than this share of its frames measured, a run is not what was asked for.
LEAST_MEASURED = 0.5

_REMEDIES = {
    "no_tube": "check actuator.outer_radius and the board's square, or give camera.clamp and camera.tip in pixels",
    "occluded": "keep the view free, or give camera.clamp and camera.tip in pixels",
    "blurred": "use a shorter exposure, more light, or a sharper focus",
    "width_off": "check actuator.outer_radius and the board's square",
    "length_off": "check actuator.length and the board's square",
    "touches_border": "keep all of the tube in the picture",
    "tip_hidden": "keep the free end in view",
    "no_fit": "look at the preview; a calmer background helps",
    "not_tracked": "the rows without numbers in the track's file are left out",
}


def reasons_of(track: Track) -> dict[str, int]:
    """Count the rejected frames by reason, most frequent first."""
    return dict(Counter(str(reason) for reason in track.dataset["reason"].values[~track.valid]).most_common())


def few_frames(track: Track) -> str:
    """A sentence where too little of a run was measured; empty else."""
    frames, measured = len(track.time_s), int(track.valid.sum())
    if measured >= LEAST_MEASURED * frames:
        return ""
    reason, count = next(iter(reasons_of(track).items()))
    remedy = _REMEDIES.get(reason, "'rfea track --preview' shows what was seen")
    return f"only {measured} of {frames} frames were measured ({count} {reason}); {remedy}"


def doubts_of(measured: Track | Recording) -> list[str]:
    """Every doubt that a track or recording carries, each as a sentence."""
    found = [few_frames(measured)] if isinstance(measured, Track) else []
    return [*filter(None, found), *_written(measured.dataset, after_sync=isinstance(measured, Recording))]


def _written(dataset: xr.Dataset, *, after_sync: bool) -> list[str]:
    """Sentences among the attributes; a remark with nothing to do about it is no doubt."""
    if after_sync:
        return [str(dataset.attrs["sync_notes"])] if dataset.attrs.get("sync_notes") else []
    length = str(dataset.attrs.get("length_check", ""))
    return [length] if ": " in length else []
