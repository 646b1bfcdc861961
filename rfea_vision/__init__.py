"""See how a soft hydraulic actuator really moves, fit the RSDA model to it, and learn which effect the model lacks.

``open_campaign`` is the way in; names are loaded on first use, so that ``import rfea_vision`` is quick.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rfea_vision.artefacts import Actuator, Calibration, Comparison, Diagnosis, Ladder, ModelFit, Recording, Track
    from rfea_vision.campaign import Campaign, load_campaign
    from rfea_vision.errors import DataError, InputError, RfeaError
    from rfea_vision.stages import Workspace, open_campaign

__version__ = "0.6.0"

# OpenCV reads this as it is loaded: a small file that unpacks to more than 268 megapixels is no photo of a tube.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 28))

_HOMES = {
    "artefacts": "Actuator Calibration Comparison Diagnosis Ladder ModelFit Recording Track",
    "campaign": "Campaign load_campaign",
    "errors": "DataError InputError RfeaError",
    "stages": "Workspace open_campaign",
}
_HOME_OF = {name: f"rfea_vision.{home}" for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "Actuator",
    "Calibration",
    "Campaign",
    "Comparison",
    "DataError",
    "Diagnosis",
    "InputError",
    "Ladder",
    "ModelFit",
    "Recording",
    "RfeaError",
    "Track",
    "Workspace",
    "__version__",
    "load_campaign",
    "open_campaign",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'rfea_vision' has no attribute '{name}'")
    value = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
