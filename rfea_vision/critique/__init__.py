"""The critique: where the model fails, which effect is missing, and the ladder of models that mends it."""

from rfea_vision.critique.comparison import compare
from rfea_vision.critique.diagnosis import diagnose
from rfea_vision.critique.ladder import improve
from rfea_vision.critique.power import power_study
from rfea_vision.critique.propose import propose
from rfea_vision.critique.torque import with_residual_torque

__all__ = ["compare", "diagnose", "improve", "power_study", "propose", "with_residual_torque"]
