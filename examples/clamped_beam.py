"""A campaign from the recordings of a clamped silicone beam that is let go by hand, bare and with a load at its tip.

    python examples/clamped_beam.py OUT --bare gravity_a.csv gravity_b.csv --loaded load52_a.csv load52_b.csv

The tables are those of https://github.com/srl-ethz/diffPD_sim2real (MIT), as optical motion capture gave them: markers ``tip1``
to ``tip3`` and ``base1`` to ``base3``, mm, x across the beam with gravity towards -x, z along it from clamp to tip. The first
run of each kind is fitted, the others are held out. That the bare runs carry nothing is told to the tool (`conditions`); what
the loaded ones carry is for `rfea improve OUT` to find.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

# Section and density are the authors' own. Their 100 mm are the whole beam; what swings is what the markers see of it, from
# those at the clamp to those at the tip.
HELD_ROWS = 10  # a tenth of a second, in which every run is still held
CAMPAIGN = """format: rfea-campaign/1
name: clamped-beam
actuator:
  length: LENGTH mm
  density: 1070 kg/m^3
  bends: left
  section: {kind: rectangle, width: 30 mm, thickness: 30 mm}
rig: {gravity: left}              # across the beam; the rig's y is along it, the clamp above
pressure: {value: 0 kPa}          # there is no chamber
start: {shape: measured, held_until: auto}
"""


def track(table: pd.DataFrame, length_mm: float) -> pd.DataFrame:
    """Tip of the beam in the rig frame: x from where it was held straight, y from the clamp."""
    x, z = _tip_from_clamp(table)
    held = slice(0, HELD_ROWS)
    return pd.DataFrame(
        {
            "time_s": table["time_s"],
            "tip_x_mm": np.round(x - x[held].median(), 4),
            "tip_y_mm": np.round(-length_mm - (z - z[held].median()), 4),
        }
    )


def free_length_mm(table: pd.DataFrame) -> float:
    """Length of the beam between the markers at its clamp and those at its tip, while it is held straight."""
    return round(float(_tip_from_clamp(table)[1][:HELD_ROWS].median()), 1)


def _tip_from_clamp(table: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """Across and along the beam, mean of the markers at the tip less that of those at the clamp (mm)."""
    tip = {way: table[[f"tip{k}_{way}_mm" for k in (1, 2, 3)]].mean(axis=1) for way in "xz"}
    clamp = {way: table[[f"base{k}_{way}_mm" for k in (1, 2, 3)]].mean(axis=1) for way in "xz"}
    return tip["x"] - clamp["x"].median(), tip["z"] - clamp["z"].median()


def write(out: Path, bare: list[Path], loaded: list[Path]) -> None:
    """Write the campaign folder."""
    out.mkdir(parents=True, exist_ok=True)
    length_mm = free_length_mm(pd.read_csv(bare[0]))
    (out / "campaign.yaml").write_text(CAMPAIGN.replace("LENGTH", str(length_mm)), encoding="utf-8")
    for files, known in ((bare, "conditions: {payload: 0 g}\n"), (loaded, "")):
        for index, file in enumerate(files):
            folder = out / file.stem
            folder.mkdir(exist_ok=True)
            track(pd.read_csv(file), length_mm).to_csv(folder / "track.csv", index=False)
            role = "train" if index == 0 else "validate"
            text = f"format: rfea-experiment/1\nname: {file.stem}\nrole: {role}\ntrack: {{file: track.csv}}\n{known}"
            (folder / "experiment.yaml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--bare", type=Path, nargs="+", required=True, help="tables of the bare beam; the first is fitted"
    )
    parser.add_argument("--loaded", type=Path, nargs="+", default=[], help="tables with one load; the first is fitted")
    given = parser.parse_args()
    write(given.out, given.bare, given.loaded)
