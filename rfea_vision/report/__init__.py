"""One offline page per campaign: reads saved artefacts, computes nothing beyond decimation and formatting."""

from rfea_vision.report.batch import render_comparison, render_index
from rfea_vision.report.notebook import render_notebook
from rfea_vision.report.page import render

__all__ = ["render", "render_comparison", "render_index", "render_notebook"]
