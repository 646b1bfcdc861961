"""One group of a netCDF4 file as this package writes it, read by HDF5 alone.

h5netcdf looks every variable up by its path for each thing that it asks of it: of a recording with twenty variables that takes ten
times as long as to read the numbers. What is not as this package writes it is left to h5netcdf.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # slow to import
    import h5py
    import xarray as xr


def read_own(path: Path, group: str | None, most_bytes: int) -> xr.Dataset | None:
    """Read one group into memory; None where another reader is to be asked, who will also say what is wrong with a file.

    Parameters
    ----------
    group : its name; the file's own by default
    most_bytes : a group that announces more is not read
    """
    import h5py
    import xarray as xr

    try:
        with h5py.File(path, "r") as file:
            place: Any = file if group is None else file[group]
            items = [(name, item) for name, item in place.items() if isinstance(item, h5py.Dataset)]
            dimensions = _dimensions(items)
            if dimensions is None or sum(item.nbytes for _, item in items) > most_bytes:
                return None
            variables = {name: _variable(item, dimensions[name]) for name, item in items if not _is_bare(item)}
            made = xr.decode_cf(xr.Dataset(variables, attrs=_attributes(place)))
            in_order = {name: made.variables[name] for name in (*made.data_vars, *made.coords)}
            return xr.Dataset(in_order, attrs=made.attrs).set_coords(list(made.coords))
    except Exception:  # whatever it is, the other reader meets it, too, and its words are known
        return None


def _dimensions(items: list[tuple[str, h5py.Dataset]]) -> dict[str, tuple[str, ...]] | None:
    """Names of the dimensions of each variable; None if one stands in another group or has none."""
    scales = {item.id.__hash__(): name for name, item in items if item.attrs.get("CLASS") == b"DIMENSION_SCALE"}
    found = {}
    for name, item in items:
        if item.attrs.get("CLASS") == b"DIMENSION_SCALE":
            if item.ndim != 1:
                return None
            found[name] = (name,)
            continue
        references = item.attrs.get("DIMENSION_LIST", ())
        if len(references) != item.ndim:
            return None
        names = [scales.get(item.file[one[0]].id.__hash__()) if len(one) == 1 else None for one in references]
        if None in names:
            return None
        found[name] = tuple(names)
    return found


def _is_bare(item: h5py.Dataset) -> bool:
    """Whether a dimension has a length and no values."""
    return bytes(item.attrs.get("NAME", b"")).startswith(b"This is a netCDF dimension but not a netCDF variable")


def _variable(item: h5py.Dataset, dimensions: tuple[str, ...]) -> xr.Variable:
    import h5py
    import xarray as xr

    if h5py.check_string_dtype(item.dtype) is not None:
        return xr.Variable(dimensions, item.asstr()[()], _attributes(item), {"dtype": str})
    if item.dtype.kind not in "fiu":
        raise ValueError(item.dtype)
    return xr.Variable(dimensions, item[()], _attributes(item), {"dtype": item.dtype})


def _attributes(item: h5py.Dataset | h5py.Group) -> dict[str, object]:
    import h5py
    from h5netcdf.attrs import Attributes

    attributes = dict(Attributes(item.attrs, None, h5py))
    return {
        name: value.decode("utf-8") if isinstance(value, bytes) and name != "_FillValue" else value
        for name, value in attributes.items()
    }
