"""Pictures in, `Track` out: segmentation, sub-pixel edges, centre line, curvature, elongation."""

from rfea_vision.vision.show.clip import make_clip
from rfea_vision.vision.show.preview import preview_video
from rfea_vision.vision.track import track_frames

__all__ = ["make_clip", "preview_video", "track_frames"]
