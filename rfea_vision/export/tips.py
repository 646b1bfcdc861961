"""A track as a table: one row per frame, the tip and the bend angle with their standard errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from rfea_vision.arrays import FloatArray
from rfea_vision.files import write_text

#: Decimals at most: microseconds, nanometres, microdegrees; and the share of the least standard error that the last of them tells.
DIGITS, TOLD = 6, 0.01


def tip_table(data: xr.Dataset) -> pd.DataFrame:
    """Return when and where the tip was, in the columns in which `rfea_vision.readers.tracks` reads them.

    Parameters
    ----------
    data : a track or recording: ``tip`` (time, xy) and ``tip_sigma`` in mm, ``bend_angle`` (time) and ``bend_angle_sigma`` in deg,
        as far as it has them

    Returns
    -------
    pandas.DataFrame
        ``time_s`` on the clock of `data`; ``tip_x_mm``, ``tip_y_mm`` in the rig frame with ``sigma_x_mm``, ``sigma_y_mm`` and, as the
        root mean square of both, ``sigma_mm``; ``angle_deg``, ``sigma_deg``; ``reason``. A frame that was set aside has no numbers
        beside its time, and a reason.
    """
    columns: dict[str, object] = {"time_s": data["time"].values}
    if "tip" in data:
        (x, y), (across, along) = data["tip"].values.T, data["tip_sigma"].values.T
        columns |= {"tip_x_mm": x, "tip_y_mm": y, "sigma_mm": np.sqrt((across**2 + along**2) / 2)}
        columns |= {"sigma_x_mm": across, "sigma_y_mm": along}
    if "bend_angle" in data:
        columns |= {"angle_deg": data["bend_angle"].values, "sigma_deg": data["bend_angle_sigma"].values}
    return pd.DataFrame(columns | {"reason": data["reason"].values.astype(str)})


def _decimals(sigma: FloatArray) -> int:
    """Decimals of what has these standard errors (t,): the last is a hundredth of the least of them, or less."""
    known = sigma[sigma > 0]
    return int(np.clip(np.ceil(-np.log10(TOLD * known.min())), 0, DIGITS)) if known.size else DIGITS


def write_tip(path: Path, data: xr.Dataset) -> None:
    """Write the table of `tip_table` as CSV, in no more digits than its standard errors bear out."""
    table = tip_table(data)
    errors = {"tip_x_mm": "sigma_x_mm", "tip_y_mm": "sigma_y_mm", "angle_deg": "sigma_deg"}
    told = {name: _decimals(table[sigma].to_numpy(float)) for name, sigma in errors.items() if name in table}
    told |= {sigma: told[name] for name, sigma in errors.items() if name in table}
    if "sigma_mm" in table:
        told["sigma_mm"] = max(told["sigma_x_mm"], told["sigma_y_mm"])
    write_text(path, table.round({"time_s": DIGITS, **told}).to_csv(index=False))
