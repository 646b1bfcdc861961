"""Fitting: parameters one can believe. Steady state first, then dynamic least squares on all training experiments."""

from rfea_vision.fitting.fit import fit_model
from rfea_vision.fitting.prediction import predict
from rfea_vision.options import FitOptions

__all__ = ["FitOptions", "fit_model", "predict"]
