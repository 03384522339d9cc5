"""From a curve to a problem: the way of somebody who has measured or drawn what is wanted."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

from ngspring.basics.errors import ProblemError
from ngspring.problem.curves.curve import TargetCurve
from ngspring.problem.laws import with_material
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import with_similar_weights
from ngspring.problem.spring import SpringProblem

#: Dilation of the robust formulation in units of the size of the domain (section 3.2).
_DILATION = 0.25 / 100


def problem_from_curve(
    curve: TargetCurve,
    points: int | None = None,
    at: Iterable[float] | None = None,
    *,
    robust: bool = False,
    **fields: Any,
) -> SpringProblem:
    """The problem that asks for a curve, with weights of the right size.

    Parameters
    ----------
    curve : TargetCurve
        From `ngspring.read_curve`.
    points, at
        How many control points, or their displacements in mm, see `TargetCurve.control_points`.
    robust : bool
        Add the dilated control point of section 2.6 at the largest tension, on a mesh twice as
        fine.
    **fields
        Of `SpringProblem`; the material also by ``E``, ``shore_A`` or ``material`` (a name or a
        law), and ``nu``.

    Raises
    ------
    ProblemError
        If a field is not valid, the points cannot be chosen, or ``robust`` finds no tension.

    Examples
    --------
    >>> size = {"L": 20.0, "H": 20.0, "T": 10.0}
    >>> curve = ngspring.read_curve("test.csv", height=20.0, area=200.0)  # doctest: +SKIP
    >>> problem = ngspring.problem_from_curve(curve, 3, **size, shore_A=50)  # doctest: +SKIP
    """
    chosen = curve.control_points(points, at)
    problem = with_similar_weights(SpringProblem(chosen, **with_material(fields)))
    return _robust(problem) if robust else problem


def _robust(problem: SpringProblem) -> SpringProblem:
    """T1 and T2 of the paper: a dilated point at the largest tension, and half the element size."""
    last = max(problem.control_points, key=lambda point: point.d)
    if last.d < 0.0:
        raise ProblemError("--robust belongs to a target in tension, but there is none")
    dilation = _DILATION * (problem.L * problem.H) ** 0.5
    dilated = ControlPoint(last.d, last.q, 1e-4 * last.weight, 8 * dilation / problem.l_i)
    points = (*problem.control_points, dilated)
    return dataclasses.replace(problem, control_points=points, elements=2 * problem.elements)
