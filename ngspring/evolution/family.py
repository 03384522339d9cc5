"""A family of springs: the designs between two sets of targets, to pick one from."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.evolution.continuation import FollowSteps
from ngspring.evolution.follow import Following, Reached
from ngspring.evolution.updates import Observer
from ngspring.fem.process import parallel
from ngspring.problem.point import worst_deviation
from ngspring.problem.spring import SpringProblem


@dataclass(frozen=True, eq=False)
class Family:
    """Designs on the way from one problem's control points to another's.

    Attributes
    ----------
    members : tuple of Reached
        In order; the first one is the design that it began with.
    """

    members: tuple[Reached, ...]

    @property
    def designs(self) -> tuple[Design, ...]:
        """Their designs."""
        return tuple(member.design for member in self.members)

    @property
    def widths(self) -> FloatArray:
        """W/H (or D/H) of each."""
        return np.array([design.relative_width for design in self.designs])

    @property
    def varied(self) -> int:
        """The control point whose target changes most, relative to its size; ties: the first."""
        first, last = (self.designs[k].problem.control_points for k in (0, -1))
        changes = [
            abs(b.q - a.q) / max(abs(a.q), abs(b.q), 1e-300)
            for a, b in zip(first, last, strict=True)
        ]
        return int(np.argmax(changes))

    def to_csv(self) -> str:
        """A row for each member: share of the way, targets and forces, W/H, C."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        count = len(self.designs[0].problem.control_points)
        numbered = [f"{name}{j}" for j in range(1, count + 1) for name in ("d", "target", "q")]
        writer.writerow(["share", *numbered, "width", "C", "worst_deviation", "evolved"])
        for member in self.members:
            design = member.design
            assert design.history is not None
            cells: list[object] = [member.share]
            points, forces = design.problem.control_points, design.info["q"]
            for point, q in zip(points, forces, strict=True):
                cells += [point.d, point.q, q]
            far = worst_deviation(points, forces)
            cells += [design.relative_width, design.history.last().C, far, int(member.evolved)]
            writer.writerow(cells)
        return text.getvalue()


def family_members(
    design: Design,
    problem: SpringProblem,
    members: int = 11,
    *,
    observers: Sequence[Observer] = (),
    steps: FollowSteps | None = None,
    threads: int | None = None,
    solver: str = "auto",
) -> Iterator[Reached]:
    """The members of a `family`, one after the other, as they are found.

    Raises
    ------
    ProblemError
        See `family`.
    """
    if not isinstance(members, int) or isinstance(members, bool) or not 2 <= members <= _MOST:
        raise ProblemError(f"members = {shown(members)} must be an integer from 2 to {_MOST}")
    with parallel(threads, problem) as count:
        following = Following(design, problem, steps or FollowSteps(), solver, count)
        yield Reached(0.0, following.design, evolved=False)
        for share in np.linspace(0.0, 1.0, members)[1:]:
            reached = following.reach(float(share), observers)
            yield reached
            if reached.message:
                return


_MOST = 1000


def family(
    design: Design,
    problem: SpringProblem,
    members: int = 11,
    *,
    observers: Sequence[Observer] = (),
    steps: FollowSteps | None = None,
    threads: int | None = None,
    solver: str = "auto",
) -> Family:
    """A family of stationary designs whose control points move from a design's to a problem's.

    Parameters
    ----------
    design : Design
        A stationary one.
    problem : SpringProblem
        The design's own with other control points, as many.
    members : int
        Designs in all, evenly spread.
    observers, steps, threads, solver
        See `ngspring.follow`.

    Returns
    -------
    Family
        Ends early where the evolution fails, with its message.

    Raises
    ------
    ProblemError
        If ``members`` is not an integer from 2 to 1000, and as `ngspring.follow` does.
    ConvergenceError
        As `ngspring.follow` does.
    """
    found = family_members(
        design, problem, members, observers=observers, steps=steps, threads=threads, solver=solver
    )
    return Family(tuple(found))
