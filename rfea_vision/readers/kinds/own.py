"""Tracks of this program, as `rfea track` has written them: who has put the film away goes on from a copy of its track."""

from __future__ import annotations

from pathlib import Path

from rfea_vision.errors import InputError
from rfea_vision.files import read_dataset
from rfea_vision.readers.kinds.base import Kind, Table, has_members, hdf5


def read_own(path: Path) -> Table:
    """Read a track with all that it holds, and what is measured of its tip as columns.

    Raises
    ------
    InputError
        If it is a recording, which is on the log's clock.
    """
    with hdf5(path):
        pass  # looks for what lies elsewhere
    dataset = read_dataset(path)
    if "pressure" in dataset:
        raise InputError(f"{path}: is a recording, on the clock of its log; give the track.nc beside it")
    columns = {"time_s": dataset["time"].values}
    if "tip" in dataset:
        columns |= {f"tip_{axis}_mm": dataset["tip"].values[:, place] for place, axis in enumerate("xy")}
    if "bend_angle" in dataset:
        columns |= {"angle_deg": dataset["bend_angle"].values}
    return Table(str(path), columns, track=dataset.to_dict(data="array", encoding=False))


KINDS = (Kind("track.nc of rfea", (".nc",), read_own, has_members("valid", "reason", "time"), apart=True),)
