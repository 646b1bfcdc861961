"""The saved nouns that the stages hand to one another: frozen, shape-checked, with save and load."""

from rfea_vision.artefacts.judgement import (
    Candidate,
    Comparison,
    Diagnosis,
    EffectSet,
    ExperimentScore,
    Floors,
    Ladder,
    Metrics,
    ModelFit,
    NextExperiment,
    Parameter,
    Remainder,
    Rung,
    Tie,
    WorstPlace,
)
from rfea_vision.artefacts.measurement import Actuator, Calibration, Hints, Recording, Track, bend_sign

__all__ = [
    "Actuator",
    "Calibration",
    "Candidate",
    "Comparison",
    "Diagnosis",
    "EffectSet",
    "ExperimentScore",
    "Floors",
    "Hints",
    "Ladder",
    "Metrics",
    "ModelFit",
    "NextExperiment",
    "Parameter",
    "Recording",
    "Remainder",
    "Rung",
    "Tie",
    "Track",
    "WorstPlace",
    "bend_sign",
]
