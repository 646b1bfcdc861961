"""A fitted model for other programs: C99, and an FMU."""

from rfea_vision.export.c_source import c_files
from rfea_vision.export.fitted import fitted_model
from rfea_vision.export.fmu import fmu_content

__all__ = ["c_files", "fitted_model", "fmu_content"]
