"""Hints tried out on the first seconds of a film: the track appears over the picture while it is made."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts.reasons import reason_of
from rfea_vision.calibration.projection import camera_vector, project
from rfea_vision.campaign import ExperimentSpec
from rfea_vision.errors import DataError, InputError
from rfea_vision.readers.source import open_source
from rfea_vision.readers.video import FrameSource, Luma
from rfea_vision.stages import open_campaign
from rfea_vision.stages.measurement import follow
from rfea_vision.vision.scene import matched_to
from rfea_vision.vision.show.clip import in_frame, rig_to_plane

#: The film is followed from its first frame in ever longer pieces, each the very track that `rfea track` would make of it: the
#: first is there at once, and all together cost one and a half times the last.
FIRST_FRAMES, LONGER = 24, 3


@dataclass(frozen=True)
class FirstFrames(FrameSource):
    """The first frames of another source."""

    whole: FrameSource = field(kw_only=True)
    count: int = field(kw_only=True)

    def times_s(self) -> np.ndarray:
        """Times (frames,) in s."""
        return self.whole.times_s()[: self.count]

    def frames(self, start_frame: int = 0) -> Generator[tuple[float, Luma], None, None]:
        """Frames up to the last of the beginning."""
        yield from itertools.islice(self.whole.frames(start_frame), max(self.count - start_frame, 0))

    def colours(self, scale: float = 1.0) -> Generator[tuple[float, NDArray[np.uint8]], None, None]:
        """The same in colour, by which a body is told from what hangs behind it."""
        yield from itertools.islice(self.whole.colours(scale), self.count)


def _corrected_before(experiment: ExperimentSpec, count: int) -> ExperimentSpec:
    """The experiment with those of its corrections that are among the first `count` frames."""
    assert experiment.camera is not None
    hints = experiment.camera.hints
    kept = tuple(later for later in hints.corrections if later.frame < count)
    return replace(experiment, camera=replace(experiment.camera, hints=replace(hints, corrections=kept)))


def try_hints(
    campaign: Path, out: str | None, say: Callable[[dict[str, Any]], None], *, name: str, seconds: float
) -> dict[str, Any]:
    """Follow the tube through the first seconds of one film with the hints that now stand in the files.

    Every piece is told as it is there: ``{"event": "tried", "name", "frames": [{"frame", "reason", "line"}, ...]}``, lines in
    pixels.

    Raises
    ------
    InputError, DataError
        As `rfea track` would; nothing is written but the calibration.
    """
    work = open_campaign(campaign, out)
    experiment = work.campaign.experiment(name)
    if experiment.video is None:
        raise InputError(f"{name}: has no pictures to point at")
    calibration = work.calibration_of(experiment).value
    source = open_source(experiment.video)
    times_s = source.times_s()
    total = int(np.searchsorted(times_s, times_s[0] + seconds))
    camera = camera_vector(matched_to(calibration, source))
    count, good, failure = FIRST_FRAMES, 0, ""
    while True:
        count = min(count, total)
        facts = source.path, source.size, count, source.rate_Hz
        piece = FirstFrames(*facts, quarter_turns=source.quarter_turns, whole=source, count=count)
        try:
            track = follow(_corrected_before(experiment, count), calibration, piece)
        except DataError as error:
            failure = str(error)
        else:
            failure = ""
            lines = in_frame(track, project(camera, rig_to_plane(track, track.dataset["midline"].values))).round(1)
            reasons = track.dataset["reason"].values.astype(str)
            frames = [
                {"frame": number, "reason": reason_of(str(reason)).words, "line": None if reason else line.tolist()}
                for number, (reason, line) in enumerate(zip(reasons, lines, strict=True))
            ]
            good = int(track.valid.sum())
            say({"event": "tried", "name": name, "frames": frames})
        if count >= total:
            break
        count *= LONGER
    if failure:
        raise DataError(failure)
    return {"frames": total, "good": good}
