"""Control points for the same spring with its surfaces a little in or out (2.6, Appendix A).

A surface that lies o mm further out is chi + 8 o / l_i, as far as chi has the slope 8 / l_i that
the formulation allows (Eq. 11). A spring whose eroded and dilated twins carry nearly the same is
one that manufacturing errors change little, has no wall that erosion would cut, and no gap that
dilation would close.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ngspring.basics.checks import positive_number
from ngspring.basics.errors import ProblemError
from ngspring.problem.point import ControlPoint

#: Weight of an eroded or dilated point relative to that of its target. Small: the curve of the
#: design itself comes first; but large against the material, or walls would still be cut.
SHARE_ROBUST, SHARE_WALL = 1e-4, 1e-4
#: The keys of a problem's TOML file, in mm.
OFFSET_KEYS = ("robust", "wall", "gap")


def with_offsets(
    points: Iterable[ControlPoint],
    l_i: float,
    *,
    robust: float | None = None,
    wall: float | None = None,
    gap: float | None = None,
) -> tuple[ControlPoint, ...]:
    """Control points with eroded and dilated ones beside them.

    Parameters
    ----------
    points : iterable of ControlPoint
        Targets.
    l_i : float
        Interface width of the problem in mm.
    robust : float, optional
        Every target with its surfaces this many mm further in, and further out.
    wall : float, optional
        Smallest wall in mm: the outermost targets with surfaces half of it further in.
    gap : float, optional
        Smallest gap in mm: the outermost targets with surfaces half of it further out.

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
    own = [point for point in given if not point.eta]
    outermost = [
        max(side, key=lambda point: abs(point.d))
        for side in ([p for p in own if p.d > 0], [p for p in own if p.d < 0])
        if side
    ]
    wanted: dict[tuple[float, float], ControlPoint] = {}

    def add(targets: Iterable[ControlPoint], offset: float, share: float) -> None:
        eta = 8 * offset / l_i
        for p in targets:
            wanted.setdefault((p.d, eta), ControlPoint(p.d, p.q, share * p.weight, eta, p.aim))

    if robust is not None:
        size = positive_number("robust", robust)
        for offset in (-size, size):
            add(own, offset, SHARE_ROBUST)
    if wall is not None:
        add(outermost, -positive_number("wall", wall) / 2, SHARE_WALL)
    if gap is not None:
        add(outermost, positive_number("gap", gap) / 2, SHARE_WALL)
    for point in given:
        if (point.d, point.eta) in wanted:
            raise ProblemError(
                f"the control point with d = {point.d:g} mm and eta = {point.eta:g} is given, and"
                " asked for by robust, wall or gap: leave one of them out"
            )
    return (*given, *wanted.values())


def taken_offsets(values: Mapping[str, object]) -> dict[str, float]:
    """The keys of `OFFSET_KEYS` among those of a file, checked.

    Raises
    ------
    ProblemError
        If one is not a positive number.
    """
    return {key: positive_number(key, values[key]) for key in OFFSET_KEYS if key in values}
