"""Names of things in pictures and tables."""

from __future__ import annotations

import math

from ngspring.problem import ControlPoint, SpringProblem


def width_symbol(problem: SpringProblem) -> str:
    """Name of the equivalent width: W/H (Eq. 20), or D/H for a cylinder (Eq. 25)."""
    return "D/H" if problem.axisymmetric else "W/H"


def point_label(point: ControlPoint) -> str:
    """Displacement of a control point, with the offset of chi if there is one."""
    return f"d = {point.d:g} mm" + (f", η = {point.eta:g}" if point.eta else "")


def number(value: float, form: str) -> str:
    """A number in a table; a dash where there is none."""
    return format(value, form) if math.isfinite(value) else "-"


def signed_percent(share: float, digits: int) -> str:
    """A share in percent with its sign, without one where it is rounded to 0; a dash for NaN."""
    if not math.isfinite(share):
        return "-"
    text = f"{100 * share:+.{digits}f}"
    return f"{text if float(text) else text[1:]} %"
