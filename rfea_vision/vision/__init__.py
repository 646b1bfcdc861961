"""Pictures in, `Track` out: segmentation, sub-pixel edges, centre line, curvature, elongation."""

from rfea_vision.vision.track import track_frames

__all__ = ["track_frames"]
