"""Names of things in pictures and tables."""

from __future__ import annotations

import math

from ngspring.basics.checks import printable
from ngspring.problem.point import ControlPoint, relative_deviation
from ngspring.problem.spring import SpringProblem

_LONGEST_NAME = 60


def picture_text(name: str) -> str:
    """A name in a picture: text of bounded length, in which matplotlib finds no mathematics."""
    return printable(name, _LONGEST_NAME).replace("$", r"\$")


def picture_name(problem: SpringProblem) -> str:
    """The name of a problem in a picture."""
    return picture_text(problem.name or "spring")


def width_symbol(problem: SpringProblem) -> str:
    """Name of the equivalent width: W/H (Eq. 20), or D/H for a cylinder (Eq. 25)."""
    return f"{problem.motion.width_name}/H"


def point_label(point: ControlPoint) -> str:
    """Displacement of a control point, with the offset or imperfection of chi if there is one."""
    return f"d = {point.d:g} mm" + (f", {point.variant}" if point.variant else "")


def signed_percent(share: float, digits: int) -> str:
    """A share in percent with its sign, without one where it is rounded to 0; a dash for NaN."""
    if not math.isfinite(share):
        return "-"
    text = f"{100 * share:+.{digits}f}"
    return f"{text if float(text) else text[1:]} %"


def duration(seconds: float) -> str:
    """Seconds in the form 1:02:03, or 2:03."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def step(dt: float) -> str:
    """A pseudo-time step; infinite once the design is stationary."""
    return "∞" if math.isinf(dt) else f"{dt:.1e}"


def deviation_percent(q: float, target: float) -> str:
    """Deviation of a force from its target in percent: positive is stiffer or stronger."""
    return signed_percent(float(relative_deviation(q, target)), 3) if target else f"{q:+.2e} N"


def deviation_text(d: float, deviation: float, relative: float) -> str:
    """The largest deviation in words: in N, in percent, and where."""
    if not math.isfinite(d):
        return "no deviation in force known"
    share = f" ({signed_percent(relative, 1)})" if math.isfinite(relative) else ""
    return f"{abs(deviation):.3g} N{share} at d = {d:g} mm"
