"""What may be asked of a fit and of a critique: declared once, read by the command line, recipes, records and the engines."""

from rfea_vision.options.critique import CritiqueOptions
from rfea_vision.options.fit import FitOptions

__all__ = ["CritiqueOptions", "FitOptions"]
