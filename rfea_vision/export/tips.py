"""A track as a table: one row per frame, the tip and the bend angle with their standard errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from rfea_vision.files import write_text

#: Decimals: microseconds, nanometres, microdegrees.
DIGITS = 6


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


def write_tip(path: Path, data: xr.Dataset) -> None:
    """Write the table of `tip_table` as CSV."""
    write_text(path, tip_table(data).round(DIGITS).to_csv(index=False))
