"""Following the load path of a design with adaptive steps."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

import numpy as np

from ngspring.analysis.mechanics import Equilibrium, Mechanics
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.problem.spring import SpringProblem

logger = logging.getLogger(__name__)


def follow(
    mechanics: Mechanics,
    targets: FloatArray,
    start: Equilibrium | None = None,
    first_step: float | None = None,
    on_point: Callable[[Equilibrium], None] | None = None,
) -> tuple[list[Equilibrium], str]:
    """Follow the load path through displacements that move away from the start one way.

    The step adapts: it grows after easy steps and is halved after a failed one. Where it becomes
    tiny the branch has ended (something snaps through), and the path goes on from where the spring
    settles, see `Mechanics.settle`. It ends early where that fails too.

    Parameters
    ----------
    mechanics : Mechanics
    targets : array
        Displacements in mm, in order.
    start : Equilibrium, optional
        Where to start; the undeformed state by default.
    first_step : float, optional
        First step in mm; 2 % of H by default.
    on_point : callable, optional
        Called with each accepted equilibrium, in-between ones included.

    Returns
    -------
    points : list of Equilibrium
        One for each target that was reached.
    message : str
        Empty, or why and where the path ended.
    """
    height = mechanics.scalar.grid.problem.H
    smallest = 1e-4 * height
    here = mechanics.at_rest() if start is None else start
    step = 0.02 * height if first_step is None else first_step
    points: list[Equilibrium] = []
    for target in map(float, targets):
        while here.d != target:
            distance = target - here.d
            tried = min(step, abs(distance))
            d = target if tried == abs(distance) else here.d + float(np.copysign(tried, distance))
            try:
                there = mechanics.equilibrium(d, here.u + (d - here.d) * here.tangent)
            except ConvergenceError as error:
                step = tried / 2
                if step >= smallest:
                    continue
                try:
                    there = _snap(mechanics, d, here)
                except ConvergenceError:
                    return points, (
                        f"the path ends at d = {here.d:.6g} mm, before {target:.6g} mm: {error}"
                    )
                step = 10 * smallest
            here = there
            if on_point is not None:
                on_point(here)
            if here.iterations <= 4:
                step *= 2.0
            elif here.iterations >= 10:
                step /= 2.0
            step = min(max(step, smallest), 0.05 * height)
        points.append(here)
    return points, ""


def _snap(mechanics: Mechanics, d: float, here: Equilibrium) -> Equilibrium:
    accuracy = 1e-7 * (1e-3 * mechanics.force_unit + abs(here.q))
    u, _ = mechanics.settle(d, here.u, accuracy)
    there = mechanics.equilibrium(d, u)
    logger.info("snap-through at d = %.6g mm: q from %.6g to %.6g N", d, here.q, there.q)
    return there


def checked_displacements(displacements: Iterable[float], problem: SpringProblem) -> FloatArray:
    """Displacements in mm in increasing order, each once.

    Raises
    ------
    ProblemError
        If there are none, or one is not a finite number smaller than H in size.
    """
    try:
        values = np.array(sorted({float(d) for d in displacements}))
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
