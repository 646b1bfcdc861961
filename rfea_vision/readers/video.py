"""Frames with their times, one after the other: video containers and folders of pictures.

Time comes from the container's time stamps, never from the frame's number. The luma plane is read as it lies in the
decoder's memory: converting each frame to grey or BGR would halve the rate.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError, InvalidDataError
from av.video.stream import VideoStream
from numpy.typing import NDArray

from rfea_vision.errors import DataError, InputError
from rfea_vision.files import is_file
from rfea_vision.readers.apart import isolated
from rfea_vision.readers.pictures import (
    PICTURES,
    bits_of,
    numbered_pictures,
    pages_of,
    places_in_series,
    read_colour,
    read_grey,
    scaled,
)
from rfea_vision.readers.tables import read_table

Luma = NDArray[np.uint8]
MOST_PIXELS = 1 << 28  # of one picture; a phone's 200 megapixels are less
BT2020 = 9  # a matrix of colours, by its number in ITU-T H.273: that without constant luminance
_CONTAINERS = (
    "mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm", "avi", "mpegts", "mpeg", "mpegvideo", "m4v", "asf", "flv",
    "ogg", "nut", "h264", "hevc", "mxf", "ivf", "yuv4mpegpipe", "mjpeg", "dv", "gif",
)  # fmt: skip


@dataclass(frozen=True)
class FrameSource(ABC):
    """A sequence of pictures; iterate for ``(time_s, luma)``, luma (height, width) uint8, not to be written to.

    Attributes
    ----------
    path : the file or folder
    size : width and height in px, as displayed
    frame_count : number of frames if the container says so
    rate_Hz : nominal rate, or the override
    quarter_turns : counter-clockwise, from the file's pictures to those that are displayed
    announced_s : when the pictures end, in s after the first, if the container says so in its own time
    """

    path: Path
    size: tuple[int, int]
    frame_count: int | None
    rate_Hz: float | None
    quarter_turns: int = field(default=0, kw_only=True)
    announced_s: float | None = field(default=None, kw_only=True)

    @abstractmethod
    def times_s(self) -> NDArray[np.float64]:
        """Time of every frame in s, in display order."""

    @abstractmethod
    def frames(self, start_frame: int = 0) -> Generator[tuple[float, Luma], None, None]:
        """Frames from number `start_frame` on."""

    def colours(self, scale: float = 1.0) -> Generator[tuple[float, NDArray[np.uint8]], None, None]:
        """Frames in colour, (h, w, 3) BGR, scaled by `scale`; grey where the source has no colour."""
        for time, luma in self.frames():
            yield time, np.repeat(scaled(luma, scale)[:, :, None], 3, axis=2)

    def __iter__(self) -> Iterator[tuple[float, Luma]]:
        return self.frames()

    def damaged_s(self) -> NDArray[np.float64]:
        """From and to where (places, 2) pictures were lost or wrong in part, in s, as far as they were decoded."""
        return np.empty((0, 2))

    def frame(self, number: int) -> Luma:
        """One frame, copied; raises DataError beyond the end."""
        for _, luma in self.frames(number):
            return luma.copy()
        raise DataError(f"{self.path}: it has no frame {number}; check that the file is whole")


@dataclass(frozen=True)
class VideoSource(FrameSource):
    """A video container."""

    override_Hz: float | None = None
    threads: int = 4  # pictures decoded ahead, so that the decoder does not wait for the tracker
    first_pts_s: float = 0.0
    _cache: dict[str, NDArray[np.float64]] = field(default_factory=dict, repr=False, compare=False)
    _damaged: dict[float, float] = field(default_factory=dict, repr=False, compare=False)

    def times_s(self) -> NDArray[np.float64]:
        stamps = self._stamps_s()
        return stamps if self.override_Hz is None else np.arange(len(stamps)) / self.override_Hz

    def _stamps_s(self) -> NDArray[np.float64]:
        """What the file tells of itself."""
        if "stamps" not in self._cache:
            with _opened(self.path) as container:
                stream = container.streams.video[0]
                base = float(stream.time_base or 0)
                stamps = sorted(packet.pts for packet in container.demux(stream) if packet.pts is not None)
            times = np.array(stamps, dtype=float) * base
            self._cache["stamps"] = times - (times[0] if len(times) else 0.0)
        return self._cache["stamps"]

    def damaged_s(self) -> NDArray[np.float64]:
        return np.array(sorted(self._damaged.items())).reshape(-1, 2)

    def frames(self, start_frame: int = 0) -> Generator[tuple[float, Luma], None, None]:
        for time, frame in self._decoded(start_frame):
            yield time, self._luma(frame)

    def colours(self, scale: float = 1.0) -> Generator[tuple[float, NDArray[np.uint8]], None, None]:
        for time, frame in self._decoded(0):
            size = [max(round(scale * side), 2) for side in (frame.width, frame.height)]
            how = "AREA" if scale < 1.0 else "BICUBIC"
            try:
                small = frame.reformat(*size, format="bgr24", interpolation=how)
            except FFmpegError:  # of a film whose matrix of colours FFmpeg reads, but does not turn into another
                small = frame.reformat(*size, format="bgr24", interpolation=how, src_colorspace=BT2020)
            small = np.asarray(small.to_ndarray(), dtype=np.uint8)
            yield time, np.ascontiguousarray(np.rot90(small, self.quarter_turns) if self.quarter_turns else small)

    def _decoded(self, start_frame: int) -> Generator[tuple[float, av.VideoFrame], None, None]:
        """Decode from `start_frame` on; what is damaged is noted, and ends nothing but where the container itself does.

        A picture that cannot be decoded is left out. Those after it, like those after one that FFmpeg flags, are built on it until
        the next that stands by itself.
        """
        with _opened(self.path) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            stream.codec_context.thread_count = self.threads
            stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
            number, first, last = 0, None, -np.inf
            base = float(stream.time_base or 0)
            seek_to = self._seek(container, stream, start_frame)
            fault: FFmpegError | None = None
            damaged: float | None = None  # since when (s)
            try:
                for packet in container.demux(stream):
                    try:
                        pictures = packet.decode()
                    except InvalidDataError as error:
                        fault, damaged = error, max(last, 0.0) if damaged is None else damaged
                        self._damaged.setdefault(damaged, damaged)
                        continue
                    for frame in pictures:
                        stamp = frame.pts if frame.pts is not None else number
                        if first is None:
                            first = self.first_pts_s / base if seek_to is not None and base else stamp
                        if fault is not None or (seek_to is not None and number == 0):
                            number = int(np.searchsorted(self._stamps_s(), (stamp - first) * base - 1e-9))
                        time = (stamp - first) * base if self.override_Hz is None else number / self.override_Hz
                        time = max(time, last)
                        if frame.is_corrupt:
                            damaged = time if damaged is None else damaged
                        elif damaged is not None and frame.key_frame:
                            damaged = None
                        if number >= start_frame:
                            if damaged is not None:
                                self._damaged[damaged] = time
                            last = time
                            yield time, frame
                        number += 1
            except FFmpegError as error:
                fault = error
            if first is None and fault is not None:
                raise InputError(f"{self.path}: the video cannot be decoded ({fault}); convert it to H.264") from fault

    def _seek(self, container, stream, start_frame: int) -> int | None:
        if start_frame < 50 or self.override_Hz is not None or not stream.time_base:
            return None
        target = self.times_s()[min(start_frame, len(self.times_s()) - 1)] + self.first_pts_s
        container.seek(int(target / float(stream.time_base)), stream=stream, backward=True)
        return start_frame

    def _luma(self, frame: av.VideoFrame) -> Luma:
        if frame.format.name in ("gray", "yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "nv12"):
            plane = frame.planes[0]
            luma = np.frombuffer(memoryview(plane), dtype=np.uint8).reshape(plane.height, plane.line_size)[
                :, : plane.width
            ]
        else:
            luma = np.asarray(frame.to_ndarray(format="gray"), dtype=np.uint8)
        return np.rot90(luma, self.quarter_turns) if self.quarter_turns else luma


@dataclass(frozen=True)
class FolderSource(FrameSource):
    """Single pictures with a table of times."""

    files: tuple[Path, ...] = ()
    times: tuple[float, ...] = ()
    bits: int = 16  # that pictures of 16 bits use

    def times_s(self) -> NDArray[np.float64]:
        return np.array(self.times)

    def frames(self, start_frame: int = 0) -> Generator[tuple[float, Luma], None, None]:
        for file, time in zip(self.files[start_frame:], self.times[start_frame:], strict=True):
            luma = read_grey(file, bits=self.bits)
            if luma is None:
                raise InputError(f"{file}: not a readable picture; remove it from the frames table or copy it again")
            if (luma.shape[1], luma.shape[0]) != self.size:
                raise InputError(
                    f"{file}: {luma.shape[1]} x {luma.shape[0]} px, the first frame has {self.size[0]} x {self.size[1]}"
                )
            yield time, luma

    def colours(self, scale: float = 1.0) -> Generator[tuple[float, NDArray[np.uint8]], None, None]:
        for (time, luma), file in zip(self.frames(), self.files, strict=True):
            picture = read_colour(file, bits=self.bits)
            yield time, scaled(np.repeat(luma[:, :, None], 3, axis=2) if picture is None else picture, scale)


def _opened(path: Path) -> InputContainer:
    """Open a container of one of the kinds above, and no file that it refers to: FFmpeg also reads lists of files and addresses."""
    try:
        path.resolve(strict=True)
        return av.open(
            f"file:{path}", container_options={"protocol_whitelist": "file", "format_whitelist": ",".join(_CONTAINERS)}
        )
    except (OSError, ValueError) as error:
        if isinstance(error, FFmpegError):
            raise
        raise InputError(f"{path}: video.file cannot be opened ({error}); check the name") from error


def _announced_s(container: InputContainer, stream: VideoStream) -> float | None:
    """How long (s) a container says that its pictures last, which holds when its tail is lost; None where it does not say."""
    if stream.frames and stream.average_rate:
        return stream.frames / float(stream.average_rate)
    begins_s = float(stream.start_time * stream.time_base) if stream.start_time and stream.time_base else 0.0
    tag = re.fullmatch(r"(\d+):(\d\d):(\d\d(?:\.\d+)?)", stream.metadata.get("DURATION", ""))
    if tag is not None:
        return 3600 * float(tag[1]) + 60 * float(tag[2]) + float(tag[3]) - begins_s
    if len(container.streams) == 1 and container.duration is not None and "matroska" in container.format.name:
        return container.duration / 1e6 - begins_s
    return None


def _lies_in(file: Path, folder: Path) -> bool:
    try:
        return file.resolve().is_relative_to(folder)
    except (OSError, RuntimeError, ValueError):
        return False


def open_video(path: Path, rate_Hz: float | None = None) -> FrameSource:
    """Open a video file.

    Parameters
    ----------
    path : the container
    rate_Hz : true recording rate of a slow-motion file; overrides the time stamps

    Raises
    ------
    InputError
        If the file is missing, not a video, or empty.
    """
    if not path.is_file():
        raise InputError(f"{path}: video.file not found; check the name")
    if isolated():
        from rfea_vision.readers.film import Film

        return Film.open(path, rate_Hz=rate_Hz)
    if rate_Hz is not None and not rate_Hz > 0:
        raise InputError(f"{path}: video.rate must be positive, such as 240 Hz")
    try:
        with _opened(path) as container:
            if not container.streams.video:
                raise InputError(f"{path}: video.file holds no video stream; give a video")
            stream = container.streams.video[0]
            if stream.codec_context is None:
                raise InputError(f"{path}: video.file is of a codec that is not known here; convert it to H.264 in MP4")
            stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
            nominal = float(stream.average_rate) if stream.average_rate else None
            count = stream.frames or None
            first = next(container.decode(stream), None)
            if first is None:
                raise InputError(f"{path}: video.file holds no frame; record it again")
            size = (first.width, first.height)
            turns = round(getattr(first, "rotation", 0) / 90) % 4
            announced_s = None if rate_Hz is not None else _announced_s(container, stream)
            start = float(first.pts * stream.time_base) if first.pts is not None and stream.time_base else 0.0
    except FFmpegError as error:
        if path.stat().st_size == 0:
            raise InputError(f"{path}: video.file is empty (0 bytes); copy it again") from error
        why = error.strerror or error
        raise InputError(
            f"{path}: video.file is not a readable video ({why}); copy it again, or convert it to H.264 in MP4"
        ) from error
    if turns % 2:
        size = (size[1], size[0])
    return VideoSource(
        path, size, count, rate_Hz or nominal, rate_Hz, quarter_turns=turns, first_pts_s=start, announced_s=announced_s
    )


def open_frames(
    folder: Path, times_csv: Path | None, rate_Hz: float | None = None, *, within: Path | None = None
) -> FrameSource:
    """Open a folder of pictures listed in `times_csv` (``file`` and ``time_s``); without it all of them, in the order of their numbers.

    No picture may lie outside of `within`, where that is given: links and ``..`` in names are followed first.

    Raises
    ------
    InputError
        If the table or a picture is missing, there is neither table nor rate, or time runs backwards.
    """
    if isolated():
        from rfea_vision.readers.film import Film

        listed = None if times_csv is None else str(times_csv)
        return Film.open(folder, rate_Hz=rate_Hz, times=listed, within=None if within is None else str(within))
    files, seconds = _listed(folder, times_csv)
    where = f"{folder}: frames.folder" if times_csv is None else f"{times_csv}: frames.times"
    outside = next((file for file in files if within is not None and not _lies_in(file, within)), None)
    if outside is not None:
        raise InputError(
            f"{where}: '{outside}' leads out of the campaign's folder; copy the pictures into it, or give --trust"
        )
    missing = next((file for file in files if not is_file(file)), None)
    if missing is not None:
        raise InputError(f"{missing}: named in {(times_csv or folder).name} but not there; copy it or remove the row")
    if rate_Hz is not None:
        seconds = places_in_series(files) / rate_Hz
    if seconds is None:
        raise InputError(f"{where}: says no times; give a table with columns file,time_s, or 'rate: 240 Hz'")
    if not np.all(np.isfinite(seconds)) or np.any(np.diff(seconds) < 0):
        raise InputError(f"{where}: time_s must be finite and must not run backwards; sort the rows")
    times = tuple(seconds.tolist())
    first = read_grey(files[0])
    if first is None:
        raise InputError(f"{files[0]}: not a readable picture; copy it again")
    if (pages := pages_of(files[0])) > len(files):
        raise InputError(
            f"{files[0]}: holds {pages} pictures, and of each file one is read; save the stack as single pictures "
            "(ImageJ: File > Save As > Image Sequence)"
        )
    rate = rate_Hz or (
        1.0 / float(np.median(np.diff(times))) if len(times) > 1 and np.median(np.diff(times)) > 0 else None
    )
    return FolderSource(folder, (first.shape[1], first.shape[0]), len(files), rate, files, times, bits_of(files))


def _listed(folder: Path, times_csv: Path | None) -> tuple[tuple[Path, ...], NDArray[np.float64] | None]:
    """The pictures, at least one, and their times where a table says them."""
    if times_csv is None:
        if not (files := numbered_pictures(folder)):
            raise InputError(f"{folder}: frames.folder holds no picture ({', '.join(PICTURES)}); correct the folder")
        return files, None
    table = read_table(times_csv)
    if not table.columns.get("file", np.empty(0)).size:
        raise InputError(f"{times_csv}: frames.times needs columns file,time_s and at least one row")
    seconds = table.numbers("time_s") if "time_s" in table.columns else None
    return tuple(folder / str(name).strip() for name in table.columns["file"]), seconds
