"""The first frame: from a picture to a fitted tube with its clamp and tip, or the reason why not."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from rfea_vision.arrays import FloatArray
from rfea_vision.artefacts import Actuator, Hints
from rfea_vision.calibration.projection import project, unproject
from rfea_vision.lines import along, scaled
from rfea_vision.vision.curve import (
    VERTICES,
    WIDTH_COEFFICIENTS,
    fit_curve,
    point_and_tangent,
    points_on,
    turning,
    vertices_of,
)
from rfea_vision.vision.edges.cap import cap_levels, measure_cap
from rfea_vision.vision.edges.fitted import Buffers, Shot, State
from rfea_vision.vision.edges.sides import fit_sides, measure_sides, move_state, update_levels
from rfea_vision.vision.find.ends import End, choose_ends, end_candidates
from rfea_vision.vision.find.locate import Path, cut_at, find_paths, hinted_paths

LEAST_SCORE = 0.02  # of something of unknown place: below it lies all that is a quarter longer or shorter than the tube
# How far from where a person points the tube may be, in half widths: at the clamp both its edges were pointed at; its end may
# be ragged, and a point of the centre line is one of the tube; people miss a pixel by so many px besides. Set on films with
# hints beside the arm (tests/measurement/test_body.py).
HINT_CLAMP, HINT_ELSEWHERE, POINTING_PX = 0.6, 1.0, 3.0
FIRST_TRIES = 3  # frames in which a tube is looked for where it was pointed at in the first one
# rad: what holds a body holds it squarely. In the first frames of 77 films of testing/phone.py the line left within 0.12 of that,
# and in real ones, held by tape, within 0.3; a line that takes the clamp's middle on its way elsewhere was 0.55 off.
HINT_LEAVES, CLAMP_POINTED_PX = 0.45, 2.0
CAP_LOOKS, CAP_GAIN = 8, 0.7
REACH_SHARE = 0.25  # of the length: how far from the ends of a path the tube's ends are looked for


@dataclass(frozen=True)
class Scene:
    """What is known before the first frame: camera, tube, hints, which way is down (plane frame), scale, and how the rig stands.

    `down` is where the unloaded tube points; gravity lies `gravity_deg` from that, positive in the direction of the bend, or, None, is
    none in the plane.
    Where it is sought `by_ends`, what was found passes the points between them as well, and is led by clamp and tip alone.
    """

    camera: FloatArray
    actuator: Actuator
    down: FloatArray
    px_per_mm: float
    hints: Hints = field(default_factory=Hints)
    by_ends: bool = False
    gravity_deg: float | None = 0.0

    @property
    def clamp_px(self) -> FloatArray | None:
        """The clamp's two edges (2, 2), where they were pointed at."""
        return None if self.hints.clamp is None else np.asarray(self.hints.clamp, dtype=float).reshape(-1, 2)

    def pointed(self, scale: float = 1.0) -> tuple[FloatArray, FloatArray, float]:
        """Pointed at, in pictures `scale` times as large: the clamp's edges (2, 2), the line (n, 2), half the width, px."""
        assert self.clamp_px is not None
        clamp, line = (scaled(places, scale) for places in (self.clamp_px, self.line_px))
        return clamp, line, 0.5 * float(np.linalg.norm(clamp[1] - clamp[0]))

    @property
    def tip_px(self) -> FloatArray | None:
        """The tip (2,), where it was pointed at."""
        return None if self.hints.tip is None else np.asarray(self.hints.tip, dtype=float).ravel()

    @property
    def is_pointed_at(self) -> bool:
        """Whether a person has said where the tube is in the first frame."""
        return self.hints.clamp is not None and self.hints.tip is not None

    @property
    def line_px(self) -> FloatArray:
        """What is known of the centre line in the first frame (n, 2) px, from the clamp to the tip."""
        points = np.asarray(self.hints.centre_line, dtype=float).reshape(-1, 2)
        first = [] if self.clamp_px is None else [self.clamp_px.mean(axis=0)]
        last = [] if self.tip_px is None else [self.tip_px]
        points = points[:0] if self.by_ends else points
        return np.vstack([*first, *points, *last]) if len(points) or first or last else np.empty((0, 2))

    def shot(self, picture: NDArray[np.uint8]) -> Shot:
        """A picture (h, w) with what the compiled functions know of its camera."""
        (height, width), (step, _) = picture.shape, picture.strides
        # All loops would be compiled once more for rows that lie apart, as a decoder pads them: they get whole rows.
        if not picture.flags.c_contiguous and step >= width and picture.strides[1] == 1:
            picture = as_strided(picture, (height, step))
        return Shot(np.ascontiguousarray(picture), width, self.camera, self.px_per_mm)

    @property
    def half_mm(self) -> float:
        """Half the tube's width at rest."""
        return 1000.0 * self.actuator.outer_radius

    @property
    def hinge_mm(self) -> float:
        """How far inside of the centre line lies the one that keeps its length: a tube's inextensible side, a beam's middle."""
        return 1000.0 * self.actuator.offset

    @property
    def length_mm(self) -> float:
        """Length of the centre line at rest."""
        return 1000.0 * self.actuator.length

    @property
    def turn_sign(self) -> float:
        """Of the turning of a bend to the actuator's side: walking down, one to the camera's left turns clockwise."""
        return -self.actuator.mirror


@dataclass(frozen=True)
class Initialisation:
    """A fitted first frame: its state, and how the clamp was found."""

    state: State
    base: End
    polarity: int
    score: float


#: A ribbon was found, and by the scale it is not as long as the tube.
OTHER_LENGTH = "no_tube: what has the tube's width is not of its length"


def begin(picture: NDArray[np.uint8], scene: Scene, work: Buffers) -> Initialisation | str:
    """Find and fit the tube in one picture; a sentence where there is none."""
    near = scene.line_px if len(scene.line_px) else None
    length_px = scene.length_mm * scene.px_per_mm
    allowed = allowed_pixels(picture.shape, scene.hints)
    paths = find_paths(picture, 2 * scene.half_mm * scene.px_per_mm, length_px, near_px=near, allowed=allowed)
    if scene.is_pointed_at:
        ends = scene.line_px[[0, -1]]
        paths = [cut_at(path, ends, length_px) for path in paths] + hinted_paths(scene.line_px)
    best: Initialisation | None = None
    reason = "no_tube: no ribbon of the tube's width and length is in the picture"
    for path in paths[:6]:
        if best is not None and path.score < 0.6 * best.score:
            break
        found = fit_path(picture, scene, work, path)
        if isinstance(found, str):
            reason = found
        elif away := off_hints(line_of(found.state.coefficients), scene, first=True):
            reason = away
        elif near is None and found.score < LEAST_SCORE:
            reason = OTHER_LENGTH
        elif best is None or found.score > best.score:
            best = found
    return best if best is not None else reason


def off_hints(line_mm: FloatArray, scene: Scene, *, first: bool = False, again: FloatArray | None = None) -> str:
    """Why a centre line (n, 2) mm on the plane, from clamp to tip, cannot be the tube that was pointed at.

    It begins elsewhere than at `camera.clamp`; in the first frame it also leaves the clamp askew, ends elsewhere than at
    `camera.tip`, or passes beside `camera.centre_line`; in one in which it was pointed at `again` it ends elsewhere than at the last
    of these points (n, 2) px, or passes beside another. What its own residuals say counts for nothing here.
    """
    pointing = POINTING_PX / scene.px_per_mm
    places = [] if scene.clamp_px is None else [("camera.clamp", scene.clamp_px.mean(axis=0), line_mm[:1], HINT_CLAMP)]
    if first:
        places += [] if scene.tip_px is None else [("camera.tip", scene.tip_px, line_mm[-1:], HINT_ELSEWHERE)]
        places += [("camera.centre_line", np.array(point), line_mm, HINT_ELSEWHERE) for point in scene.hints.centre_line]
    elif again is not None:
        places += [("camera.corrections", again[-1], line_mm[-1:], HINT_ELSEWHERE)]
        places += [("camera.corrections", point, line_mm, HINT_ELSEWHERE) for point in again[:-1]]
    for name, pixel, points, reach in places:
        off = beside(points, unproject(scene.camera, pixel))
        if off > np.hypot(reach * scene.half_mm, pointing):
            return f"off_hints: what was found lies {off:.{digits_of(scene.length_mm) + 1}f} mm from {name}"
    return _askew(line_mm, scene) if first and scene.clamp_px is not None else ""


def beside(line: FloatArray, point: FloatArray) -> float:
    """How far a point (2,) lies from a line of points (n, 2), between which it is straight."""
    steps = np.diff(line, axis=0, append=line[-1:])
    along = np.clip(np.sum((point - line) * steps, axis=1) / np.maximum(np.sum(steps**2, axis=1), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(line + along[:, None] * steps - point, axis=1).min())


def digits_of(length_mm: float) -> int:
    """Decimals of a place along a tube in mm: whole ones of a tube of 100 mm, hundredths of a worm of 1 mm."""
    return max(0, 1 - int(np.floor(np.log10(max(length_mm, 1e-6)))))


def _askew(line_mm: FloatArray, scene: Scene) -> str:
    """Whether a centre line (n, 2) mm leaves the clamp's two edges as none does that they hold: it is on its way elsewhere."""
    assert scene.clamp_px is not None
    one, other = unproject(scene.camera, scene.clamp_px)
    gone = np.linalg.norm(line_mm - line_mm[0], axis=1)
    leaves = line_mm[int(np.argmax(gone > scene.half_mm))] - line_mm[0]
    across = other - one
    askew = float(np.arctan2(abs(leaves @ across), abs(leaves[0] * across[1] - leaves[1] * across[0])))
    wide = 2.0 * scene.pointed()[2]
    if askew <= HINT_LEAVES + CLAMP_POINTED_PX / max(wide, 1.0):
        return ""
    return f"off_hints: what was found leaves camera.clamp {np.rad2deg(askew):.0f} degrees from squarely"


def allowed_pixels(shape: tuple[int, ...], hints: Hints, scale: float = 1.0) -> NDArray[np.bool_] | None:
    """Where the tube may be, by `region` and `exclude`, in a picture smaller by `scale`; None for everywhere."""
    if hints.region is None and not hints.exclude:
        return None
    allowed = np.full(shape[:2], hints.region is None)
    boxes = [(box, False) for box in hints.exclude]
    for box, inside in ([] if hints.region is None else [(hints.region, True)]) + boxes:
        x, y, width, height = (scale * side for side in box)
        allowed[max(round(y), 0) : max(round(y + height), 0), max(round(x), 0) : max(round(x + width), 0)] = inside
    return allowed


def oriented(path_mm: FloatArray, scene: Scene) -> FloatArray:
    """Order a path from clamp to tip: the tube leaves its clamp downwards, and bends to its side."""
    hinted = [(end, pixels) for end, pixels in ((0, scene.clamp_px), (-1, scene.tip_px)) if pixels is not None]
    forward = 0.0  # how much nearer the hints are to the ends that they should be at
    for end, pixels in hinted:
        place = unproject(scene.camera, pixels).reshape(-1, 2).mean(axis=0)
        forward += float(np.linalg.norm(path_mm[-1 - end] - place) - np.linalg.norm(path_mm[end] - place))
    if not hinted:
        n = max(len(path_mm) // 10, 1)
        first, last = path_mm[n] - path_mm[0], path_mm[-1 - n] - path_mm[-1]
        forward = float(first @ scene.down / np.linalg.norm(first) - last @ scene.down / np.linalg.norm(last))
        if abs(forward) < 0.4:
            right = np.array([-scene.down[1], scene.down[0]])
            forward = float((path_mm[0] - path_mm[-1]) @ right) * scene.actuator.mirror
    return path_mm if forward >= 0 else path_mm[::-1]


def fit_path(picture: NDArray[np.uint8], scene: Scene, work: Buffers, path: Path) -> Initialisation | str:
    """Fit edges, clamp and tip to a candidate."""
    points = unproject(scene.camera, path.points)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 5:
        return "no_tube: the candidate lies outside the plane of motion"
    points = oriented(points, scene)
    state = new_state(points, scene.half_mm, path.polarity)
    kept = refine(picture, scene, state, work, 6)
    if kept < 0.25:
        return f"no_tube: only {100 * kept:.0f} % of the edges fit a tube of {2 * scene.half_mm:.1f} mm"
    contrast = float(np.median(state.levels[:2, :, 0] - state.levels[:2, :, 1]))
    if contrast * path.polarity <= 0:
        return "no_tube: the candidate has no contrast"
    state.reference[:] = contrast
    half = float(np.mean(work.half_width))
    if half <= 0:
        return "no_tube: the candidate's edges have crossed"
    base, tip = _both_ends(picture, scene, state, work, half, contrast)
    move_ends(state, base.along_mm, tip.along_mm)
    refine(picture, scene, state, work, 3)
    fix_clamp(state)
    state.reference[:2] = state.levels[:2, :, 0] - state.levels[:2, :, 1]
    inside, outside = state.levels[:2, -VERTICES // 16 :, 0].mean(), state.levels[:2, -VERTICES // 16 :, 1].mean()
    state.reference[2] = inside - outside
    state.levels[2, :, 0], state.levels[2, :, 1] = inside, outside
    state.blurs[2] = float(np.median(state.blurs[:2]))
    if tip.kind == "step":
        _learn_cap(picture, scene, state, work)
    ratio = length_of(state) / scene.length_mm
    score = (
        path.score
        * min(kept, 1.0)
        * float(np.exp(-0.5 * (np.log(ratio) / 0.12) ** 2))
        * float(np.exp(-0.5 * (np.log(half / scene.half_mm) / 0.15) ** 2))
    )
    return Initialisation(state, base, path.polarity, score)


def _learn_cap(picture: NDArray[np.uint8], scene: Scene, state: State, work: Buffers) -> None:
    """Shape of the tube's end, flat, slanted or round, before the first fit takes its corners for edges."""
    nothing = np.zeros(state.coefficients.shape[0] + state.width.shape[0])
    limit = 4.0 / scene.px_per_mm
    for look in range(CAP_LOOKS):
        gain = CAP_GAIN if look else 0.0  # the first look reads the light
        shift, _, used = measure_cap(scene.shot(picture), state, work, 3.0, gain)
        cap_levels(state, work, 0.3 * scene.half_mm * scene.px_per_mm)
        if used > 0.3:
            move_state(state, nothing, float(np.clip(shift, -limit, limit)))


def _both_ends(
    picture: NDArray[np.uint8], scene: Scene, state: State, work: Buffers, half: float, contrast: float
) -> tuple[End, End]:
    """Clamp and tip along the curve: the steps in the light whose distance is the tube's length."""
    reach = REACH_SHARE * scene.length_mm
    camera, curve = scene.camera, state.coefficients
    tips = end_candidates(picture, camera, curve, half, contrast, at_tip=True, reach_mm=reach)
    if scene.clamp_px is None:
        bases = end_candidates(picture, camera, curve, half, contrast, at_tip=False, reach_mm=reach)
    else:
        clamp = unproject(camera, scene.clamp_px).mean(axis=0)
        x, y, tx, ty, _ = point_and_tangent(curve, 0.0)
        bases = [(End(float((x - clamp[0]) * tx + (y - clamp[1]) * ty), 0.0, "hint"), 10.0)]
    if scene.tip_px is not None:
        given = unproject(camera, scene.tip_px)
        x, y, tx, ty, _ = point_and_tangent(curve, 1.0)
        along = float((given[0] - x) * tx + (given[1] - y) * ty)
        tips = [(end, share) for end, share in tips if abs(end.along_mm - along) < 4 * half] or tips
    vertices_of(state.coefficients, state.width, work.centre, work.normal, work.half_width)
    hinge = length_of(state) - (half if scene.hinge_mm else 0.0) * scene.turn_sign * turning(work.normal)
    return choose_ends(bases, tips, hinge, scene.length_mm)


def new_state(path_mm: FloatArray, half_mm: float, polarity: int) -> State:
    """A state on a ragged path (n, 2), by a first curve of few coefficients, with everything else still unknown."""
    curve = fit_curve(points_on(fit_curve(path_mm, 7), np.linspace(0, 1, 200)))
    width, levels, blurs = np.full(WIDTH_COEFFICIENTS, half_mm), np.zeros((3, VERTICES, 2)), np.full((3, VERTICES), 1.0)
    state = State(curve, width, levels, blurs, polarity * 1e-3 * blurs, np.zeros(2), np.zeros(4))
    fix_clamp(state)
    return state


def fix_clamp(state: State) -> None:
    """Let the clamp line be where the curve starts now."""
    state.clamp[:] = point_and_tangent(state.coefficients, 0.0)[:4]


def move_ends(state: State, before_mm: float, beyond_mm: float) -> None:
    """Lengthen the curve at its clamp and its tip (negative: shorten)."""
    fix_clamp(state)
    state.clamp[0] -= before_mm * state.clamp[2]
    state.clamp[1] -= before_mm * state.clamp[3]
    solution = np.zeros(state.coefficients.shape[0] + state.width.shape[0])
    for _ in range(round(abs(before_mm) // 8)):  # `move_state` goes 8 mm at most
        move_state(state, solution, 0.0)
    for _ in range(round(abs(beyond_mm) // 8)):
        move_state(state, solution, 8.0 * np.sign(beyond_mm))
    move_state(state, solution, beyond_mm - 8.0 * np.sign(beyond_mm) * (abs(beyond_mm) // 8))


def refine(picture: NDArray[np.uint8], scene: Scene, state: State, work: Buffers, turns: int) -> float:
    """Fit the edges away from the ends a few times; the share of stations that agree."""
    kept, shot = 0.0, scene.shot(picture)
    px_per_vertex = max(length_of(state) * scene.px_per_mm / (VERTICES - 1), 0.2)
    blur_limit = 0.3 * scene.half_mm * scene.px_per_mm
    for turn in range(turns):
        fix_clamp(state)
        measure_sides(shot, state, work, 0.03, 0.97)
        update_levels(state, work, 1.0, blur_limit, px_per_vertex)
        filled, length = measure_sides(shot, state, work, 0.03, 0.97)
        wide = (8.0 if turn < 2 else 3.0) / scene.px_per_mm
        solution, _, number = fit_sides(state, work, filled, wide, 3.0)
        kept = number / max(2.0 * length * scene.px_per_mm * 0.94 * 0.85, 1.0)
        if number < 20:
            return 0.0
        move_state(state, solution, 0.0)
    return kept


def line_of(coefficients: FloatArray) -> FloatArray:
    """Points (400, 2) mm of the centre line, from clamp to tip."""
    return points_on(coefficients, np.linspace(0, 1, 400))


def length_of(state: State) -> float:
    """Arc length of the centre line in mm."""
    return float(along(line_of(state.coefficients))[-1])


def scale_at(camera: FloatArray, pixel: FloatArray) -> float:
    """Px per mm at a pixel."""
    place = unproject(camera, pixel)
    around = project(camera, place + np.array([[0.0, 0], [1, 0], [0, 1]]))
    return float(np.sqrt(abs(np.linalg.det(around[1:] - around[0]))))
