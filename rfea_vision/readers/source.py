"""The pictures of a run, as its specification names them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rfea_vision.errors import InputError

if TYPE_CHECKING:
    from rfea_vision.campaign.specs import VideoSpec
    from rfea_vision.readers.video import FrameSource


def open_source(video: VideoSpec) -> FrameSource:
    """Open a video or a folder of frames.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    from rfea_vision.readers.video import open_frames, open_video  # brings FFmpeg with it

    if video.file is not None:
        return open_video(video.file, video.rate_Hz)
    if video.frames is None:
        raise InputError("video: the pictures that it names are not there")
    return open_frames(video.frames, video.times, video.rate_Hz, within=video.within)
