"""Following a load path with adaptive steps, of the third medium and of real contact alike."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)

#: A step with a larger `departure` than this is a jump to another branch.
JUMP = 1.0


class HasDisplacement(Protocol):
    """Something at a displacement."""

    @property
    def d(self) -> float:
        """Displacement in mm."""


Placed = TypeVar("Placed", bound=HasDisplacement)


class Point(HasDisplacement, Protocol):
    """One equilibrium of a path."""

    @property
    def q(self) -> float:
        """Reaction force in N."""

    @property
    def u(self) -> FloatArray:
        """Free unknowns in mm."""

    @property
    def tangent(self) -> FloatArray:
        """du/dd."""

    @property
    def stiffness(self) -> float:
        """dq/dd in N/mm."""

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
    resolved : float
        So fine the path is followed where it is not smooth, in units of the size.
    smooth : float
        Up to this `departure` a step is taken for one along the path.
    lands : bool
        Whether an equilibrium after a jump is where the body lands, because it was found downhill.
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
    resolved: float
    smooth: float
    lands: bool
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


@dataclass(frozen=True)
class Jump:
    """Where a branch of equilibria ends, and the body snaps to another one.

    Attributes
    ----------
    d : float
        Displacement in mm.
    q_before, q_after : float
        Force in N.
    """

    d: float
    q_before: float
    q_after: float

    def __str__(self) -> str:
        return (
            f"snap-through at d = {self.d:.6g} mm: q from {self.q_before:.6g} to"
            f" {self.q_after:.6g} N"
        )


def departure(here: Point, there: Point) -> float:
    """How far two neighbouring equilibria are from lying on one smooth path.

    Along it q and u change by the mean of their slopes times the step; what they change besides is
    compared with the step times the sum of the slopes' sizes. Of the order of the squared step on
    a smooth path, below 1/2 where contact makes a kink between the two, and beyond every bound for
    a jump to another branch, which is finite however small the step.
    """
    step = there.d - here.d
    off = abs(there.q - here.q - step * (here.stiffness + there.stiffness) / 2)
    moved = np.abs(there.u - here.u - step * (here.tangent + there.tangent) / 2).max(initial=0.0)
    of_q = abs(here.stiffness) + abs(there.stiffness)
    of_u = sum(float(np.abs(point.tangent).max(initial=0.0)) for point in (here, there))
    # Rounding is no departure: of a force that hardly changes, or of one displacement told twice.
    rounding_q = 1e-9 * (abs(here.q) + abs(there.q))
    rounding_u = 1e-9 * sum(float(np.abs(point.u).max(initial=0.0)) for point in (here, there))
    by_q = off / (abs(step) * of_q + rounding_q)
    by_u = moved / max(abs(step) * of_u + rounding_u, 1e-300)
    return float(max(by_q, by_u))


def extrapolated(before: Point | None, here: Point, d: float, smooth: float) -> FloatArray:
    """Guess of the free unknowns at another d of the path through two equilibria.

    Along the cubic through both with their tangents; along the tangent of ``here`` alone where
    there is none before, or a kink between the two: a `departure` of more than ``smooth``.
    """
    step = d - here.d
    if before is None or departure(before, here) > smooth:
        return here.u + step * here.tangent
    h = here.d - before.d
    secant = (here.u - before.u) / h
    second = (4 * here.tangent + 2 * before.tangent - 6 * secant) / h
    third = 6 * (here.tangent + before.tangent - 2 * secant) / h**2
    return here.u + step * (here.tangent + step * (second / 2 + step * third / 6))


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
    on_jump: Callable[[Jump], None] | None = None,
) -> tuple[list[P], str]:
    """Follow the load path through displacements that move away from the start one way.

    The step adapts: it grows after easy steps and is halved after a failed one, or one that may
    have led to another branch (`departure`), so that what is found does not depend on the targets.
    Where it becomes tiny the branch has ended (something snaps through), and the path goes on from
    where the body settles. It ends early where that fails too.

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
    on_jump : callable, optional
        Called where the body snaps to another branch.

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

    def told(before: P, after: P) -> None:
        jump = Jump(after.d, before.q, after.q)
        logger.info("%s", jump)
        if on_jump is not None:
            on_jump(jump)

    for target in map(float, targets):
        while here.d != target:
            tried = min(step, abs(target - here.d))
            try:
                there, tried = body.advanced(here, target, tried)
                apart = departure(here, there)
                resolved = tried <= steps.resolved * size
                if apart > steps.smooth and not (resolved and (apart <= JUMP or steps.lands)):
                    raise ConvergenceError("the branch of equilibria ends")
                if apart > JUMP:
                    told(here, there)
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
                told(here, there)
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
