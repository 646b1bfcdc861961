"""Files are written whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import re
import socket
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from rfea_vision.errors import DataError, InputError, RfeaError

if TYPE_CHECKING:  # imported where a dataset is read, as it is slow to import
    import xarray as xr


MOST_DATASET_BYTES = 1 << 31  # half a million frames with 64 places along the tube
_FULL, _GONE = (errno.ENOSPC, errno.EDQUOT), (errno.ENOENT, errno.ESTALE, errno.EIO, errno.ENODEV)
_IN_THE_WAY = (errno.EEXIST, errno.ENOTDIR, errno.EISDIR, errno.ENOTEMPTY)
_LEAST_FREE_BYTES = 1 << 16  # libraries in C do not always say that the last block was not written
_COMPRESSED: dict[str, object] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
_MARK = f"{zlib.crc32(socket.gethostname().encode()):08x}"
_UNFINISHED = re.compile(r"^\..*~([0-9a-f]{8})-(\d+)~")
_TEMPORARY = re.compile(r"\.([^/\\]*)~[0-9a-f]{8}-\d+~[^/\\.]*(\.[^/\\.]*)?$")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it takes the place of `path` only if the block succeeds.

    Raises
    ------
    DataError
        If the disk is full.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    prefix = f".{os.fsencode(path.stem)[:80].decode(errors='ignore')}~{_MARK}-{os.getpid()}~"
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=prefix, suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        try:
            yield temporary
        except Exception as error:
            if "No space left on device" in str(error) or (_is_full(path.parent) and not isinstance(error, RfeaError)):
                raise DataError(_full(path)) from error
            raise
        if _is_full(path.parent):
            raise DataError(_full(path))
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(path)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def sweep(folder: Path) -> None:
    """Remove what commands that were killed on this machine left unfinished below `folder`."""
    for place, _, names in os.walk(folder):
        for name in names:
            match = _UNFINISHED.match(name)
            if match and match[1] == _MARK and not _is_running(int(match[2])):
                with suppress(OSError):
                    Path(place, name).unlink()


def storage_error(error: OSError, elsewhere: str = "keep the results elsewhere with --out DIR") -> RfeaError | None:
    """What a fault of the disk means, as an error with one sentence; None if it is none. `elsewhere`: how to write to another place.

    A place that may not be written to is wrong usage, as results may go elsewhere; all else is a state of the machine.
    """
    # of a file that was being written its own name, not that of the temporary one
    where = _TEMPORARY.sub(r"\1\2", str(error.filename2 or error.filename or "the folder of results"))
    kept = "what was finished is kept"
    if error.errno in _FULL:
        return DataError(_full(where))
    if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
        return InputError(f"{where}: {error.strerror}; allow it, or {elsewhere}; {kept}")
    # a folder that goes away while it is looked at is said to be there, and no folder
    if error.errno in _GONE or (error.errno in _IN_THE_WAY and not os.path.lexists(where)):
        gone = "it went away while it was worked on: bring it back and run the command again"
        return DataError(f"{where}: {error.strerror}; {gone}; {kept}")
    if error.errno in _IN_THE_WAY:
        in_the_way = "a file stands where a folder belongs, or a folder where a file does: move it away"
        return DataError(f"{where}: {error.strerror}; {in_the_way}; {kept}")
    return None


def _full(where: object) -> str:
    return f"{where}: the disk is full; make room and run the same command again; what was finished is kept"


def _is_full(folder: Path) -> bool:
    try:
        state = os.statvfs(folder)
    except (OSError, AttributeError):
        return False
    return state.f_blocks > 0 and state.f_bavail * state.f_frsize < _LEAST_FREE_BYTES


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def is_file(path: Path) -> bool:
    """Whether a plain file lies there; a path that the system cannot even look at is none."""
    return _is(path.is_file)


def is_folder(path: Path) -> bool:
    """Whether a folder lies there."""
    return _is(path.is_dir)


def is_link(path: Path) -> bool:
    """Whether a symbolic link lies there, wherever it leads."""
    return _is(path.is_symlink)


def _is(look: Callable[[], bool]) -> bool:
    try:
        return look()
    except (OSError, ValueError):
        return False


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8, whole or not at all; bytes of a file's name that are no UTF-8 as their numbers."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_dataset(path: Path, dataset: xr.Dataset) -> None:
    """Write one dataset as compressed netCDF4, whole or not at all."""
    write_datasets(path, {None: dataset})


def write_datasets(path: Path, groups: dict[str | None, xr.Dataset]) -> None:
    """Write several datasets as groups of one netCDF4 file; the key None is the root group.

    The same values give the same bytes, wherever they came from: neither how a dataset lay in the file that it was read from
    counts, nor the order in which its variables came to it, nor when Python lets go of the handles that they were written with
    (a garbage collector decides that, and a profiler such as the one of Dask's workers, which holds the frames that it looks
    at). HDF5 keeps chunks back until a handle is closed, so it is given no room to keep any; and it fills what was deleted
    only then, so nothing is: h5netcdf would make each coordinate twice, as a dimension and anew with its values. The file is
    made in memory, for on a full disk HDF5 says so in tracebacks that nobody can catch.
    """
    import h5netcdf
    import h5py
    from xarray.backends import H5NetCDFStore

    ordered = {group: dataset[sorted(dataset.variables, key=str)].drop_encoding() for group, dataset in groups.items()}
    made = io.BytesIO()
    with h5py.File(made, "w", rdcc_nbytes=0, track_order=True) as image:
        for group, dataset in ordered.items():
            place = image if group is None else image.create_group(group, track_order=True)
            for name in sorted(str(name) for name, size in dataset.sizes.items() if size and name in dataset.variables):
                values, kept = dataset[name].values, _COMPRESSED
                if values.dtype.kind in "OU":
                    values, kept = values.astype(object), {"dtype": h5py.string_dtype()}
                place.create_dataset(name, data=values, track_order=True, **kept).make_scale(name)
        with h5netcdf.File(image, "a") as file:
            for group, dataset in ordered.items():
                numbers = [name for name, item in dataset.variables.items() if item.dtype.kind in "fiu" and item.ndim]
                store = H5NetCDFStore(file if group is None else file[group])
                dataset.dump_to_store(store, encoding=dict.fromkeys(numbers, _COMPRESSED))
    with whole_file(path) as temporary:
        temporary.write_bytes(made.getbuffer())


def read_dataset(path: Path, group: str | None = None) -> xr.Dataset:
    """Read one netCDF4 group into memory and close the file.

    Raises
    ------
    DataError
        If it cannot be read, keeps its data in other files, or announces more than `MOST_DATASET_BYTES`.
    """
    import xarray as xr

    from rfea_vision.netcdf import read_own
    from rfea_vision.readers.apart import ask, isolated

    if isolated():
        return xr.Dataset.from_dict(ask("dataset", path, group=group))
    again = "run the stage that writes it again with --force"
    try:
        _refuse_links(path)
        own = read_own(path, group, MOST_DATASET_BYTES)
        if own is not None:
            return own
        with xr.open_dataset(path, group=group, engine="h5netcdf") as dataset:
            if dataset.nbytes > MOST_DATASET_BYTES:
                raise DataError(f"{path}: announces {dataset.nbytes / 1e9:.3g} GB; {again}")
            return dataset.load()
    except FileNotFoundError as error:
        raise DataError(f"{path}: not found; {again}") from error
    except RfeaError:
        raise
    except Exception as error:  # HDF5, h5netcdf and xarray each have their own kinds
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise DataError(f"{path}: cannot be read ({reason}); {again}") from error


def dataset_groups(path: Path) -> list[str]:
    """Names of the groups of a netCDF4 file.

    Raises
    ------
    DataError
        If it cannot be read.
    """
    import h5py

    from rfea_vision.readers.apart import ask, isolated

    if isolated():
        return list(ask("groups", path))
    try:
        with h5py.File(path, "r") as file:
            return sorted(str(name) for name in file if file.get(name, getclass=True, getlink=False) is h5py.Group)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error}); run the stage that writes it again with --force") from error


def _refuse_links(path: Path) -> None:
    """HDF5 may keep data in any other file of the machine: a result of this package never does."""
    import h5py

    def look(group: h5py.Group, depth: int = 0) -> None:
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink) or depth > 8:
                raise DataError(f"{path}: '{name}' is kept in another file, which is not read; write it into one file")
            item = group.get(name) if isinstance(link, h5py.HardLink) else None
            if isinstance(item, h5py.Group):
                look(item, depth + 1)
            elif isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
                raise DataError(f"{path}: '{name}' is kept in another file, which is not read; write it into one file")

    with h5py.File(path, "r") as file:
        look(file)


def sha256_of(path: Path) -> str:
    """Content hash of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
