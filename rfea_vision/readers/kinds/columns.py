"""Parquet, and the logs of measuring devices: MDF. What a file announces is looked at before it is unpacked."""

from __future__ import annotations

from datetime import UTC
from pathlib import Path

import numpy as np

from rfea_vision.errors import InputError
from rfea_vision.readers.kinds.base import Kind, Table, distinct, frame_table, refuse_too_much

_FORMULA = 3  # conversion type of a channel that is computed by a formula in the file (ASAM MDF 4, cc_type 3)


def read_parquet(path: Path) -> Table:
    """Read Parquet; one repeated value in it may stand for any number of them."""
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        about = file.metadata
        groups = [about.row_group(index) for index in range(about.num_row_groups)]
        columns = [group.column(index) for group in groups for index in range(group.num_columns)]
        values = max(about.num_rows * about.num_columns, sum(column.num_values for column in columns))
        texts = {column.path_in_schema for column in columns if column.physical_type.endswith("BYTE_ARRAY")}
    refuse_too_much(path, values)
    with parquet.ParquetFile(path, read_dictionary=sorted(texts)) as file:
        return frame_table(str(path), file.read().to_pandas())


def read_mdf(path: Path) -> Table:
    """Read a measurement data file; every channel keeps its own times.

    Raises
    ------
    InputError
        If it announces too much, or a channel is computed by a formula in the file.
    """
    from asammdf import MDF

    columns, units, times = {}, {}, {}
    with MDF(path) as file:
        refuse_too_much(path, sum(group.channel_group.cycles_nr * len(group.channels) for group in file.groups))
        for group in file.groups:
            for channel in group.channels:
                if getattr(getattr(channel, "conversion", None), "conversion_type", None) == _FORMULA:
                    what = f"channel '{channel.name}' is computed by a formula in the file, which is not run"
                    raise InputError(f"{path}: {what}; export it with its values")
        started = file.header.start_time
        started = started if started.tzinfo else started.replace(tzinfo=UTC)
        for signal in file.iter_channels(skip_master=True):
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "fiu":
                name = distinct(signal.name, columns)
                columns[name] = np.asarray(signal.samples)
                units[name] = signal.unit
                times[name] = np.asarray(signal.timestamps, dtype=np.float64)
    return Table(str(path), columns, units, times, zero_s=started.timestamp())


KINDS = (
    Kind("Parquet", (".parquet",), read_parquet, extra="parquet"),
    Kind("MDF", (".mf4", ".mdf"), read_mdf, apart=True, extra="mdf"),
)
