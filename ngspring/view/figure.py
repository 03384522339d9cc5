"""Figures without a graphical backend."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ngspring.basics.errors import NgspringError
from ngspring.basics.files import PathLike, replacing

#: Font size of small print.
SMALL = 8
#: Line styles that differ in grey.
LINES = ("-", "--", "-.", ":")
#: Markers of what a solid carries.
SOLID_STYLE: Mapping[str, Any] = MappingProxyType(
    {
        "linestyle": "none",
        "marker": "D",
        "markerfacecolor": "none",
        "markeredgecolor": "black",
        "markersize": 9,
        "zorder": 5,
    }
)


def new_figure(width: float, height: float, constrained: bool = True) -> Figure:
    """An empty figure (inches) with its own canvas."""
    figure = Figure(figsize=(width, height), layout="constrained" if constrained else None)
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: PathLike, dpi: int = 160) -> None:
    """Write a figure atomically; the suffix of the path decides the format.

    Raises
    ------
    RunFolderError
        If the file cannot be written.
    NgspringError
        If matplotlib does not know the suffix.
    """
    suffix = str(path).rpartition(".")[2].lower()
    known = sorted(figure.canvas.get_supported_filetypes())
    if suffix not in known:
        raise NgspringError(f"{path}: the suffix of a picture must be one of {', '.join(known)}")
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=dpi, format=suffix)
