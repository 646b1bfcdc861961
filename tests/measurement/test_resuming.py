"""A long video that is interrupted goes on where it was, and ends with the same track."""

from dataclasses import dataclass

import numpy as np
import pytest

from rfea_vision.artefacts import Actuator
from rfea_vision.errors import InputError
from rfea_vision.vision import track_frames
from rfea_vision.vision.follow import checkpoint

from .scenes import Look, bending, film
from .sources import MemorySource, memory_source, true_calibration


@dataclass(frozen=True)
class Cut(MemorySource):
    """A source that breaks off: the machine was switched off."""

    after: int = 20

    def frames(self, start_frame: int = 0):
        for number, frame in enumerate(super().frames(start_frame), start_frame):
            if number == self.after:
                raise KeyboardInterrupt
            yield frame


def cut(source: MemorySource, after: int) -> Cut:
    return Cut(source.path, source.size, source.frame_count, None, source.pictures, source.times, after)


@pytest.fixture(scope="module")
def source(small_lens):
    pictures, times, _ = film(small_lens, Look(), bending(np.arange(40) / 120), rate_Hz=120)
    pictures[25] = np.full_like(pictures[25], 60)
    for number, image in enumerate(pictures):
        image[600:620, 20:40] = 200 if number % 10 < 5 else 30
    return memory_source(pictures, times)


def test_an_interrupted_run_ends_with_the_same_result(source, small_lens, tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    calibration, file = true_calibration(small_lens), tmp_path / "so-far.npz"
    whole = track_frames(source, calibration, Actuator(), lamp_box=(22, 602, 16, 16))
    for after in (12, 27):  # twice, the second time after a frame that was rejected
        with pytest.raises(KeyboardInterrupt):
            track_frames(cut(source, after), calibration, Actuator(), lamp_box=(22, 602, 16, 16), checkpoint=file)
        assert file.is_file()
    begun_at = []

    @dataclass(frozen=True)
    class Watched(MemorySource):
        def frames(self, start_frame: int = 0):
            begun_at.append(start_frame)
            return super().frames(start_frame)

    watched = Watched(source.path, source.size, source.frame_count, None, source.pictures, source.times)
    track = track_frames(watched, calibration, Actuator(), lamp_box=(22, 602, 16, 16), checkpoint=file)
    assert begun_at == [27]
    assert track.dataset.identical(whole.dataset)
    assert not file.exists()


def test_what_was_kept_for_another_tube_or_is_damaged_is_not_used(source, small_lens, tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    calibration, file = true_calibration(small_lens), tmp_path / "so-far.npz"
    with pytest.raises(KeyboardInterrupt):
        track_frames(cut(source, 10), calibration, Actuator(length=0.15), checkpoint=file)
    left = file.read_bytes()
    whole = track_frames(source, calibration, Actuator())
    for content in (left, left[: len(left) // 2]):
        file.write_bytes(content)
        assert track_frames(source, calibration, Actuator(), checkpoint=file).dataset.identical(whole.dataset)


def test_the_lamp_is_read_in_every_frame(source, small_lens):
    track = track_frames(source, true_calibration(small_lens), Actuator(), lamp_box=(22, 602, 16, 16))
    lamp = track.dataset["lamp"].values
    on = np.arange(40) % 10 < 5
    np.testing.assert_allclose(lamp[on & (np.arange(40) != 25)], 200)
    np.testing.assert_allclose(lamp[~on], 30)
    with pytest.raises(InputError, match=r"sync\.box"):
        track_frames(source, true_calibration(small_lens), Actuator(), lamp_box=(900, 10, 5, 5))
