"""MATLAB files: to version 7 through SciPy, 7.3 (which is HDF5) through h5py, with the same names of columns.

Struct fields become ``name.field``, of struct arrays ``name(3).field``; the columns of a matrix ``name(2)``. What Simulink
writes as a structure with time has its signals under their labels: ``log.pressure`` for ``log.signals(2).values``.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from rfea_vision.readers.kinds.base import Kind, Table, begins_with, distinct, hdf5, refuse_too_much


def read_mat(path: Path) -> Table:
    """Read a file to version 7."""
    from scipy.io import loadmat

    refuse_too_much(path, _unpacked_bytes(path) / 8)
    columns: dict[str, np.ndarray] = {}
    for name, value in loadmat(path, squeeze_me=True, struct_as_record=False).items():
        if not name.startswith("__"):
            _collect(name, value, columns)
    return Table(str(path), columns)


def _unpacked_bytes(path: Path) -> int:
    """Size (bytes) that the compressed variables of a MATLAB 5 file announce (MAT-File Format, 1-7 to 1-10)."""
    raw = path.read_bytes()
    order, at, total = "little" if raw[126:128] == b"IM" else "big", 128, 0
    while at + 8 <= len(raw):
        kind, size = (int.from_bytes(raw[at + shift : at + shift + 4], order) for shift in (0, 4))
        if kind == 15:  # miCOMPRESSED
            inner = zlib.decompressobj().decompress(raw[at + 8 : at + 8 + min(size, 1000)], 8)
            total += int.from_bytes(inner[4:8], order)
        at += 8 + size
    return total


def _collect(name: str, value: Any, columns: dict[str, np.ndarray]) -> None:
    if hasattr(value, "_fieldnames") and {"time", "signals"} <= set(value._fieldnames):
        _collect(f"{name}.time", value.time, columns)
        signals = [item for item in np.atleast_1d(value.signals) if hasattr(item, "values")]
        _collect_signals(name, ((getattr(item, "label", ""), item.values) for item in signals), columns)
    elif hasattr(value, "_fieldnames"):
        for key in value._fieldnames:
            _collect(f"{name}.{key}", getattr(value, key), columns)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for index, item in enumerate(value.ravel(), start=1):
            _collect(f"{name}({index})", item, columns)
    elif isinstance(value, np.ndarray) and value.ndim == 1 and value.size > 1:
        columns[name] = value
    elif isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "fiu":
        columns |= {f"{name}({index})": column for index, column in enumerate(value.T, start=1)}


def _collect_signals(name: str, signals: Iterable[tuple[Any, Any]], columns: dict[str, np.ndarray]) -> None:
    """Collect the labels and values of a structure with time, as Simulink's 'To Workspace' writes it."""
    for index, (label, values) in enumerate(signals, start=1):
        said = " ".join(label.split()) if isinstance(label, str) else ""
        called = distinct(f"{name}.{said}", columns) if said else f"{name}.signals({index}).values"
        _collect(called, np.squeeze(values), columns)


def read_mat73(path: Path) -> Table:
    """Read a file of version 7.3."""
    columns: dict[str, np.ndarray] = {}
    with hdf5(path) as file:
        for name in file:
            if not name.startswith("#"):
                _collect73(name, file[name], file, columns)
    return Table(str(path), columns)


def _collect73(name: str, node: Any, file: Any, columns: dict[str, np.ndarray]) -> None:
    import h5py

    if isinstance(node, h5py.Group):
        signals = node.get("signals") if "time" in node else None
        if isinstance(signals, h5py.Group) and "values" in signals:
            _collect73(f"{name}.time", node["time"], file, columns)
            labels, values = (_several(signals[key], file) if key in signals else [] for key in ("label", "values"))
            texts = ("".join(map(chr, item[()].ravel())) if item.dtype == np.uint16 else "" for item in labels)
            arrays = [item[()].T if item.ndim > 1 else item[()] for item in values]
            _collect_signals(name, zip([*texts, *[""] * len(arrays)], arrays, strict=False), columns)
            return
        for key in node:
            _collect73(f"{name}.{key}", node[key], file, columns)
        return
    made_of = node.attrs.get("MATLAB_class", b"")
    if made_of == b"char" or "MATLAB_empty" in node.attrs:
        return
    if node.dtype == h5py.ref_dtype:  # cells, and the fields of struct arrays: log(3).p is the third of log.p
        base, dot, field = name.rpartition(".")
        for index, reference in enumerate(node[()].T.ravel(), start=1):
            item = f"{base}({index}){dot}{field}" if dot and made_of != b"cell" else f"{name}({index})"
            _collect73(item, file[reference], file, columns)
        return
    values = node[()].T if node.ndim == 2 else node[()]  # MATLAB lies column by column
    if values.dtype.kind in "fiu":
        _collect(name, np.squeeze(values), columns)


def _several(node: Any, file: Any) -> list[Any]:
    """Return what a field holds in each struct of an array of them; of a single struct that one."""
    import h5py

    return [file[item] for item in node[()].T.ravel()] if node.dtype == h5py.ref_dtype else [node]


KINDS = (
    Kind("MATLAB 7.3", (".mat",), read_mat73, begins_with(b"MATLAB 7.3", within=32), apart=True),
    Kind("MATLAB", (".mat",), read_mat, apart=True),  # SciPy 1.17 ends with a segmentation fault on some
)
