"""From frame to frame: predict, fit, judge, and find the tube again where it was lost."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray, longest
from rfea_vision.vision.curve import VERTICES, point_and_tangent
from rfea_vision.vision.derive.markers import SAMPLES, has_texture, light_along
from rfea_vision.vision.derive.picture_errors import ORIGIN_PX
from rfea_vision.vision.edges import fitted
from rfea_vision.vision.edges.cap import CAP_VERTICES
from rfea_vision.vision.find.begin import Initialisation, Scene, begin, off_hints
from rfea_vision.vision.find.ends import end_candidates
from rfea_vision.vision.follow.bump import ENOUGH, CameraWatch
from rfea_vision.vision.follow.frame import fit_frame
from rfea_vision.vision.follow.judge import Judge
from rfea_vision.vision.follow.motion import CurvePredictor

CLAMP_REACH_MM, CLAMP_UNSEEN_MM = 5.0, 1.0  # how far around the clamp is looked for; how well it is known where it is not seen again
LEAST_GOOD = 3  # good frames before the first bad one that make a track: fewer may be anything that looks like a tube
SEARCH_ALL, SEARCH_EVERY = 48, 4  # the first frames are all searched for a tube, later ones now and then
COVERED_STEP = 0.3  # of the light step at the edges: by so much the light on the tube changes where something covers it
LEAST_CLAMPS = 4


@dataclass
class Follower:
    """Carries the tube's state from frame to frame."""

    scene: Scene
    state: fitted.State = field(init=False)  # from the first frame in which a tube is found on
    view: FloatArray = field(default_factory=lambda: np.eye(2, 3))  # from places in the first picture to those in the last: as they are

    def __post_init__(self) -> None:
        self.work = fitted.new_buffers()
        self.searched = 0  # frames looked through for a tube in vain
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Reset: nothing is known of the tube yet, or what was followed was not the tube."""
        self.start: Initialisation | None = None
        self.judge = Judge(self.scene)
        self.motion = CurvePredictor()
        self.missed = 0
        self.good = 0
        self.noise = 3.0  # of the last good frame, grey levels
        self.marked = True  # until the first frames say otherwise
        self.first_profiles: list[FloatArray] = []
        self.profile: FloatArray | None = None  # light along the tube in the last good frame
        self.material: dict[float, tuple[float, float]] = {}  # single marks belong to the body: see `BodyFollower`
        self.clamp_errors: list[float] = []
        self.clamps: list[FloatArray] = []  # where the tube begins, seen again in each of the first frames
        self.watch: CameraWatch | None = None
        self._seen: NDArray[np.uint8] | None = None  # the picture of the last good frame

    def next(self, luma: NDArray[np.uint8], time_s: float) -> str:
        """Fit one frame; returns an empty string, or the reason why it is rejected."""
        if self.start is None:
            reason = self._find(luma)
            if reason:
                return reason
        shot = self.scene.shot(luma)
        if self.judge.repeated(shot) and self.motion.step_mm(time_s) * self.scene.px_per_mm > 0.5:  # a copy written by the recorder
            return "duplicate"
        self._brighten(self.judge.brightening(shot))
        reason = self._fit_predicted(shot, time_s)
        start = np.array([point_and_tangent(self.state.coefficients, 0.0)[:2]])
        reason = reason or off_hints(start, self.scene)
        if self.good and reason not in ("", "width_off"):  # a tube that is found, but has the wrong width, is not looked for
            again = self._find_again(luma)
            reason = again if again in ("", "blurred") else reason
        if reason:
            self.missed += 1
            reason = self._explained(reason, luma)
            self.state.coefficients[:] = self.motion.last
            if self.good < LEAST_GOOD:
                self.searched += 1
                self._begin_anew()  # a tube that enters later than what was taken for one
            return reason
        self._accept(time_s)
        self._seen = luma
        self._read_marks(luma)
        if self.good <= ENOUGH:
            self._look_at_clamp(luma)
        else:
            self._watch_camera(luma)
        return ""

    @property
    def moved_mm(self) -> FloatArray:
        """By how much the camera's view of the plane has moved since the first frames (2,)."""
        return self.watch.moved_mm if self.watch is not None else np.zeros(2)

    def _explained(self, reason: str, luma: NDArray[np.uint8]) -> str:
        """Where along the tube the edges were lost, on which side, and whether something stands in front there."""
        if reason not in ("edge_lost", "tip_hidden") or self._seen is None:
            return reason
        left, right = self.work.sections[0] > 0, self.work.sections[1] > 0
        run = longest(~(left & right)) or slice(len(left) - 1, len(left))
        ends = np.array([run.start, run.stop]) / len(left)
        sides = ("left", not left[run].any()), ("right", not right[run].any())
        side = " and ".join(name for name, gone in sides if gone) or "one"
        looks = self._looks(luma, ends)
        where = "{:.0f} to {:.0f} mm from the clamp".format(*(ends * self.scene.length_mm))
        if not looks and reason == "edge_lost":
            return f"occluded: neither the tube nor what is beside it is seen, {where}"
        looks = looks or "neither the tube nor what is beside it is seen there"
        return f"{reason}: no edge on the {side} side, {where}; {looks}"

    def _looks(self, luma: NDArray[np.uint8], ends: FloatArray) -> str:
        """What the light between two places `ends` (shares of the length) is: the tube's, or of what is beside it; else empty."""
        assert self._seen is not None
        now, before = (self._light_along(picture, self.motion.last) for picture in (luma, self._seen))
        part = slice(int(ends[0] * SAMPLES), max(int(ends[1] * SAMPLES), int(ends[0] * SAMPLES) + 4))
        limit = max(COVERED_STEP * abs(float(np.median(self.state.reference[:2]))), 6.0 * self.noise)
        at, vertices = np.linspace(0.0, 1.0, SAMPLES), np.linspace(0.0, 1.0, VERTICES)
        left, right = (np.interp(at, vertices, side[:, 1]) for side in self.state.levels[:2])
        alike = np.abs(now - [before, left, right])[:, part] <= limit
        if alike[0].mean() >= 0.5:
            return "the tube itself looks as before"
        return "what is beside the tube is seen in its place" if alike.any(axis=0).mean() >= 0.5 else ""

    def _find(self, luma: NDArray[np.uint8]) -> str:
        """Search the whole picture for a tube to begin with; the reason where there is none."""
        if self.searched > SEARCH_ALL and self.searched % SEARCH_EVERY:
            self.searched += 1
            return "no_tube"
        found = begin(luma, self.scene, self.work)
        if isinstance(found, str):
            self.searched += 1
            return found
        self.start, self.state = found, found.state
        self.motion.begin(found.state.coefficients)
        return ""

    def _brighten(self, gain: float) -> None:
        """Scale what the light is expected to be; the sums of a frame then correct the rest."""
        self.state.levels[:] *= gain
        self.state.reference[:] *= gain

    def _read_marks(self, luma: NDArray[np.uint8]) -> None:
        """The light along the tube, as long as the first frames show marks in it."""
        if not self.marked:
            return
        self.profile = self._light_along(luma, self.state.coefficients)
        if self.good <= LEAST_GOOD:
            self.first_profiles.append(self.profile)
        if self.good == LEAST_GOOD:
            self.marked = has_texture(np.array(self.first_profiles), float(np.median(self.state.reference[:2])))

    def _light_along(self, luma: NDArray[np.uint8], coefficients: FloatArray) -> FloatArray:
        return light_along(luma, self.scene.camera, coefficients, float(np.mean(self.state.width)))

    def _clamp_in(self, luma: NDArray[np.uint8]) -> tuple[FloatArray, float] | None:
        """Where the tube begins in this frame, and its standard error along the tube; None where it is not seen."""
        half = float(self.work.numbers["width"][0]) / 2
        contrast = float(np.median(self.state.reference[:2]))
        curve = self.scene.camera, self.state.coefficients
        seen = end_candidates(luma, *curve, half, contrast, at_tip=False, reach_mm=CLAMP_REACH_MM)
        steps = [(clear, end) for end, clear in seen if end.kind == "step"]
        if not steps:
            return None
        _, end = max(steps, key=lambda pair: pair[0])
        start = point_and_tangent(self.state.coefficients, 0.0)
        return np.array(start[:2]) - end.along_mm * np.array(start[2:4]), end.stderr_mm

    def _look_at_clamp(self, luma: NDArray[np.uint8]) -> None:
        """The clamp does not move: average where it is seen in the first frames."""
        assert self.start is not None
        seen = self._clamp_in(luma) if self.start.base.kind == "step" else None
        if seen is None:
            return
        clamp = self.state.clamp
        self.clamps.append(seen[0])
        self.clamp_errors.append(seen[1])
        middle = np.median(self.clamps, axis=0)
        clamp[:2] += float((middle - clamp[:2]) @ clamp[2:]) * clamp[2:]

    def _watch_camera(self, luma: NDArray[np.uint8]) -> None:
        """Follow a clamp that is elsewhere and stays there: it was the camera that moved."""
        if self.watch is None:
            if len(self.clamps) < LEAST_CLAMPS:
                return
            self.watch = CameraWatch(np.array(self.clamps), self.scene.px_per_mm)
        clamp = self.state.clamp
        start = np.array(point_and_tangent(self.state.coefficients, 0.0)[:2])
        if self.watch.due(start, clamp[2:], self.good):
            seen = self._clamp_in(luma)
            if self.watch.see(None if seen is None else seen[0]):
                clamp[:2] = self.watch.now

    def clamp_stderr_mm(self) -> tuple[float, float | None]:
        """Standard error of the clamp along the tube, from how its places scatter and how its strips disagree.

        Beside it the scatter of its place from frame to frame; None where it was not seen again, or was given.
        """
        assert self.start is not None
        first = self.start.base.stderr_mm
        if len(self.clamps) < LEAST_CLAMPS:
            # A clamp that was taken from a step in the light, and is not seen there again, may be anything near it.
            return (max(first, CLAMP_UNSEEN_MM) if self.start.base.kind == "step" and self.good > 8 else first), None
        along = np.array(self.clamps) @ self.state.clamp[2:]
        scatter = float(along.std())
        # What all frames share (a shadow, a rough edge) does not average out.
        shared = max(float(np.median(self.clamp_errors)), ORIGIN_PX / self.scene.px_per_mm)
        return float(np.hypot(1.25 * scatter / np.sqrt(len(along)), shared)), scatter

    def _fit_predicted(self, shot: fitted.Shot, time_s: float) -> str:
        saved = [array.copy() for array in self.state]
        if self.missed or not self.good:
            return self._fit(shot, saved)
        self.motion.predict(time_s, self.state.coefficients)
        reason = self._fit(shot, saved)
        return reason and self._fit(shot, saved) and reason  # again from where it was last: a prediction may lead astray

    def _fit(self, shot: fitted.Shot, saved: list[FloatArray]) -> str:
        """Fit a frame from the state as it is; where it is rejected, the state is as it was `saved`."""
        gain = 0.3 if self.good < ENOUGH else 0.02
        self.work.numbers.view(np.float64).fill(0.0)
        fit_frame(shot, self.state, self.work, gain, self.noise)
        reason = self.judge(shot, self.work.numbers[0])
        if reason:
            for array, old in zip(self.state, saved, strict=True):
                array[:] = old
        return reason

    def _find_again(self, luma: NDArray[np.uint8]) -> str:
        """Search the whole picture; the clamp must be where it was."""
        if self.missed > 4 and self.missed % 10:  # a search of the whole picture takes long
            return "no_tube"
        found = begin(luma, replace(self.scene, hints=replace(self.scene.hints, tip=None, centre_line=())), self.work)
        if isinstance(found, str):
            return found
        if np.linalg.norm(found.state.clamp[:2] - self.state.clamp[:2]) > 4.0:
            return "no_tube: another tube"
        saved = [array.copy() for array in self.state]
        self.state.coefficients[:] = found.state.coefficients
        return self._fit(self.scene.shot(luma), saved)

    def _accept(self, time_s: float) -> None:
        if self.missed:
            self.motion.forget()
        self.motion.follow(self.state.coefficients, time_s)
        self.noise = float(self.work.numbers["noise"][0])
        self.missed = 0
        self.good += 1
        if self.good == LEAST_GOOD:
            self.state.reference[:2] = self.state.levels[:2, :, 0] - self.state.levels[:2, :, 1]
            self.state.reference[2] = np.diff(self.state.levels[2, :CAP_VERTICES].mean(axis=0))[0] * -1.0
