"""A film that is decoded in a process of its own."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfea_vision.errors import DataError, InputError
from rfea_vision.readers.apart import ask
from rfea_vision.readers.video import FrameSource


@dataclass(frozen=True)
class Film(FrameSource):
    """A film that is decoded in the other process: the same sequence as that of a `FrameSource`."""

    given: dict[str, Any] = field(default_factory=dict)
    _cache: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def open(cls, path: Path, **given: Any) -> Film:
        """Open a video, or with `times` and `within` a folder of pictures."""
        about = ask("film", path, **given)
        told = {name: about[name] for name in ("quarter_turns", "announced_s")}
        return cls(path, tuple(about["size"]), about["frame_count"], about["rate_Hz"], given, **told)

    def times_s(self) -> NDArray[np.float64]:
        """Time of every frame in s, in display order."""
        if "times" not in self._cache:
            self._cache["times"] = ask("film times", self.path, **self.given)
        return self._cache["times"]

    def frames(self, start_frame: int = 0) -> Generator[tuple[float, NDArray[np.uint8]], None, None]:
        """Frames from number `start_frame` on."""
        return self._decoded(start=start_frame)

    def colours(self, scale: float = 1.0) -> Generator[tuple[float, NDArray[np.uint8]], None, None]:
        """Frames in colour, scaled by `scale`."""
        return self._decoded(scale=scale)

    def damaged_s(self) -> NDArray[np.float64]:
        """From and to where pictures were lost or wrong in part, as far as they were decoded."""
        return ask("film damaged", self.path, **self.given)

    def _decoded(self, **asked: float) -> Generator[tuple[float, NDArray[np.uint8]], None, None]:
        number = ask("film begin", self.path, asked=asked, **self.given)
        try:
            while (found := ask("film next", self.path, number=number)) is not None:
                yield found[0], found[1]
        finally:
            with suppress(InputError, DataError):
                ask("film end", self.path, number=number)
