"""Real films by others: what is pointed at in them, which is kept beside the benchmark, and how a track is held against it.

The films themselves are not kept here. Whoever measures clones the repository that `source` names, checks `commit` out, and
copies `path` to ``<folder>/<owner>+<name>/<path>``; of single pictures `path` is their folder.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from rfea_vision.artefacts import Actuator, Calibration, Hints, Track
from rfea_vision.calibration.projection import plane_mm_to_pixels
from rfea_vision.calibration.scale import scaled_by_distance
from rfea_vision.campaign.resolve import hints_of
from rfea_vision.campaign.schema import ActuatorPart, CameraPart, ScalePart
from rfea_vision.campaign.yaml_file import read_yaml
from rfea_vision.readers.pictures import numbered_pictures, read_grey
from rfea_vision.readers.video import FolderSource, FrameSource, Luma, open_frames, open_video
from rfea_vision.vision.show.clip import in_frame, rig_to_plane

Floats = NDArray[np.float64]
POINTED = Path(__file__).resolve().parents[1] / "benchmarks" / "real_films"
PICTURES_HZ = 30.0  # of a folder of pictures, whatever it was filmed with
CHANNEL = {"blue": 0, "green": 1, "red": 2}  # of BGR
MARK_REACH = 1.5  # how far a mark is sought from where it was, in its own diameters
MARK_SHARE = 0.5  # of the first frame's colour, what a pixel of the mark has at least
MARK_AREA = (0.35, 2.5)  # of the first frame's area, what a mark has that is seen whole
CERTAIN = 1.96  # standard errors to either side of the 95 % interval
SURE = 3.0  # standard errors beyond which a frame that is off is sure and wrong
ASTRAY = 0.5  # half widths of the body that such a frame is off


class _Described(BaseModel):
    """A misspelt key is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class FramesPart(_Described):
    """Which frames of the file are read: every `step`-th from `first` to before `stop`."""

    first: Annotated[int, Field(ge=0)] = 0
    stop: Annotated[int, Field(gt=0)] | None = None
    step: Annotated[int, Field(gt=0)] = 1


class FilmFile(_Described):
    """One film, what is pointed at in the first of its frames, and where its end is in others.

    `camera` and `actuator` have the keys of a campaign. `tips` are places in pixels by the number of the frame in the file, null
    where nobody can see the end, each known to `hand_px` (1 s.d.); where there is a `mark` its colour's middle stands for them.
    `middles` are places on the middle of the body, likewise, known as well across it: between its edges as a person saw them.
    `stills` are the numbers of single pictures, in the order in which they are read, a second apart; without them all pictures of a
    folder are a film.
    """

    source: Annotated[str, Field(pattern=r"^[\w.-]+/[\w.-]+$")]
    commit: Annotated[str, Field(pattern=r"^[0-9a-f]{40}$")]
    path: str
    what: str
    seen: bool
    frames: FramesPart = FramesPart()
    stills: tuple[int, ...] = ()
    camera: CameraPart
    actuator: ActuatorPart
    end: Literal["mark", "end"]
    mark: Literal["red", "green", "blue"] | None = None
    tips: dict[int, tuple[float, float] | None] = Field(default_factory=dict)
    middles: dict[int, tuple[tuple[float, float], ...]] = Field(default_factory=dict)
    hand_px: Annotated[float, Field(gt=0)]

    @model_validator(mode="after")
    def _complete(self) -> FilmFile:
        if self.camera.clamp is None or self.camera.tip is None:
            raise ValueError("camera: give clamp and tip")
        if not isinstance(self.camera.scale, ScalePart) or self.camera.scale.distance is None:
            raise ValueError("camera.scale: give two points and their distance")
        if self.mark is None and sum(place is not None for place in self.tips.values()) < 2:
            raise ValueError("tips: give two at least, or a mark")
        for key, places in (("tips", self.tips), ("middles", self.middles)):
            if missed := [number for number in places if self.row_of(number) is None]:
                raise ValueError(f"{key}: the frames {missed} are none of those that are read")
        return self

    @property
    def hints(self) -> Hints:
        return hints_of(self.camera)

    @property
    def tube(self) -> Actuator:
        """What is measured of the body; its bore counts for nothing here."""
        radius = self.actuator.outer_radius
        return Actuator(outer_radius=radius, inner_radius=radius / 2, length=self.actuator.length)

    @property
    def half_width_px(self) -> float:
        assert self.camera.clamp is not None
        return float(np.linalg.norm(np.subtract(*self.camera.clamp))) / 2

    def calibration(self, size: tuple[int, int]) -> Calibration:
        """The scale that was pointed at, for pictures of `size` (px)."""
        scale = self.camera.scale
        assert isinstance(scale, ScalePart)
        assert scale.distance is not None
        return scaled_by_distance(size, scale.points, 1e3 * scale.distance)

    def row_of(self, number: int) -> int | None:
        """Which of the frames that are read has a number in the file; None where it is none of them."""
        if self.stills:
            return self.stills.index(number) if number in self.stills else None
        stop = number + 1 if self.frames.stop is None else self.frames.stop
        kept = range(self.frames.first, stop, self.frames.step)
        return kept.index(number) if number in kept else None

    def begun_at(self, number: int) -> FilmFile:
        """The frame with a number in the file alone, in which nothing but the clamp and the tip is pointed at."""
        alone = {"stills": (number,)} if self.stills else {"frames": FramesPart(first=number, stop=number + 1)}
        camera = self.camera.model_copy(update={"tip": self.tips[number], "centre_line": None})
        return self.model_copy(update={**alone, "camera": camera})

    def clicked_again(self, rng: np.random.Generator) -> FilmFile:
        """The same film as another hand points at it: clamp, tip and centre line off by 1 px and a twentieth of half the width."""
        stderr, camera = float(np.hypot(1.0, 0.05 * self.half_width_px)), self.camera
        given = {"clamp": camera.clamp, "tip": camera.tip, "centre_line": camera.centre_line}
        off = {key: np.add(places, rng.normal(0.0, stderr, np.shape(places))) for key, places in given.items() if places}
        clicks = {key: tuple(map(tuple, places.tolist())) if places.ndim > 1 else tuple(places) for key, places in off.items()}
        return self.model_copy(update={"camera": camera.model_copy(update=clicks)})

    def film(self, folder: Path) -> Path:
        """Where the film is under the folder of all films."""
        return folder / self.source.replace("/", "+") / self.path

    def opened(self, folder: Path) -> FrameSource:
        """The frames that are read."""
        if self.stills:
            return opened_stills(self.film(folder), self.stills)
        film, chosen = self.film(folder), self.frames
        whole = open_frames(film, None, PICTURES_HZ) if film.is_dir() else open_video(film)
        if chosen == FramesPart():
            return whole
        times = whole.times_s()[chosen.first : chosen.stop : chosen.step]
        return ChosenFrames(whole.path, whole.size, len(times), whole.rate_Hz, whole=whole, chosen=chosen)


def opened_stills(folder: Path, numbers: Sequence[int]) -> FrameSource:
    """Pictures of a folder by the numbers in their names, a second apart."""
    files = {int(path.stem): path for path in numbered_pictures(folder) if path.stem.isdigit()}
    chosen = tuple(files[number] for number in numbers)
    first = read_grey(chosen[0])
    assert first is not None
    size, times = (first.shape[1], first.shape[0]), tuple(float(k) for k in range(len(chosen)))
    return FolderSource(folder, size, len(chosen), 1.0, files=chosen, times=times, bits=8)


@dataclass(frozen=True)
class ChosenFrames(FrameSource):
    """Some frames of a film; times begin with the first of them."""

    whole: FrameSource = field(kw_only=True)
    chosen: FramesPart = field(kw_only=True)

    def times_s(self) -> Floats:
        times = self.whole.times_s()[self.chosen.first : self.chosen.stop : self.chosen.step]
        return times - times[:1]

    def _of(self, every: Iterable[tuple[float, Luma]]) -> Iterator[tuple[float, Luma]]:
        kept = islice(every, self.chosen.first, self.chosen.stop, self.chosen.step)
        return ((float(time_s), picture) for time_s, (_, picture) in zip(self.times_s(), kept, strict=False))

    def frames(self, start_frame: int = 0) -> Generator[tuple[float, Luma], None, None]:
        yield from islice(self._of(self.whole.frames()), start_frame, None)

    def colours(self, scale: float = 1.0) -> Generator[tuple[float, Luma], None, None]:
        yield from self._of(self.whole.colours(scale))


def pointed_at(folder: Path = POINTED) -> dict[str, FilmFile]:
    """All that is pointed at, by the names of the files."""
    return {path.stem: FilmFile.model_validate(read_yaml(path).content) for path in sorted(folder.glob("*.yaml"))}


@dataclass(frozen=True)
class Ends:
    """The line's end in every frame, NaN where it was refused: places and standard errors (frames, 2) px, headings (frames,)."""

    tip_px: Floats
    sigma_px: Floats
    heading_rad: Floats

    @classmethod
    def of(cls, track: Track, calibration: Calibration, *, stayed: bool = False) -> Ends:
        """Those of a track, where each frame shows them, or where it would, had the camera `stayed` as it was."""
        data = track.dataset
        rig_mm = np.concatenate([data["midline"].values[:, -3:], data["tip"].values[:, None]], axis=1)
        rig_mm = np.where(track.valid[:, None, None], rig_mm, np.nan)
        places = plane_mm_to_pixels(calibration, rig_to_plane(track, rig_mm))
        places = places if stayed else in_frame(track, places)
        ahead = places[:, 2] - places[:, 0]
        sigma_px = data["tip_sigma"].values * data.attrs["px_per_mm"]
        return cls(places[:, 3], sigma_px, np.arctan2(ahead[:, 1], ahead[:, 0]))

    def at(self, frames: NDArray[np.int64]) -> Ends:
        """Those of some frames, by their numbers."""
        return Ends(self.tip_px[frames], self.sigma_px[frames], self.heading_rad[frames])

    @classmethod
    def none(cls, frames: int) -> Ends:
        """What a film gives that was refused."""
        return cls(np.full((frames, 2), np.nan), np.full((frames, 2), np.nan), np.full(frames, np.nan))


def mark_places(pictures: Iterable[NDArray[np.uint8]], colour: str, start_px: ArrayLike) -> Floats:
    """Middle of the coloured patch at `start_px` in every picture (h, w, 3) BGR: (frames, 2) px, NaN where it is not seen whole.

    A pixel is the mark's by how far its colour's channel stands out from the other two; the patch is sought near its last place.
    """
    at, least, area, found = np.asarray(start_px, dtype=float), None, 0.0, []
    for picture in pictures:
        stands_out = _standing_out(picture, CHANNEL[colour])
        if least is None:
            x, y = np.round(at).astype(int)
            least = max(MARK_SHARE * float(np.median(stands_out[y - 3 : y + 4, x - 3 : x + 4])), 1.0)
            area = _patch(stands_out, least, at, 2.0 * max(picture.shape))[1]
        diameter = 2 * np.sqrt(area / np.pi)
        place, size = _patch(stands_out, least, at, MARK_REACH * diameter)
        whole = MARK_AREA[0] * area < size < MARK_AREA[1] * area
        at = place if whole else at
        found.append(place if whole else [np.nan, np.nan])
    return np.array(found, dtype=float).reshape(-1, 2)


def _standing_out(picture: NDArray[np.uint8], channel: int) -> Floats:
    """How far a colour exceeds the other two, (h, w)."""
    planes = cv2.GaussianBlur(picture, (3, 3), 0).astype(np.int16)
    others = np.delete(planes, channel, axis=2)
    return (planes[:, :, channel] - others.max(axis=2)).astype(float)


def _patch(stands_out: Floats, least: float, near_px: Floats, reach_px: float) -> tuple[Floats, float]:
    """Middle (2,) and area (px) of the patch that is nearest to a place by its middle, within `reach_px`; area 0: there is none."""
    _, _, stats, middles = cv2.connectedComponentsWithStats((stands_out > least).astype(np.uint8))
    apart = np.linalg.norm(middles[1:] - near_px, axis=1)
    areas = stats[1:, cv2.CC_STAT_AREA].astype(float)
    # Specks of the same colour may lie nearer than the patch's middle.
    apart[(areas < 0.2 * areas[apart <= reach_px].max(initial=0.0)) | (apart > reach_px)] = np.inf
    if not np.isfinite(apart).any():
        return np.full(2, np.nan), 0.0
    best = int(np.argmin(apart))
    return middles[1 + best], float(areas[best])


@dataclass(frozen=True)
class Score:
    """What a track is worth: shares of 1, errors over the range, and numbers of frames.

    `error` is the root mean square of how far the line's end lies off where the tip is known to have been, NaN where no such frame was
    read; `off` is the same over the half width of the body: what moves little has a large error. `carried` is that of the place which
    lies beside the line's end as the tip did in the first of these frames, and turns with it: what was off from the start, as a mark
    beside the middle of the body, counts for nothing there.
    """

    read: int
    frames: int
    compared: int
    error: float
    off: float
    carried: float
    covered: float
    sure_and_wrong: int
    range_px: float


def score(ends: Ends, true_px: Floats, hand_px: float, half_width_px: float) -> Score:
    """Hold the ends of a line against what is known of them.

    Parameters
    ----------
    true_px : (frames, 2) places that are known, NaN where they are not
    hand_px : standard error of each component of `true_px`
    half_width_px : of the body
    """
    read = np.isfinite(ends.tip_px).all(axis=1)
    known = np.isfinite(true_px).all(axis=1)
    range_px = float(np.ptp(true_px[known], axis=0).max())
    both = read & known
    off = ends.tip_px[both] - true_px[both]
    beyond = np.abs(off) / np.hypot(ends.sigma_px[both], hand_px)
    apart = np.linalg.norm(off, axis=1)
    astray = (apart > ASTRAY * half_width_px) & (beyond > SURE).any(axis=1)
    compared = int(both.sum())
    return Score(
        read=int(read.sum()),
        frames=len(read),
        compared=compared,
        error=_rms(apart) / range_px,
        off=_rms(apart) / half_width_px,
        carried=_rms(np.abs(_as_numbers(off) - _carried(off, ends.heading_rad[both]))) / range_px,
        covered=float(np.mean(beyond < CERTAIN)) if compared else np.nan,
        sure_and_wrong=int(astray.sum()),
        range_px=range_px,
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def _as_numbers(places: Floats) -> NDArray[np.complex128]:
    """Places (n, 2) as complex numbers, which turn by a product."""
    return places[:, 0] + 1j * places[:, 1]


def _carried(off: Floats, heading_rad: Floats) -> NDArray[np.complex128]:
    """What the first of the differences (n, 2) becomes where the line's end has turned."""
    return np.exp(1j * (heading_rad - heading_rad[:1])) * _as_numbers(off[:1])


def known_middles(film: FilmFile) -> dict[int, Floats]:
    """Where the middle of the body is known to have been: places (n, 2) px by the frames as they are read."""
    rows = {film.row_of(number): np.array(places, dtype=float) for number, places in film.middles.items()}
    return {row: places for row, places in rows.items() if row is not None}


def known_places(film: FilmFile, source: FrameSource) -> Floats:
    """Where the tip is known to have been in the frames that are read: (frames, 2) px, NaN where it is not."""
    if film.mark is not None:
        return mark_places((picture for _, picture in source.colours()), film.mark, film.camera.tip)  # pyright: ignore[reportArgumentType]
    known = np.full((len(source.times_s()), 2), np.nan)
    for number, place in film.tips.items():
        if place is not None:
            known[film.row_of(number)] = place
    return known
