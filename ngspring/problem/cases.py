"""The springs of the paper, by name, and four axisymmetric ones.

- C1 ... C7: compression springs, from softening to stiffening (Table 2).
- T1 ... T6: tension springs (Table 3). T1 and T2, which soften, also load the dilated design and
  use the finer mesh (section 3.2).
- CT1 ... CT6: springs for compression and tension (Table 4).
- A1 ... A4: axisymmetric compression springs with the softening and stiffening ratios of C1, C3, C5
  and C7. The paper gives the targets of its own four (section 3.4) only as images.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from ngspring.basics.checks import nearest, shown
from ngspring.basics.errors import ProblemError
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem


def _compression() -> Iterator[SpringProblem]:
    for i, q_3 in enumerate((-2.5, -3.0, -3.5, -4.0, -4.5, -5.0, -5.5), start=1):
        points = ControlPoint(10, 2), ControlPoint(-10, -2), ControlPoint(-20, q_3)
        yield SpringProblem(points, name=f"C{i}")


def _tension() -> Iterator[SpringProblem]:
    for i, q_2 in enumerate((3.0, 3.5, 4.0, 4.5, 5.0, 5.5), start=1):
        points = ControlPoint(10, 2), ControlPoint(20, q_2)
        if q_2 < 4.0:
            # A dilation of 0.25 mm is eta = 0.25 * 8 / l_i, with l_i = 1 mm.
            dilated = ControlPoint(20, q_2, weight=1e-4, eta=2.0)
            yield SpringProblem((*points, dilated), name=f"T{i}", elements=160)
        else:
            yield SpringProblem(points, name=f"T{i}")


def _compression_tension() -> Iterator[SpringProblem]:
    targets = [(q_2, q_4) for q_2 in (4.0, 4.8) for q_4 in (-3.2, -4.0, -4.8)]
    for i, (q_2, q_4) in enumerate(targets, start=1):
        points = (
            ControlPoint(10, 2),
            ControlPoint(20, q_2),
            ControlPoint(-10, -2),
            ControlPoint(-20, q_4),
        )
        yield SpringProblem(points, name=f"CT{i}")


def _axisymmetric() -> Iterator[SpringProblem]:
    # Forces are 50 times those in plane strain; this weight gives the objective the same size.
    w_q = 4e-4
    for i, q_3 in enumerate((-125.0, -175.0, -225.0, -275.0), start=1):
        points = (
            ControlPoint(10, 100, w_q),
            ControlPoint(-10, -100, w_q),
            ControlPoint(-20, q_3, w_q),
        )
        yield SpringProblem(points, name=f"A{i}", kinematics="axisymmetric")


cases: Mapping[str, SpringProblem] = MappingProxyType(
    {
        problem.name: problem
        for family in (_compression, _tension, _compression_tension, _axisymmetric)
        for problem in family()
    }
)
"""The problems by name, in the order of the paper; read-only."""


def get_case(name: str) -> SpringProblem:
    """Return the case of this name, in upper or lower case.

    Raises
    ------
    ProblemError
        If there is no such case; the message names the nearest one.
    """
    if not isinstance(name, str):
        raise ProblemError(f"{shown(name)} is not the name of a case: it must be a string")
    try:
        return cases[name.strip().upper()]
    except KeyError:
        raise ProblemError(
            f"there is no case {shown(name)}: did you mean {nearest(name, cases)!r}?"
            f" The cases are {', '.join(cases)}"
        ) from None
