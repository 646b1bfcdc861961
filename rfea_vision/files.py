"""Files are written whole or not at all."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # imported where a dataset is read, as it is slow to import
    import xarray as xr


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it takes the place of `path` only if the block succeeds."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_dataset(path: Path, dataset: xr.Dataset) -> None:
    """Write one dataset as compressed netCDF4, whole or not at all."""
    write_datasets(path, {None: dataset})


def write_datasets(path: Path, groups: dict[str | None, xr.Dataset]) -> None:
    """Write several datasets as groups of one netCDF4 file; the key None is the root group."""
    with whole_file(path) as temporary:
        mode = "w"
        for group, dataset in groups.items():
            encoding = {
                name: {"zlib": True, "complevel": 4, "shuffle": True}
                for name, variable in dataset.variables.items()
                if variable.dtype.kind in "fiu" and variable.ndim > 0
            }
            dataset.to_netcdf(temporary, mode=mode, group=group, engine="h5netcdf", encoding=encoding)
            mode = "a"


def read_dataset(path: Path, group: str | None = None) -> xr.Dataset:
    """Read one netCDF4 group into memory and close the file."""
    import xarray as xr

    with xr.open_dataset(path, group=group, engine="h5netcdf") as dataset:
        return dataset.load()


def sha256_of(path: Path, *, progress: Callable[[int], None] | None = None) -> str:
    """Content hash of a file, read in blocks."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
            if progress is not None:
                progress(len(block))
    return digest.hexdigest()
