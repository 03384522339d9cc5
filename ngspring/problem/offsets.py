"""Control points for the same spring with its surfaces a little off (2.6, Appendix A).

A surface that lies o mm further out is chi + 8 o / l_i, as far as chi has the slope 8 / l_i that
the formulation allows (Eq. 11). A spring whose eroded and dilated twins carry nearly the same is
one that manufacturing errors change little. One that carries nearly the same with an imperfection
that breaks its symmetries does not buckle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ngspring.basics.checks import choice, positive_number
from ngspring.basics.errors import ProblemError
from ngspring.problem.imperfection import ODD_IN, usual_odd_in
from ngspring.problem.point import ControlPoint

#: Weight of an eroded or dilated point relative to that of its target. Small, because the curve of
#: the design itself comes first: one that is off by 4 %, as wide as the band of a paper's spring,
#: moves its target by less than 0.1 %. Large against the material: a band has to be worth it.
SHARE_ROBUST = 1e-2
#: The same of one with an imperfection: a spring that buckles misses by much.
SHARE_IMPERFECT = 1e-3
#: The keys of a problem's TOML file, in mm; and the one that says what kind the imperfection is of.
OFFSET_KEYS = ("robust", "imperfection")
ODD_KEY = "imperfection_odd_in"


def with_offsets(
    points: Iterable[ControlPoint],
    l_i: float,
    *,
    robust: float | None = None,
    imperfection: float | None = None,
    odd_in: str | None = None,
    axis: bool = False,
) -> tuple[ControlPoint, ...]:
    """Control points with eroded, dilated and imperfect ones beside them.

    Parameters
    ----------
    points : iterable of ControlPoint
        Targets.
    l_i : float
        Interface width of the problem in mm.
    robust : float, optional
        Every target with its surfaces this many mm further in, and further out.
    imperfection : float, optional
        The outermost target in compression (in tension, if there is none) with surfaces moved by
        up to this many mm, in a pattern that breaks symmetries.
    odd_in : {"xy", "x", "y"}, optional
        The axes in which that pattern is odd, see `ngspring.problem.imperfection`; both by
        default.
    axis : bool
        Whether the spring is a body of revolution, whose pattern can be odd in y only.

    Returns
    -------
    tuple of ControlPoint
        The targets first.

    Raises
    ------
    ProblemError
        If a length is not a positive number, or a target would be there twice.
    """
    given = tuple(points)
    own = [point for point in given if point.own]
    wanted: dict[tuple[float, float, float, str], ControlPoint] = {}

    def add(
        targets: Iterable[ControlPoint], offset: float, share: float, odd_in: str | None = None
    ) -> None:
        eta = 8 * offset / l_i
        for p in targets:
            point = dataclasses.replace(p, weight=share * p.weight)
            if odd_in is None:
                point = dataclasses.replace(point, eta=eta)
            else:
                point = dataclasses.replace(point, eta_odd=eta, odd_in=odd_in)
            wanted[point.place] = point

    if robust is not None:
        size = positive_number("robust", robust)
        for offset in (-size, size):
            add(own, offset, SHARE_ROBUST)
    if imperfection is not None:
        size = positive_number("imperfection", imperfection)
        kind = choice(ODD_KEY, odd_in or usual_odd_in(axis), ODD_IN)
        add(_outermost(own), size, SHARE_IMPERFECT, kind)
    for point in given:
        if point.place in wanted:
            raise ProblemError(
                f"the control point with {point.words} is given, and"
                f" asked for by {' or '.join(OFFSET_KEYS)}: leave one of them out"
            )
    return (*given, *wanted.values())


def _outermost(points: Sequence[ControlPoint]) -> list[ControlPoint]:
    """The outermost point in compression, or in tension where there is none."""
    side = [point for point in points if point.d < 0] or list(points)
    return sorted(side, key=lambda point: abs(point.d))[-1:]


def taken_offsets(values: Mapping[str, object]) -> dict[str, Any]:
    """Arguments of `with_offsets` from the keys of a file, checked.

    Raises
    ------
    ProblemError
        If a length is not a positive number, or there is no such kind of imperfection.
    """
    taken: dict[str, Any] = {
        key: positive_number(key, values[key]) for key in OFFSET_KEYS if key in values
    }
    if ODD_KEY in values:
        if "imperfection" not in taken:
            raise ProblemError(f"{ODD_KEY} is given without imperfection: say how large it is")
        taken["odd_in"] = choice(ODD_KEY, values[ODD_KEY], ODD_IN)
    return taken
