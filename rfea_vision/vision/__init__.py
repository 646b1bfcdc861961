"""Pictures in, `Track` out: segmentation, sub-pixel edges, centre line, curvature, elongation."""

from rfea_vision.vision.body.midline import Midline, Refusal, midline_from_mask
from rfea_vision.vision.show.clip import make_clip
from rfea_vision.vision.show.preview import preview_video
from rfea_vision.vision.track import track_frames

__all__ = ["Midline", "Refusal", "make_clip", "midline_from_mask", "preview_video", "track_frames"]
