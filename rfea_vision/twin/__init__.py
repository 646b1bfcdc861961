"""An independent plant and a camera looking at it: campaigns whose physics is known, to test the tool on."""

from rfea_vision.twin.options import HIDDEN, OUTSIDE, BaseParameters, TwinOptions, paper_campaign, parse_hidden
from rfea_vision.twin.stress import Stress, parse_scene
from rfea_vision.twin.writer import simulate

__all__ = [
    "HIDDEN",
    "OUTSIDE",
    "BaseParameters",
    "Stress",
    "TwinOptions",
    "paper_campaign",
    "parse_hidden",
    "parse_scene",
    "simulate",
]
