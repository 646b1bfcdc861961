"""One offline page per campaign: reads saved artefacts, computes nothing beyond decimation and formatting."""

from rfea_vision.report.page import render

__all__ = ["render"]
