"""Films: a scene painted frame by frame and encoded, with the truth of what each frame shows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from testing.drawn import rods, rooms
from testing.drawn.camera import Noise
from testing.drawn.light import to_srgb
from testing.drawn.rods import Rod, Window
from testing.drawn.scene import MARGIN_PX, PIECES, Scene
from testing.drawn.things import CLAMPS
from testing.encoding import encode

MOST_LOOKS = 5  # into which an exposure is divided


@dataclass(frozen=True)
class Truth:
    """What a film shows, in pixels whose centres are whole numbers, in each frame (t,)."""

    times_s: np.ndarray
    centre_px: np.ndarray  # (t, 65, 2), from the clamp's face to the middle of the end's
    ends_px: np.ndarray  # (t, 2), the middle of the end's, had the camera stood as in the first frame
    tip_px: tuple[float, float]  # in the first frame, as all that follows
    clamp_px: tuple[tuple[float, float], tuple[float, float]]  # the body's edges where it leaves the clamp
    middle_px: tuple[tuple[float, float], ...]  # three points on the body between clamp and tip
    px_per_mm: float
    half_width_px: float
    length_mm: float
    visible: np.ndarray  # (t,) bool: the end is in the picture by more than a half width, and nothing before it


class Stage:
    """A scene with what does not change painted: the room, the clamp, the body's skin."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        h, w = scene.camera.shape
        self.view = scene.camera.plane(scene.pose(0).line[PIECES // 2])
        self.surface = scene.surface()
        m = MARGIN_PX
        room = rooms.painted(scene.room, scene.seed, h + 2 * m, w + 2 * m)
        self.lit = scene.light.field((h + 2 * m, w + 2 * m))
        self.hides = np.zeros((h + 2 * m, w + 2 * m), np.float32)
        still = Window((-m, -m), room * self.lit, self.lit, self.hides)
        rng = np.random.default_rng([scene.seed, 2])
        self.clamp = CLAMPS[scene.clamp][0](rng, scene.place, self._room_beside())
        for item in self.clamp:
            rods.paint(still, item, self.view, scene.light)
        gain = min((0.28 / float(still.linear.mean())) ** 0.4, 1.8)
        self.gain = min(gain, 1.0 / float(np.percentile(still.linear, 99)), 0.85 / float(scene.colour.max()))
        self.still = still.linear
        self.noise = Noise(scene.camera, np.random.default_rng([scene.seed, 3]))
        self._seen = None

    def _room_beside(self) -> float:
        """How wide (half widths) a clamp may be, to either side, before the body bends into it."""
        place, widest = self.scene.place, 2.4
        for frame in range(0, self.scene.frames, 4):
            away = (self.scene.pose(frame).line - place.at) / place.half_width_px
            back = away @ place.ahead < 0.5
            back[: PIECES // 8] = False
            widest = min(widest, float(np.abs(away[back] @ place.aside).min(initial=9)) - 1.2)
        return widest

    def view_at(self, frame: int) -> np.ndarray:
        return self.scene.camera.moved(frame) @ self.view

    def _backdrop(self, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Room and clamp sharp, and as the lens shows them (h, w, 3), lamps' light (h, w, 3), what the clamp hides (h, w)."""
        camera, m = self.scene.camera, MARGIN_PX
        if self._seen is None or camera.shake is not None:
            sheets = (self.still, self.lit, self.hides)
            if camera.shake is None:
                sharp, lit, hides = (np.ascontiguousarray(sheet[m:-m, m:-m]) for sheet in sheets)
            else:
                shift = np.array([[1, 0, -m], [0, 1, -m]], float)
                moved = (camera.moved(frame) @ np.vstack([shift, [0, 0, 1]]))[:2]
                sharp, lit, hides = (
                    cv2.warpAffine(sheet, moved, camera.size, flags=cv2.INTER_LINEAR) for sheet in sheets
                )
            self._seen = (sharp, cv2.GaussianBlur(sharp, (0, 0), camera.defocus_px), lit, hides)
        return self._seen

    def _moving(self, frame: float) -> tuple[list[Rod], Rod, list[Rod]]:
        """What is under the body, the body, and what is before it."""
        scene = self.scene
        pose = scene.pose(frame)
        body = scene.rod(pose, self.surface)
        under = scene.attached.rods(pose.line[-1], pose.heading[-1], body.half_width_px)
        return under, body, scene.passing.rods(frame) if scene.passing else []

    def picture(self, frame: int, *, cover: bool = False) -> np.ndarray:
        """Linear light (h, w, 3) that falls on the sensor in one frame; or how much of each pixel (h, w) the body covers."""
        sharp, blurred, lit, hides = self._backdrop(frame)
        view, camera = self.view_at(frame), self.scene.camera
        looks = self._looks(frame)
        moving = [self._moving(look) for look in looks]
        outlines = [
            rods.through(view, rods.outline(item)) for under, body, over in moving for item in (*under, body, *over)
        ]
        if self.scene.light.shadow_px is not None:
            outlines += [rods.through(view, rods.outline(body)) + self.scene.light.shadow_px for _, body, _ in moving]
        pad = int(
            3 * camera.defocus_px + 3 + 2 * self.scene.light.shadow_blur_px * (self.scene.light.shadow_px is not None)
        )
        pad += int(3 * self.scene.place.half_width_px) * (self.scene.attached.name == "small light")
        x0, y0, x1, y1 = rods.bounds(outlines, camera.shape, pad)
        box = np.s_[y0:y1, x0:x1]
        ground = self._shaded(sharp[box], hides[box], view, (x0, y0), moving[len(moving) // 2][1])
        total, covers = np.zeros_like(ground), np.zeros(ground.shape[:2], np.float32)
        for under, body, over in moving:
            window = Window((x0, y0), ground.copy(), lit[box])
            for item in under:
                rods.paint(window, item, view, self.scene.light, hidden=hides[box])
            self._glow(window, view, under)
            window.cover = np.zeros_like(covers)
            rods.paint(window, body, view, self.scene.light, hidden=hides[box])
            covers += window.cover / len(looks)
            window.cover = None
            for item in over:
                rods.paint(window, item, view, self.scene.light)
            total += window.linear / len(looks)
        if cover:
            whole = np.zeros(camera.shape, np.float32)
            whole[box] = covers
            return cv2.GaussianBlur(whole, (0, 0), camera.defocus_px)
        return _put(
            blurred,
            cv2.GaussianBlur(total, (0, 0), camera.defocus_px),
            (x0, y0, x1, y1),
            int(3 * camera.defocus_px) + 1,
        )

    def _looks(self, frame: int) -> np.ndarray:
        """The times (frames) within an exposure at which the body is looked at: more, the farther its end moves."""
        half = self.scene.camera.exposed / 2
        ends = [self.scene.pose(frame + at).line[-1] for at in (-half, half)]
        count = int(np.clip(np.ceil(np.hypot(*(ends[1] - ends[0])) / 1.2), 1, MOST_LOOKS))
        return frame + half * (2 * (np.arange(count) + 0.5) / count - 1)

    def _shaded(
        self, ground: np.ndarray, hides: np.ndarray, view: np.ndarray, corner: tuple[int, int], body: Rod
    ) -> np.ndarray:
        """The room (h, w, 3) with the body's shadow on it, but for the clamp, which stands before it."""
        light = self.scene.light
        if light.shadow_px is None:
            return ground
        quarter = np.zeros((ground.shape[0] // 4 + 2, ground.shape[1] // 4 + 2), np.float32)
        places = (rods.through(view, rods.outline(body)) + light.shadow_px - corner) / 4
        cv2.fillPoly(quarter, [np.round(places * 16).astype(np.int32)], 1.0, cv2.LINE_AA, 4)
        quarter = cv2.GaussianBlur(quarter, (0, 0), max(light.shadow_blur_px / 4, 0.6))
        move = np.array([[4, 0, 0], [0, 4, 0]], float)
        shadow = cv2.warpAffine(quarter, move, ground.shape[1::-1], flags=cv2.INTER_LINEAR)
        return ground * (1 - light.shadow_depth * shadow * (1 - hides))[..., None]

    def _glow(self, window: Window, view: np.ndarray, under: list[Rod]) -> None:
        """A small light shines, and what is around it with it."""
        if self.scene.attached.name != "small light":
            return
        at = rods.through(view, under[0].points[-1:])[0] - window.corner
        y, x = np.mgrid[: window.linear.shape[0], : window.linear.shape[1]]
        away = ((x - at[0]) ** 2 + (y - at[1]) ** 2) / (0.35 * self.scene.place.half_width_px) ** 2
        glow = 1.4 * np.exp(-away / 2) + 0.08 / (1 + away / 6) * np.exp(-away / 60)
        window.linear += glow[..., None] * self.scene.attached.colour.astype(np.float32)

    def frame(self, number: int) -> np.ndarray:
        """A frame (h, w, 3) uint8, RGB, as the sensor gives it."""
        scene = self.scene
        time_s = number / scene.camera.rate_Hz
        exposed = self.picture(number) * np.float32(self.gain * scene.light.exposure(time_s))
        picture = to_srgb(exposed, scene.camera.contrast)
        if scene.light.flicker:
            picture *= scene.light.bands(time_s, len(picture))
        self.noise.add(picture)
        out = cv2.convertScaleAbs(np.maximum(picture, 0))
        if scene.camera.jpeg is not None:
            coded = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, scene.camera.jpeg])[1]
            out = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))
        return out

    def centre(self, frame: int) -> np.ndarray:
        """Where frame `frame` shows the body's middle line (65, 2) px."""
        return rods.through(self.view_at(frame), self.scene.pose(frame).line[:: PIECES // 64])

    def visible(self, frame: int) -> bool:
        """Whether the end is in the picture by more than a half width, and neither clamp nor hand is before it."""
        scene = self.scene
        width, height = scene.camera.size
        px = scene.place.half_width_px
        pose = scene.pose(frame)
        tip = rods.through(self.view_at(frame), pose.line[-1:])[0]
        if not (px < tip[0] < width - 1 - px and px < tip[1] < height - 1 - px):
            return False
        heading = pose.heading[-1]
        ahead, aside = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
        near = pose.line[-1] - px * (
            ahead * np.array([0, 0.4, 0.8])[:, None, None] + aside * np.linspace(-0.8, 0.8, 5)[None, :, None]
        )
        column, row = (rods.through(self.view, near.reshape(-1, 2)) + MARGIN_PX).round().astype(int).T
        covered = (
            self.hides[np.clip(row, 0, self.hides.shape[0] - 1), np.clip(column, 0, self.hides.shape[1] - 1)] > 0.5
        )
        for item in scene.passing.rods(frame) if scene.passing else []:
            apart = np.linalg.norm(near.reshape(-1, 1, 2) - item.points[None], axis=2).min(axis=1)
            covered |= apart < item.half_width_px
        return bool(covered.mean() < 0.2)

    def truth(self) -> Truth:
        scene = self.scene
        frames = range(scene.frames)
        centre = np.array([self.centre(k) for k in frames])
        body = scene.rod(scene.pose(0), self.surface)
        start = int(np.argmin(np.abs(body.along_px)))
        aside = np.array([-np.sin(body.heading[start]), np.cos(body.heading[start])])
        at = rods.entries(body, np.zeros(1))[0]
        edges = body.points[start] + np.array([-body.left[at], body.right[at]])[:, None] * aside
        edges = rods.through(self.view_at(0), edges)
        tip, middle = centre[0, -1], centre[0, [16, 32, 48]]
        on_body = (body.along_px >= 0) & (body.along_px <= body.length_px)
        at = rods.entries(body, body.along_px[on_body])
        wide = float(np.median((body.left[at] + body.right[at]) / 2))
        return Truth(
            times_s=np.arange(scene.frames) / scene.camera.rate_Hz,
            centre_px=centre,
            ends_px=rods.through(self.view, np.array([scene.pose(k).line[-1] for k in frames])),
            tip_px=(float(tip[0]), float(tip[1])),
            clamp_px=((float(edges[0, 0]), float(edges[0, 1])), (float(edges[1, 0]), float(edges[1, 1]))),
            middle_px=tuple((float(x), float(y)) for x, y in middle),
            px_per_mm=scene.px_per_mm,
            half_width_px=wide,
            length_mm=scene.length_px / scene.px_per_mm,
            visible=np.array([self.visible(k) for k in frames]),
        )


def _put(blurred: np.ndarray, part: np.ndarray, box: tuple[int, int, int, int], rim: int) -> np.ndarray:
    """The still picture with a blurred part in it, but for the part's rim, which the blur has spoilt, within the picture."""
    h, w = blurred.shape[:2]
    x0, y0, x1, y1 = box
    inner = [x0 + rim * (x0 > 0), y0 + rim * (y0 > 0), x1 - rim * (x1 < w), y1 - rim * (y1 < h)]
    out = blurred.copy()
    if inner[0] < inner[2] and inner[1] < inner[3]:
        out[inner[1] : inner[3], inner[0] : inner[2]] = part[
            inner[1] - y0 : inner[3] - y0, inner[0] - x0 : inner[2] - x0
        ]
    return out


def film(path: Path, scene: Scene) -> Truth:
    """Write a scene's film (mp4) and say what it shows."""
    stage, camera = Stage(scene), scene.camera
    encode(path, map(stage.frame, range(scene.frames)), camera.size, camera.rate_Hz, camera.crf, "veryfast")
    return stage.truth()
