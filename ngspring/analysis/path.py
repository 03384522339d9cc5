"""Following a load path with adaptive steps, of the third medium and of real contact alike."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.problem.spring import SpringProblem


class HasDisplacement(Protocol):
    """Something at a displacement."""

    @property
    def d(self) -> float:
        """Displacement in mm."""


Placed = TypeVar("Placed", bound=HasDisplacement)


class Point(HasDisplacement, Protocol):
    """One equilibrium of a path."""

    @property
    def iterations(self) -> int:
        """Newton iterations that it took."""


P = TypeVar("P", bound=Point)


@dataclass(frozen=True)
class Steps:
    """How the step along a path changes.

    Parameters
    ----------
    first, smallest, largest : float
        In units of the size.
    easy, hard : int
        After a step of at most so many iterations the next one is longer, after one of at least
        so many half as long.
    growth : float
        By this factor it is longer.
    remembered : bool
        Whether a step that a target cut short leaves the next one as long as it was before, unless
        it was easy, which it always does then.
    """

    first: float
    smallest: float
    largest: float
    easy: int
    hard: int
    growth: float
    remembered: bool

    def after(self, step: float, tried: float, at_target: bool, iterations: int) -> float:
        """The next step, if one of ``tried`` out of ``step`` took so many iterations."""
        whole = max(tried, step) if at_target else tried
        if iterations <= self.easy:
            return self.growth * whole
        kept = whole if self.remembered else tried
        return kept / 2 if iterations >= self.hard else kept


class Followed(Protocol[P]):
    """A body whose load path can be followed."""

    steps: Steps

    @property
    def size(self) -> float:
        """The length in mm that steps are measured with."""

    def at_rest(self) -> P:
        """The undeformed state."""

    def advanced(self, here: P, target: float, tried: float) -> tuple[P, float]:
        """The equilibrium ``tried`` mm on towards a target.

        Also the step that was made, which may be shorter. Raises `ConvergenceError`.
        """

    def settled(self, here: P, target: float, tried: float) -> P:
        """Where the body goes if the branch ends at ``here``. Raises `ConvergenceError`."""


def follow(
    body: Followed[P],
    targets: FloatArray,
    start: P | None = None,
    first_step: float | None = None,
    on_point: Callable[[P], None] | None = None,
) -> tuple[list[P], str]:
    """Follow the load path through displacements that move away from the start one way.

    The step adapts: it grows after easy steps and is halved after a failed one. Where it becomes
    tiny the branch has ended (something snaps through), and the path goes on from where the body
    settles. It ends early where that fails too.

    Parameters
    ----------
    body : Followed
        `ngspring.analysis.mechanics.Mechanics`, or
        `ngspring.solid.contact.mechanics.ContactMechanics`.
    targets : array
        Displacements in mm, in order.
    start : optional
        Where to start; the undeformed state by default.
    first_step : float, optional
        First step in mm.
    on_point : callable, optional
        Called with each accepted equilibrium, in-between ones included.

    Returns
    -------
    points : list
        One for each target that was reached.
    message : str
        Empty, or why and where the path ended.
    """
    steps, size = body.steps, body.size
    here = body.at_rest() if start is None else start
    step = steps.first * size if first_step is None else first_step
    points: list[P] = []
    for target in map(float, targets):
        while here.d != target:
            tried = min(step, abs(target - here.d))
            try:
                there, tried = body.advanced(here, target, tried)
                following = steps.after(step, tried, there.d == target, there.iterations)
            except ConvergenceError as error:
                step = following = tried / 2
                if step >= steps.smallest * size:
                    continue
                try:
                    there = body.settled(here, target, tried)
                except ConvergenceError:
                    return points, (
                        f"the path ends at d = {here.d:.6g} mm, before {target:.6g} mm: {error}"
                    )
                following = steps.after(10 * steps.smallest * size, tried, True, there.iterations)
            here = there
            if on_point is not None:
                on_point(here)
            step = min(max(following, steps.smallest * size), steps.largest * size)
        points.append(here)
    return points, ""


def stepped(here: float, target: float, tried: float) -> float:
    """The displacement ``tried`` mm on from here towards a target, which is hit exactly."""
    distance = target - here
    return target if tried == abs(distance) else here + float(np.copysign(tried, distance))


def checked_displacements(displacements: Iterable[float], problem: SpringProblem) -> FloatArray:
    """Displacements in mm, in the order given.

    Raises
    ------
    ProblemError
        If there are none, or one is not a finite number smaller than H in size.
    """
    try:
        values = np.array([float(d) for d in displacements])
    except (TypeError, ValueError):
        raise ProblemError("displacements must be numbers in mm") from None
    if not len(values):
        raise ProblemError("no displacements were given")
    for d in values:
        if not np.isfinite(d) or abs(d) >= problem.H:
            raise ProblemError(
                f"displacement {d:g} mm must be a finite number smaller in size than H ="
                f" {problem.H:g} mm"
            )
    return values


def both_ways(targets: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The positive and the negative ones of some displacements, each once, away from zero."""
    once = np.unique(targets)
    return once[once > 0], once[once < 0][::-1]


def in_order(targets: FloatArray, points: Iterable[Placed]) -> list[Placed]:
    """Points of a path in the order of these displacements, without those not reached."""
    found = {point.d: point for point in points}
    return [found[d] for d in map(float, targets) if d in found]
