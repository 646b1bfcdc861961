"""Campaign folders: from files that people write to typed inputs, with errors that name file, line, key and remedy."""

from rfea_vision.campaign.loading import Reading, load_campaign, read_campaign
from rfea_vision.campaign.problems import FileProblem
from rfea_vision.campaign.specs import (
    CameraSpec,
    Campaign,
    ExperimentSpec,
    PressureSpec,
    TrackSpec,
    VideoSpec,
)

__all__ = [
    "CameraSpec",
    "Campaign",
    "ExperimentSpec",
    "FileProblem",
    "PressureSpec",
    "Reading",
    "TrackSpec",
    "VideoSpec",
    "load_campaign",
    "read_campaign",
]
