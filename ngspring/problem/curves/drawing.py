"""A target curve drawn in any vector graphics program.

The drawing has one open path (or polyline, or line): the curve. Of several, and of the separate
parts of one path, one has to be chosen. The axes are the edges of its only rectangle if it has one,
else of the page; what they stand for is given as ranges of d and q.
Needs `svgelements` (the extra ``svg``).
"""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError
from ngspring.problem.curves.table import chosen_specimen

#: Points on each segment (a line, an arc, a cubic) of the path, fewer of more than 300 segments.
_PER_SEGMENT = 64
_POINTS, MOST_SEGMENTS, LONGEST_TEXT = 20_000, 10_000, 2_000_000


def parse_drawing(
    text: str,
    d_range: tuple[float, float],
    q_range: tuple[float, float],
    specimen: int | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Displacements in mm and forces in N along the curve of an SVG drawing.

    Parameters
    ----------
    text : str
        Content of the SVG file.
    d_range, q_range : pair of float
        What the left and right, and the lower and upper, edges of the axes stand for.
    specimen : int, optional
        Which curve, from 1, if there are several.

    Raises
    ------
    ProblemError
        If svgelements is not installed, the text is no SVG, or it has no curve, or several of which
        none is chosen.
    """
    for name, (low, high) in (("d", d_range), ("q", q_range)):
        if not low < high:
            raise ProblemError(f"the range of {name}, {low:g} to {high:g}, must increase")
    try:
        import svgelements
    except ImportError:
        raise ProblemError("a drawn curve needs svgelements: pip install 'ngspring[svg]'") from None
    if len(text) > LONGEST_TEXT:
        raise ProblemError(
            f"the drawing has more than {LONGEST_TEXT} characters: leave in it the curve only"
        )
    if re.search(r"<(\w+:)?use\b", text):
        # Clones of clones would be as many as one likes.
        raise ProblemError("the drawing holds clones (<use>): unlink them, or draw the curve only")
    try:
        drawing = svgelements.SVG.parse(io.StringIO(text))
        shapes = list(drawing.elements())
    except Exception as error:
        # The XML parser and svgelements raise many kinds of errors.
        raise ProblemError(f"not a valid SVG drawing: {shown(str(error))}") from error
    frames = [shape for shape in shapes if isinstance(shape, svgelements.Rect)]
    kinds = (svgelements.Path, svgelements.Polyline, svgelements.SimpleLine)
    curves = [
        part
        for shape in shapes
        if isinstance(shape, kinds)
        for part in svgelements.Path(shape).as_subpaths()
    ]
    if not curves or len(frames) > 1:
        raise ProblemError(
            f"the drawing has {len(curves)} paths and {len(frames)} rectangles: it must have one"
            " path, the curve, and at most one rectangle, the axes"
        )
    curve = svgelements.Path(curves[chosen_specimen(specimen, len(curves))])
    left, top, right, bottom = _edges(svgelements, drawing, frames)
    if not (left < right and top < bottom):
        raise ProblemError("the drawing has no page size: draw a rectangle around the axes")
    points = _sampled(curve)
    if not np.isfinite([*points.ravel(), right - left, bottom - top]).all():
        raise ProblemError("the drawing has coordinates that are too large to compute with")
    x = (points[:, 0] - left) / (right - left)
    y = (bottom - points[:, 1]) / (bottom - top)
    return (
        np.asarray(d_range[0] + x * (d_range[1] - d_range[0])),
        np.asarray(q_range[0] + y * (q_range[1] - q_range[0])),
    )


def _edges(svgelements: Any, drawing: Any, frames: list[Any]) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of the axes; y of SVG points down."""
    if frames:
        left, top, right, bottom = frames[0].bbox()
        return float(left), float(top), float(right), float(bottom)
    box = drawing.viewbox
    if box is None or None in (box.x, box.y, box.width, box.height):
        return 0.0, 0.0, float(drawing.width or 0.0), float(drawing.height or 0.0)
    # The page may be larger than the view box where their proportions differ.
    matrix = svgelements.Matrix(drawing.viewbox_transform)
    first = matrix.point_in_matrix_space((box.x, box.y))
    last = matrix.point_in_matrix_space((box.x + box.width, box.y + box.height))
    return float(first[0]), float(first[1]), float(last[0]), float(last[1])


def _sampled(path: Any) -> FloatArray:
    """Points along a path, (n, 2), transformations applied."""
    path.reify()
    if len(path) > MOST_SEGMENTS:
        raise ProblemError(
            f"the path of the drawing has {len(path)} segments, more than {MOST_SEGMENTS}: simplify"
            " it (in Inkscape: Path, Simplify)"
        )
    each = min(_PER_SEGMENT, _POINTS // len(path)) if len(path) else 0
    points: list[tuple[float, float]] = []
    for segment in path:
        if type(segment).__name__ in ("Move", "Close"):
            continue
        for t in np.linspace(0.0, 1.0, each + 1)[bool(points) :]:
            point = segment.point(float(t))
            points.append((float(point.x), float(point.y)))
    if not points:
        raise ProblemError("the path of the drawing has no length")
    return np.array(points)
