"""Targets and what is reached of them, as a table: in the terminal and in reports."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ngspring.basics.text import significant
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.view.text import deviation_percent

#: A force for each control point; None where it is not known or not reached.
Forces = Sequence[float | None]
#: In place of a force that nothing was computed for.
NOWHERE = "–"


def targets_table(
    problem: SpringProblem,
    forces: Forces,
    solid: Forces | None = None,
    *,
    missing: str = "not reached",
    mark: str = "",
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Names of columns, and a row for each control point.

    A design whose targets were corrected has two more: what the third medium was asked for, and
    what its solid carries.

    Parameters
    ----------
    problem : SpringProblem
    forces : Forces
        Of the third medium.
    solid : Forces, optional
        Of the solid, by real contact: the deviation is its.
    missing : str
        In place of a force that is None, unless the point is on no curve.
    mark : str
        Behind the name of a column that is only as it was stored.
    """
    points = problem.control_points
    rows: list[tuple[str, ...]]
    first = "d [mm]", "η", "target q [N]"
    if solid is None and all(point.aim is None for point in points):
        rows = [
            (*_place(point), *_reached(q, point.q, _if_none(point, missing)))
            for point, q in zip(points, forces, strict=True)
        ]
        return (*first, f"reached q [N]{mark}", f"deviation{mark}"), rows
    asked = "third medium: asked [N]", f"reached [N]{mark}"
    found = solid or [None] * len(points)
    rows = [
        (
            *_place(point),
            significant(point.q_star, 5),
            _reached(q, point.q_star, _if_none(point, missing))[0],
            *_reached(in_solid, point.q, NOWHERE),
        )
        for point, q, in_solid in zip(points, forces, found, strict=True)
    ]
    return (*first, *asked, f"solid q [N]{mark}", f"deviation{mark}"), rows


def _place(point: ControlPoint) -> tuple[str, str, str]:
    return f"{point.d:g}", point.eta_text, f"{point.q:g}"


def _if_none(point: ControlPoint, missing: str) -> str:
    return missing if point.on_curves else NOWHERE


def _reached(q: float | None, target: float, missing: str) -> tuple[str, str]:
    """A force and its deviation from a target."""
    if q is None or not math.isfinite(q):
        return missing, ""
    return significant(q, 6), deviation_percent(q, target)
