"""Every figure of the report as a file, with its data beside it."""

from rfea_vision.figures.plates import Bars, Lines, Map, Plate, Series
from rfea_vision.figures.saving import FORMATS, save_plates

__all__ = ["FORMATS", "Bars", "Lines", "Map", "Plate", "Series", "save_plates"]
