"""The bytes of a netCDF file follow from its values alone."""

from __future__ import annotations

import os
import sys
from types import FrameType

import h5py
import numpy as np
import pytest
import xarray as xr

from rfea_vision.files import MOST_DATASET_BYTES, dataset_groups, read_dataset, whole_file, write_datasets, write_text
from rfea_vision.netcdf import read_own


@pytest.fixture
def groups() -> dict[str | None, xr.Dataset]:
    """Two runs with numbers, gaps, text, a dimension without values of its own, and more than one chunk."""
    rng = np.random.default_rng(0)
    made: dict[str | None, xr.Dataset] = {}
    for name, frames in (("steps", 300), ("sines", 700)):
        midline = rng.normal(size=(frames, 33, 2))
        midline[::7] = np.nan
        made[name] = xr.Dataset(
            {
                "tip": (("time", "xy"), midline[:, -1]),
                "midline": (("time", "node", "xy"), midline),
                "reason": ("time", ["", "lost", ""] * (frames // 3) + [""] * (frames % 3)),
                "valid": ("time", np.isfinite(midline[:, 0, 0])),
            },
            coords={"time": np.arange(frames) / 60.0, "xy": ["x", "y"]},
            attrs={"source": "film.mp4", "scale": 0.25, "doubts": ["none", "few"]},
        )
    return made


def test_bytes_do_not_follow_from_when_handles_are_closed(tmp_path, groups):
    quiet, held = tmp_path / "quiet.nc", tmp_path / "held.nc"
    write_datasets(quiet, groups)
    frames: list[tuple[FrameType, object]] = []
    before = sys.getprofile()
    sys.setprofile(lambda frame, _event, argument: frames.append((frame, argument)))  # as Dask's profiler, but always
    try:
        write_datasets(held, groups)
    finally:
        sys.setprofile(before)
    assert len(frames) > 1000
    assert held.read_bytes() == quiet.read_bytes()


def test_what_is_written_is_read(tmp_path, groups):
    path = tmp_path / "prediction.nc"
    write_datasets(path, groups)
    assert dataset_groups(path) == sorted(map(str, groups))
    for name, dataset in groups.items():
        xr.testing.assert_identical(read_dataset(path, name), dataset)
    again = tmp_path / "again.nc"
    write_datasets(again, {name: read_dataset(path, name) for name in groups})
    assert again.read_bytes() == path.read_bytes()


def test_a_long_name_in_any_script_can_be_written(tmp_path):
    """A name of a file has 255 bytes; that of the temporary one must have room for more than the stem."""
    path = tmp_path / f"{'軟' * 80}.txt"
    with whole_file(path) as temporary:
        temporary.write_text("soft")
    assert path.read_text() == "soft"


def test_a_dataset_without_a_frame(tmp_path, groups):
    empty = groups["steps"].isel(time=slice(0))
    write_datasets(tmp_path / "empty.nc", {None: empty})
    xr.testing.assert_identical(read_dataset(tmp_path / "empty.nc"), empty)


def test_a_folders_name_that_is_no_utf8_breaks_no_page(tmp_path):
    write_text(tmp_path / "page.html", f"rfea improve {os.fsdecode(b'Pr' + bytes([0xFC]) + b'f')}")
    assert (tmp_path / "page.html").read_text(encoding="utf-8").endswith("Pr\\udcfcf")


def _laid_out(dataset: xr.Dataset) -> list[object]:
    """All that a test of equality passes over: order, and the types of values and attributes."""
    return [
        *(
            [name, item.dtype, type(item.values), list(map(type, item.attrs.values()))]
            for name, item in dataset.variables.items()
        ),
        list(dataset.sizes.items()),
        list(dataset.coords),
        list(map(type, dataset.attrs.values())),
    ]


def test_own_files_read_as_the_library_reads_them(tmp_path, groups):
    path = tmp_path / "prediction.nc"
    whole = xr.Dataset(
        {
            "frame": (("time",), np.arange(5, dtype="int32")),
            "name": ((), "sine"),
            "rate": ((), 240.0),
            "scores": (("part",), [1.0, np.nan]),
        },
        coords={"time": np.linspace(0.0, 1.0, 5)},
    )
    write_datasets(path, {**groups, None: whole})
    for name in (None, *groups):
        own = read_own(path, name, MOST_DATASET_BYTES)
        assert own is not None
        with xr.open_dataset(path, group=name, engine="h5netcdf") as dataset:
            library = dataset.load()
        xr.testing.assert_identical(own, library)
        assert _laid_out(own) == _laid_out(library)


def test_what_the_own_reader_does_not_know_is_left_to_the_library(tmp_path, groups):
    path = tmp_path / "other.nc"
    write_datasets(path, groups)
    name = next(iter(groups))
    assert read_own(path, name, most_bytes=1000) is None, "announces more than may be read"
    assert read_own(path, "of no such name", MOST_DATASET_BYTES) is None
    with h5py.File(path, "a") as file:
        file.create_dataset("bare", data=np.zeros(3))  # HDF5 that is no netCDF: its dimension has no name
    assert read_own(path, None, MOST_DATASET_BYTES) is None
