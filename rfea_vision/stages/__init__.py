"""Stages over a campaign folder: each runs what it needs, keeps what it made, and is instant where nothing changed."""

from rfea_vision.progress import Listener, Outcome, Progress
from rfea_vision.stages.workspace import Workspace, open_campaign

__all__ = ["Listener", "Outcome", "Progress", "Workspace", "open_campaign"]
