"""Names of things in pictures and tables."""

from __future__ import annotations

from ngspring.problem import ControlPoint, SpringProblem


def width_symbol(problem: SpringProblem) -> str:
    """Name of the equivalent width: W/H (Eq. 20), or D/H for a cylinder (Eq. 25)."""
    return "D/H" if problem.axisymmetric else "W/H"


def point_label(point: ControlPoint) -> str:
    """Displacement of a control point, with the offset of chi if there is one."""
    return f"d = {point.d:g} mm" + (f", η = {point.eta:g}" if point.eta else "")
