"""What this machine has of what rfea needs."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import tempfile
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from rfea_vision import __version__

_NEEDED = {
    "numpy": ("numpy", "everything"),
    "scipy": ("scipy", "fitting"),
    "numba": ("numba", "dynamics"),
    "sympy": ("sympy", "laws of effects"),
    "xarray": ("xarray", "artefacts"),
    "h5netcdf": ("h5netcdf", "artefacts"),
    "av": ("av", "video"),
    "opencv-python-headless": ("cv2", "calibration, tracking"),
}
_OPTIONAL = {
    "mujoco": ("mujoco", "rfea simulate: pip install 'rfea-vision[twin]'"),
    "distributed": ("distributed", "rfea batch: pip install 'rfea-vision[batch]'"),
    "pyarrow": ("pyarrow", "logs in .parquet: pip install 'rfea-vision[parquet]'"),
    "asammdf": ("asammdf", "logs in .mf4: pip install 'rfea-vision[mdf]'"),
    "sqlalchemy": ("sqlalchemy", "logs in databases: pip install 'rfea-vision[database]'"),
    "starlette": ("starlette", "rfea open: pip install 'rfea-vision[workbench]'"),
    "matplotlib": ("matplotlib", "rfea figures: pip install 'rfea-vision[figures]'"),
    "plotly": ("plotly", "figures of a notebook: pip install 'rfea-vision[notebook]'"),
    "ezc3d": ("ezc3d", "motion capture in .c3d: pip install 'rfea-vision[capture]'"),
    "ndx-pose": ("ndx_pose", "rfea export --nwb: pip install 'rfea-vision[nwb]'"),
    "rosbags": ("rosbags", "recordings of ROS: pip install 'rfea-vision[ros]'"),
}
#: Larger packages that bring the same module.
_ALSO = {"opencv-python-headless": "opencv-contrib-python-headless"}
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@dataclass(frozen=True)
class Checked:
    """One thing looked at: ``ok``, ``absent`` (something optional) or ``broken``."""

    what: str
    state: Literal["ok", "absent", "broken"]
    found: str
    purpose: str


def examine() -> list[Checked]:
    """Look at Python, the packages, the processors, the folders and the browser."""
    python_ok = sys.version_info >= (3, 11)
    findings = [
        Checked("rfea-vision", "ok", __version__, ""),
        Checked("python", "ok" if python_ok else "broken", platform.python_version(), "3.11 or newer"),
        Checked("processors", "ok", str(os.cpu_count()), "tracking and fitting use two"),
    ]
    findings += [_package(name, module, purpose, needed=True) for name, (module, purpose) in _NEEDED.items()]
    findings += [_package(name, module, purpose, needed=False) for name, (module, purpose) in _OPTIONAL.items()]
    browser = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    findings.append(Checked("browser", "ok" if browser else "absent", browser or "-", "tests of the report"))
    temporary = Path(tempfile.gettempdir())
    writable = os.access(temporary, os.W_OK)
    findings.append(Checked("temporary folder", "ok" if writable else "broken", str(temporary), "unfinished files"))
    return findings


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _package(name: str, module: str, purpose: str, *, needed: bool) -> Checked:
    found = _version(name) or _version(_ALSO.get(name, name))
    if found is None:
        return Checked(name, "broken" if needed else "absent", "not installed", purpose)
    try:
        import_module(module)
    except Exception as error:  # a broken binary raises whatever it likes; that is what is looked for here
        reason = " ".join(str(error).split())
        return Checked(name, "broken", f"{found} does not load ({reason[:80]})", purpose)
    return Checked(name, "ok", found, purpose)
