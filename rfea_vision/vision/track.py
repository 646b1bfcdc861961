"""The tube in every frame: `track_frames`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.artefacts import Actuator, Calibration, Track
from rfea_vision.calibration.projection import camera_vector, has_plane, unproject
from rfea_vision.errors import DataError, InputError
from rfea_vision.readers.video import FrameSource
from rfea_vision.vision import fitted
from rfea_vision.vision.begin import Begin, Scene, begin, scale_at
from rfea_vision.vision.cap import CAP_VERTICES
from rfea_vision.vision.checkpoint import Checkpoint
from rfea_vision.vision.coarse import bend_search
from rfea_vision.vision.curve import point_and_tangent
from rfea_vision.vision.ends import End, find_end
from rfea_vision.vision.follow import fit_frame
from rfea_vision.vision.judge import Judge
from rfea_vision.vision.markers import SAMPLES, has_texture, light_along
from rfea_vision.vision.rows import Rows
from rfea_vision.vision.shape import build_dataset

FloatArray = NDArray[np.float64]
Progress = Callable[[int, int], None] | None

SEARCH_PX = 12.0
WIDEST_SWING_RAD = 1.2  # more bend or less than in the last frame seen
FIRST_FRAMES = 30  # frames in which the shape of the tube's end is learned fast
GIVE_UP_AFTER = 400  # frames without any tube before the search is called off


def track_frames(
    source: FrameSource,
    calibration: Calibration,
    actuator: Actuator,
    *,
    vertical: str | dict[str, Any] = "board",
    clamp_px: Sequence[Sequence[float]] | None = None,
    tip_px: Sequence[float] | None = None,
    lamp_box: Sequence[float] | None = None,
    nodes: int = 33,
    segments: int = 16,
    checkpoint: Path | None = None,
    progress: Progress = None,
) -> Track:
    """Track the tube through a video.

    Parameters
    ----------
    source : frames with their times
    calibration : lens and plane of motion, for pictures of the same shape
    actuator : outer radius and length predict how wide and how long the tube looks
    vertical : ``board``, ``rest``, ``image`` or ``{"plumb": [[x, y], [x, y]]}`` in px
    clamp_px : two pixels across the first visible cross-section in the first frame; replaces the search
    tip_px : pixel of the tip in the first frame, for scenes with several tubes
    lamp_box : x, y, width and height in px of a lamp whose brightness is to be read in every frame
    nodes, segments : nodes of the centre line, and segments of the elongation
    checkpoint : file that keeps what is done; an interrupted run goes on from it and ends with the same result
    progress : called with (frames done, frames in all)

    Returns
    -------
    Track
        One row per frame; see `rfea_vision.artefacts.Track`. Attributes name the clamp in px and how it was found.

    Raises
    ------
    InputError
        If the calibration has no plane or belongs to pictures of another shape.
    DataError
        If no tube is found anywhere.
    """
    calibration = matched_to(calibration, source)
    scene = make_scene(calibration, actuator, vertical, clamp_px, tip_px, source.size)
    lamp = lamp_window(lamp_box, source.size)
    follower = Follower(scene)
    rows = Rows(nodes, segments)
    kept = Checkpoint(checkpoint, source.path, scene, vertical, lamp_box, nodes, segments, scene.camera)
    begun = kept.load(rows, follower)
    total = source.frame_count or 0
    for done, (time_s, luma) in enumerate(source.frames(begun), begun):
        reason = follower.next(luma, time_s)
        rows.append(time_s, reason, follower, float(luma[lamp].mean()) if lamp is not None else np.nan)
        if follower.start is None and done >= GIVE_UP_AFTER:
            break
        kept.keep(rows, follower)
        if progress is not None and (done % 8 == 0 or done + 1 == total):
            progress(done + 1, max(total, done + 1))
    if len(rows) == 0:
        raise DataError(f"{source.path}: video.file holds no frame that can be read; record it again")
    if follower.start is None or not rows.any_valid:
        raise DataError(
            f"{source.path}: no tube found ({rows.commonest_reason}); give camera.clamp and camera.tip in pixels, "
            "or check actuator.outer_radius and actuator.length"
        )
    attributes = {
        "source": source.path.name,
        "clamp_found_by": follower.start.base.kind,
        "polarity": follower.start.polarity,
    }
    rows.marked = follower.marked and follower.good >= 3
    track = Track(build_dataset(rows, calibration, scene, follower.clamp_stderr_mm(), vertical, attributes))
    kept.remove()
    return track


def lamp_window(box: Sequence[float] | None, size: tuple[int, int]) -> tuple[slice, slice] | None:
    """Rows and columns of the lamp's box.

    Raises
    ------
    InputError
        If no pixel of the box lies in the picture.
    """
    if box is None:
        return None
    x, y, width, height = box
    columns = slice(max(round(x), 0), min(max(round(x + width), round(x) + 1), size[0]))
    lines = slice(max(round(y), 0), min(max(round(y + height), round(y) + 1), size[1]))
    if columns.start >= columns.stop or lines.start >= lines.stop:
        raise InputError(
            f"sync.led: the box {list(box)} lies outside the picture of {size[0]} x {size[1]} px; correct it"
        )
    return lines, columns


def matched_to(calibration: Calibration, source: FrameSource) -> Calibration:
    """The calibration for pictures of the source's size: the same, or scaled where the shape is the same."""
    if not has_plane(calibration):
        raise InputError("camera.plane is missing: give a photo of the board lying in the plane of motion")
    w, h = source.size
    if max(abs(w - calibration.image_width), abs(h - calibration.image_height)) <= 2:
        return calibration
    fx, fy = w / calibration.image_width, h / calibration.image_height
    if abs(fx / fy - 1) > 0.003:
        raise InputError(
            f"{source.path}: the video has {w} x {h} px, camera.photos have "
            f"{calibration.image_width} x {calibration.image_height}; calibrate in the video's camera mode"
        )
    matrix = calibration.camera_matrix.copy()
    matrix[0, 0] *= fx
    matrix[1, 1] *= fy
    matrix[0, 2] = (matrix[0, 2] + 0.5) * fx - 0.5
    matrix[1, 2] = (matrix[1, 2] + 0.5) * fy - 0.5
    factors = np.ones(calibration.intrinsics_covariance.shape[0])
    factors[:4] = fx, fy, fx, fy
    joint = calibration.joint_covariance
    if joint is not None:
        every = np.concatenate([factors, np.ones(joint.shape[0] - len(factors))])
        joint = joint * every[:, None] * every[None, :]
    return replace(
        calibration,
        image_width=w,
        image_height=h,
        camera_matrix=matrix,
        intrinsics_covariance=calibration.intrinsics_covariance * factors[:, None] * factors[None, :],
        joint_covariance=joint,
    )


def make_scene(
    calibration: Calibration,
    actuator: Actuator,
    vertical: str | dict[str, Any],
    clamp_px: Sequence[Sequence[float]] | None,
    tip_px: Sequence[float] | None,
    size: tuple[int, int],
) -> Scene:
    """Gather what is known before the first frame."""
    camera = camera_vector(calibration)
    clamp = None if clamp_px is None else np.asarray(clamp_px, dtype=float).reshape(-1, 2)
    tip = None if tip_px is None else np.asarray(tip_px, dtype=float).ravel()
    for name, hint in (("clamp", clamp), ("tip", None if tip is None else tip[None])):
        if hint is not None and (np.any(hint < 0) or np.any(hint > np.array(size))):
            raise InputError(f"camera.{name}: {hint.tolist()} lies outside the picture of {size[0]} x {size[1]} px")
    middle = np.array([size[0] / 2, size[1] / 2])
    px_per_mm = scale_at(camera, middle)
    if not np.isfinite(px_per_mm):
        raise InputError("camera.plane: the plane of motion is not in front of the camera; take the plane photo again")
    return Scene(camera, actuator, down_direction(camera, vertical, middle), px_per_mm, clamp, tip)


def down_direction(camera: FloatArray, vertical: str | dict[str, Any], middle_px: FloatArray) -> FloatArray:
    """Unit vector of gravity on the plane; for ``rest`` the board's, until the resting tube is known."""
    if isinstance(vertical, dict):
        plumb = np.asarray(vertical.get("plumb", []), dtype=float)
        if plumb.shape != (2, 2):
            raise InputError(
                "camera.vertical.plumb: give two points in pixels, such as {plumb: [[100, 50], [102, 900]]}"
            )
        top, bottom = plumb[np.argsort(plumb[:, 1])]
        line = unproject(camera, np.array([top, bottom]))
    elif vertical == "image":
        line = unproject(camera, np.array([middle_px, middle_px + np.array([0.0, 1.0])]))
    elif vertical in ("board", "rest"):
        return np.array([0.0, -1.0])
    else:
        raise InputError(f"camera.vertical: '{vertical}' is unknown; use board, rest, image or plumb")
    down = line[1] - line[0]
    return down / np.linalg.norm(down)


@dataclass
class Follower:
    """Carries the tube's state from frame to frame."""

    scene: Scene

    def __post_init__(self) -> None:
        self.work = fitted.new_workspace()
        self.start: Begin | None = None
        self.judge = Judge(self.scene)
        self.state: fitted.State | None = None
        self.last: FloatArray | None = None  # coefficients of the last good frame
        self.velocity: FloatArray | None = None  # mm per s
        self.last_time = 0.0
        self.missed = 0
        self.good = 0
        self.marked = True  # until the first frames say otherwise
        self.first_profiles: list[FloatArray] = []
        self.profile: FloatArray | None = None  # light along the tube in the last good frame
        self.clamp_errors: list[float] = []
        self.clamps: list[FloatArray] = []  # where the tube begins, seen again in each of the first frames

    def memory(self) -> dict[str, Any]:
        """Everything that the next frame depends on, for a checkpoint."""
        if self.start is None or self.state is None or self.last is None:
            return {"plain": {"found": False}}
        arrays: dict[str, Any] = {f"state.{name}": values for name, values in self.state._asdict().items()}
        arrays |= {"last": self.last, "clamps": np.array(self.clamps), "clamp_errors": np.array(self.clamp_errors)}
        if self.velocity is not None:
            arrays["velocity"] = self.velocity
        plain = {"found": True, "time": self.last_time, "missed": self.missed, "good": self.good}
        plain |= {"base": astuple(self.start.base), "tip": astuple(self.start.tip)}
        plain |= {"polarity": self.start.polarity, "score": self.start.score, "marked": self.marked}
        arrays["first_profiles"] = np.array(self.first_profiles).reshape(-1, SAMPLES)
        judged = self.judge.memory()
        return arrays | {"sample": judged.pop("sample"), "first": judged.pop("first"), "plain": plain | judged}

    def recall(self, memory: dict[str, Any]) -> None:
        """Go on from what `memory` gave."""
        plain = memory["plain"]
        if not plain["found"]:
            return
        self.state = fitted.State(*(memory[f"state.{name}"].copy() for name in fitted.State._fields))
        base, tip = End(*plain["base"]), End(*plain["tip"])
        self.start = Begin(self.state, base, tip, plain["polarity"], plain["score"])
        self.last, self.velocity = memory["last"].copy(), memory.get("velocity")
        self.clamps = [*memory["clamps"].reshape(-1, 2)]
        self.clamp_errors = memory["clamp_errors"].tolist()
        self.marked, self.first_profiles = plain["marked"], [*memory["first_profiles"]]
        self.last_time, self.missed, self.good = plain["time"], plain["missed"], plain["good"]
        self.judge.recall(plain, memory["sample"], memory["first"])

    def next(self, luma: NDArray[np.uint8], time_s: float) -> str:
        """Fit one frame; returns an empty string, or the reason why it is rejected."""
        if self.start is None:
            found = begin(luma, self.scene, self.work)
            if isinstance(found, str):
                return found
            self.start, self.state = found, found.state
            self.last, self.velocity = found.state.coefficients.copy(), None
        reason = self.judge.duplicate(luma, self._speed_px(time_s))
        self._brighten(self.judge.brightening())
        if reason:
            return reason
        reason = self._fit_predicted(luma, time_s)
        if reason and (self._swing_and_fit(luma) == "" or self._find_again(luma) == ""):
            reason = ""
        if reason:
            self.missed += 1
            assert self.state is not None and self.last is not None
            self.state.coefficients[:] = self.last
            return reason
        self._accept(time_s)
        self._read_marks(luma)
        if self.good <= FIRST_FRAMES:
            self._look_at_clamp(luma)
        return ""

    def _brighten(self, gain: float) -> None:
        """Scale what the light is expected to be; the sums of a frame then correct the rest."""
        assert self.state is not None
        self.state.levels[:] *= gain
        self.state.reference[:] *= gain

    def _read_marks(self, luma: NDArray[np.uint8]) -> None:
        """The light along the tube, as long as the first frames show marks in it."""
        if not self.marked:
            return
        assert self.state is not None
        profile = np.empty(SAMPLES)
        light_along(luma, self.scene.camera, self.state.coefficients, self.state.width, profile)
        self.profile = profile
        if self.good <= 3:
            self.first_profiles.append(profile)
        if self.good == 3:
            self.marked = has_texture(np.array(self.first_profiles), float(np.median(self.state.reference[:2])))

    def _look_at_clamp(self, luma: NDArray[np.uint8]) -> None:
        """The clamp does not move: average where it is seen in the first frames."""
        assert self.state is not None and self.start is not None
        if self.start.base.kind != "step":
            return
        half = float(self.work.numbers[fitted.WIDTH]) / 2
        contrast = float(np.median(self.state.reference[:2]))
        end = find_end(
            luma, self.scene.camera, self.state.coefficients, half, contrast, at_tip=False, beyond_mm=4.0, within_mm=5.0
        )
        if end.kind != "step" or abs(end.along_mm) > 1.0:
            return
        clamp = self.state.clamp
        start = point_and_tangent(self.state.coefficients, 0.0)
        self.clamp_errors.append(end.stderr_mm)
        self.clamps.append(np.array(start[:2]) - end.along_mm * np.array(start[2:4]))
        middle = np.median(self.clamps, axis=0)
        clamp[:2] += float((middle - clamp[:2]) @ clamp[2:]) * clamp[2:]

    def clamp_stderr_mm(self) -> float:
        """Standard error of the clamp along the tube, from how its places scatter and how its strips disagree."""
        assert self.start is not None and self.state is not None
        first = self.start.base.stderr_mm
        if len(self.clamps) < 4:
            return first
        along = np.array(self.clamps) @ self.state.clamp[2:]
        scatter = 1.25 * along.std() / np.sqrt(len(along))
        # What all frames share (a shadow, a rough edge) does not average out.
        shared = max(float(np.median(self.clamp_errors)), 0.03 / self.scene.px_per_mm)
        return float(np.hypot(scatter, shared))

    def _speed_px(self, time_s: float) -> float:
        if self.velocity is None:
            return 0.0
        step = np.linalg.norm(self.velocity, axis=1).max() * max(time_s - self.last_time, 0.0)
        return float(step) * self.scene.px_per_mm

    def _fit_predicted(self, luma: NDArray[np.uint8], time_s: float) -> str:
        assert self.state is not None and self.last is not None
        saved = [array.copy() for array in self.state]
        if self.velocity is not None and self.missed == 0:
            self.state.coefficients[:] = self.last + self.velocity * np.clip(time_s - self.last_time, 0, 0.1)
        return self._fit(luma, saved, SEARCH_PX * min(1 + self.missed, 3))

    def _fit(self, luma: NDArray[np.uint8], saved: list[FloatArray], reach: float) -> str:
        assert self.state is not None
        gain = 0.3 if self.good < FIRST_FRAMES else 0.02
        fit_frame(
            luma,
            self.scene.camera,
            self.state,
            self.work,
            self.scene.px_per_mm,
            reach,
            gain,
            0.35,
            self.judge.hinge_mm,
            self.judge.bend_sign,
        )
        reason = self.judge(luma, self.work.numbers)
        if reason:
            for array, old in zip(self.state, saved, strict=True):
                array[:] = old
        return reason

    def _swing_and_fit(self, luma: NDArray[np.uint8]) -> str:
        """Look for the last shape bent further, as far as a tube may swing between two frames."""
        assert self.state is not None and self.last is not None
        saved = [array.copy() for array in self.state]
        self.state.coefficients[:] = self.last
        step = 0.5 * self.scene.half_mm / self.scene.length_mm
        score = bend_search(luma, self.scene.camera, self.state, self.work, WIDEST_SWING_RAD, step)
        if score < 0.8:
            self.state.coefficients[:] = saved[0]
            return "no_tube"
        return self._fit(luma, saved, SEARCH_PX)

    def _find_again(self, luma: NDArray[np.uint8]) -> str:
        """Search the whole picture; the clamp must be where it was."""
        assert self.state is not None and self.start is not None
        if self.missed > 4 and self.missed % 10:  # a search of the whole picture takes long
            return "no_tube"
        clamp = self.state.clamp.copy()
        place = np.array([clamp[:2]])
        found = begin(luma, replace(self.scene, clamp_px=None, tip_px=None), self.work)
        if isinstance(found, str):
            return found
        if np.linalg.norm(found.state.clamp[:2] - place[0]) > 4.0:
            return "no_tube: another tube"
        saved = [array.copy() for array in self.state]
        self.state.coefficients[:] = found.state.coefficients
        return self._fit(luma, saved, SEARCH_PX)

    def _accept(self, time_s: float) -> None:
        assert self.state is not None and self.last is not None
        step = time_s - self.last_time
        if self.good > 0 and step > 1e-6:
            velocity = (self.state.coefficients - self.last) / step
            self.velocity = velocity if self.missed == 0 else None
        self.last = self.state.coefficients.copy()
        self.last_time = time_s
        self.missed = 0
        self.good += 1
        if self.good == 3:
            self.state.reference[:2] = self.state.levels[:2, :, 0] - self.state.levels[:2, :, 1]
            self.state.reference[2] = np.diff(self.state.levels[2, :CAP_VERTICES].mean(axis=0))[0] * -1.0
