"""Plates to files: PDF, SVG and PNG with matplotlib, each with its data as CSV; the same bytes every time."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from rfea_vision.errors import InputError
from rfea_vision.figures.plates import Bars, Lines, Map, Plate, Role, Series, told_apart
from rfea_vision.files import whole_file, write_text

if TYPE_CHECKING:  # of an extra
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS = ("pdf", "svg", "png")
COLUMN_IN, TEXT_IN = 3.5, 7.16
"""Widths of one and of two columns of a journal page (IEEE: 88.9 and 181.9 mm)."""
_LETTER, _INSIDE = 0.6, 0.85  # width of a letter of DejaVu Sans in its size; what the axes have of a figure's width
_PAPER_PT, _SCREEN_PT = 8.0, 10.0  # size of text in a paper and on a screen
BEYOND = 0.005  # share of a map's values beyond the ends of its colours: a few wild ones would leave all others pale

# Okabe and Ito's palette, told apart by people who do not see all colours (https://jfly.uni-koeln.de/color/).
_BLUE, _ORANGE, _GREEN, _GREY, _PURPLE, _SKY = "#0072B2", "#D55E00", "#009E73", "#777777", "#CC79A7", "#56B4E9"
_CYCLE = (_PURPLE, _GREEN, _SKY, "#E69F00", "#000000", _GREY)
_STROKES: dict[Role, dict[str, Any]] = {
    "measured": {"color": _SKY, "linewidth": 2.4, "solid_capstyle": "round"},
    "modelled": {"color": "#A23B00", "linewidth": 0.8},
    "coarse": {"color": _GREEN, "linewidth": 0.9, "linestyle": (0, (4, 1.5))},
    "other": {"linewidth": 1.0},
    "dots": {"color": _BLUE, "linestyle": "none", "marker": ".", "markersize": 3.5},
    "rings": {"color": _ORANGE, "linestyle": "none", "marker": "o", "markersize": 4, "markerfacecolor": "none"},
}
_METADATA = {
    "pdf": {"CreationDate": None, "Creator": "rfea", "Producer": "rfea"},
    "svg": {"Date": None, "Creator": "rfea"},
    "png": {"Software": None},
}


def refuse_unknown_formats(formats: Sequence[str]) -> None:
    """Raise an InputError that names what is none of `FORMATS`."""
    unknown = [name for name in formats if name not in FORMATS]
    if unknown or not formats:
        raise InputError(f"--format: '{', '.join(unknown)}' is unknown; choose of {', '.join(FORMATS)}")


def save_plates(
    plates: Sequence[Plate], folder: Path, *, formats: Sequence[str] = FORMATS, style: str = "paper"
) -> list[Path]:
    """Write every plate in every format, and its data.

    Parameters
    ----------
    plates : the figures
    folder : where ``<name>.pdf``, ``<name>.csv``, ... go
    formats : of `FORMATS`
    style : ``paper`` (one or two columns of a journal wide, 8 pt) or ``screen`` (larger type)

    Raises
    ------
    InputError
        If matplotlib is not installed, or a format is unknown.
    """
    refuse_unknown_formats(formats)
    written: list[Path] = []
    with _drawing(style) as figure_of:
        for plate in told_apart(plates):
            figure = figure_of(plate)
            for ending in formats:
                target = folder / f"{plate.name}.{ending}"
                page = io.BytesIO()
                figure.savefig(page, format=ending, metadata=_METADATA[ending], dpi=300)
                with whole_file(target) as temporary:
                    temporary.write_bytes(page.getvalue())
                written.append(target)
            write_text(folder / f"{plate.name}.csv", plate.table().to_csv(index=False, float_format="%.9g"))
            written.append(folder / f"{plate.name}.csv")
    return written


def as_svg(plate: Plate) -> str:
    """One plate as SVG, to stand inside a page; its marks are named after the plate, so that two do not mix."""
    with _drawing("paper", salt=plate.name) as figure_of:
        page = io.StringIO()
        figure_of(plate).savefig(page, format="svg", metadata=_METADATA["svg"])
    text = re.sub(r"<metadata>.*?</metadata>", "", page.getvalue(), flags=re.DOTALL)
    return (
        text[text.index("<svg") :]
        .replace('id="', f'id="{plate.name}-')
        .replace('="#', f'="#{plate.name}-')
        .replace("url(#", f"url(#{plate.name}-")
    )


@contextmanager
def _drawing(style: str, salt: str = "rfea") -> Iterator[Callable[[Plate], Figure]]:
    """Give a function that draws a plate, with matplotlib set as the style asks and as it was before afterwards."""
    try:
        import matplotlib
        from cycler import cycler
        from matplotlib.figure import Figure
    except ImportError as error:
        remedy = "pip install 'rfea-vision[figures]'"
        raise InputError(f"figures need the Python module '{error.name}'; install it with: {remedy}") from error
    size = _PAPER_PT if style == "paper" else _SCREEN_PT
    settings: dict[Any, Any] = {
        "font.family": "DejaVu Sans", "font.size": size, "axes.titlesize": size, "axes.labelsize": size,
        "xtick.labelsize": size - 1, "ytick.labelsize": size - 1, "legend.fontsize": size - 1,
        "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6, "axes.spines.top": False,
        "axes.spines.right": False, "legend.frameon": False, "svg.hashsalt": salt, "svg.fonttype": "path",
        "pdf.fonttype": 42, "axes.unicode_minus": True, "path.simplify": True, "image.cmap": "viridis",
        "axes.prop_cycle": cycler(color=_CYCLE),
    }  # fmt: skip
    draw: dict[type, Callable[[Axes, Any], None]] = {Lines: _lines, Map: _map, Bars: _bars}

    def figure_of(plate: Plate) -> Figure:
        width = TEXT_IN if plate.wide else COLUMN_IN
        figure = Figure(figsize=(width, COLUMN_IN * _tallness(plate)), layout="constrained")
        draw[type(plate)](figure.subplots(), plate)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # laid out once, for all formats
        return figure

    with matplotlib.rc_context(settings):
        yield figure_of


def _tallness(plate: Plate) -> float:
    """Height of a figure in columns; of paths, which have one scale both ways, as much as they fill."""
    if isinstance(plate, Map) and plate.names:
        return 0.95
    if not (isinstance(plate, Lines) and plate.equal):
        return 0.66
    across, up = (np.concatenate([getattr(item, key) for item in plate.series]) for key in ("x", "y"))
    wide, tall = (float(np.nanmax(values) - np.nanmin(values)) for values in (across, up))
    return float(np.clip(0.25 + 0.75 * tall / max(wide, 1e-9), 0.5, 0.95))  # a quarter for labels and legend


def _lines(axes: Axes, plate: Lines) -> None:
    for item in plate.series:
        _curve(axes, item)
    if plate.equal:
        axes.set_aspect("equal", adjustable="box")
    if plate.log_y:
        axes.set_yscale("log")
    if plate.whole_x:
        axes.set_xticks(sorted({float(x) for item in plate.series for x in item.x}))
    axes.set_xlabel(str(plate.x))
    axes.set_ylabel(str(plate.y))
    axes.margins(x=0.06 if any(item.role in ("dots", "rings") for item in plate.series) else 0.02)
    if len(plate.series) > 1:
        _legend(axes, plate)


def _legend(axes: Axes, plate: Lines) -> None:
    """Above the axes, where it hides nothing; many runs in the same two strokes need but two entries."""
    handles, names = axes.get_legend_handles_labels()
    roles = [item.role for item in plate.series]
    if len(roles) > 2 and set(roles) <= {"measured", "modelled", "dots"}:
        chosen = {role: handles[roles.index(role)] for role in dict.fromkeys(roles)}
        handles, names = list(chosen.values()), ["measured" if role == "dots" else role for role in chosen]
    kept = [names.index(name) for name in dict.fromkeys(names)]
    handles, names = [handles[index] for index in kept], [names[index] for index in kept]
    count = len(names)
    columns = min(count, 4 if plate.wide else 3)
    axes.legend(handles, names, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.1,
                handlelength=1.6, columnspacing=1.0)  # fmt: skip


def _curve(axes: Axes, item: Series) -> None:
    (line,) = axes.plot(item.x, item.y, label=item.name, **_STROKES[item.role])
    if item.sigma is not None and item.role not in ("dots", "rings"):
        axes.fill_between(item.x, item.y - item.sigma, item.y + item.sigma, color=line.get_color(), alpha=0.2, lw=0)
    elif item.sigma is not None:
        axes.errorbar(item.x, item.y, item.sigma, fmt="none", ecolor=line.get_color(), elinewidth=0.7)


def _map(axes: Axes, plate: Map) -> None:
    sizes = np.abs(plate.values)
    top = float(np.nanquantile(sizes, 1 - BEYOND)) if np.isfinite(plate.values).any() else 1.0
    colours: dict[str, Any] = {"cmap": "RdBu_r", "vmin": -top, "vmax": top} if plate.signed else {"vmax": plate.most}
    mesh = axes.pcolormesh(plate.x_values, plate.y_values, plate.values, shading="nearest", rasterized=True, **colours)
    pointed = "both" if plate.signed and np.any(sizes > top) else "neither"
    if plate.most is not None and np.any(plate.values > plate.most):
        pointed = "max"
    bar = axes.figure.colorbar(mesh, ax=axes, pad=0.02, extend=pointed)
    bar.set_label(str(plate.value))
    bar.outline.set_linewidth(0.4)
    axes.set_xlabel(str(plate.x))
    axes.set_ylabel(str(plate.y))
    if plate.names:
        axes.set_xticks(range(len(plate.names)), plate.names, rotation=60, ha="right")
        axes.set_yticks(range(len(plate.names)), plate.names)
    if plate.y_down:
        axes.invert_yaxis()


def _bars(axes: Axes, plate: Bars) -> None:
    from matplotlib import rcParams
    from matplotlib.font_manager import FontProperties

    count = len(plate.sets)
    place = np.arange(len(plate.categories))
    for index, (label, values) in enumerate(plate.sets):
        colour = (_ORANGE, _BLUE, *_CYCLE)[index % 8]
        where = place + (index - (count - 1) / 2) * 0.8 / count
        if plate.log_y:  # a bar has a foot, and a logarithmic axis has no nought for it to stand on
            axes.plot(where, values, "o", markersize=5, label=label, color=colour)
        else:
            axes.bar(where, values, 0.72 / count, label=label, color=colour)
    many = len(plate.categories) > 7
    turned = {"rotation": 35, "ha": "right"} if many else {}
    size_in = FontProperties(size=rcParams["xtick.labelsize"]).get_size_in_points() / 72
    width_in = TEXT_IN if plate.wide else COLUMN_IN
    room = max(1, int(_INSIDE * width_in / (_LETTER * size_in * len(plate.categories))))
    names = plate.categories if many else [fill(name, min(22, room)) for name in plate.categories]
    axes.set_xticks(place, names, **turned)
    if plate.log_y:
        from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

        axes.set_xlim(-0.5, len(place) - 0.5)
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.grid(axis="y", linewidth=0.4, alpha=0.4)
    axes.set_xlabel(str(plate.x) if plate.x.label else "")
    axes.set_ylabel(str(plate.y))
    if count > 1:
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=count, borderaxespad=0.1)
