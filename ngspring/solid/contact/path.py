"""Following a load path with contact, with adaptive steps, and where contact starts."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError
from ngspring.solid.contact.mechanics import ContactMechanics, ContactPoint

logger = logging.getLogger(__name__)

_SMALLEST_STEP = 1e-5
_LARGEST_STEP = 0.05
_EASY, _HARD = 14, 24


def follow_contact(
    mechanics: ContactMechanics,
    targets: FloatArray,
    start: ContactPoint,
    first_step: float | None = None,
    on_point: Callable[[ContactPoint], None] | None = None,
) -> tuple[list[ContactPoint], str]:
    """Follow the path through displacements that move away from the start one way.

    The predictor is `ContactMechanics.predicted`, shortened where a wall would jump through
    another. The step grows after easy steps and is halved after failed ones.

    Parameters
    ----------
    mechanics : ContactMechanics
    targets : array
        Displacements in mm, in order.
    start : ContactPoint
    first_step : float, optional
        In mm; 1 % of the size by default.
    on_point : callable, optional
        Called with each accepted point, in-between ones included.

    Returns
    -------
    points : list of ContactPoint
        One for each target that was reached.
    message : str
        Empty, or why and where the path ended.
    """
    size = mechanics.size
    here = start
    step = 0.01 * size if first_step is None else first_step
    points: list[ContactPoint] = []
    for target in map(float, targets):
        while here.d != target:
            distance = target - here.d
            tried = min(step, abs(distance))
            try:
                there, tried = _advance(mechanics, here, distance, tried)
            except ConvergenceError as error:
                step = tried / 2
                if step >= _SMALLEST_STEP * size:
                    continue
                return points, (
                    f"the path ends at d = {here.d:.6g} mm, before {target:.6g} mm: {error}"
                )
            logger.info(
                "d = %.6g mm: q = %.8g N, %d iterations, gap %.3g mm",
                there.d,
                there.q,
                there.iterations,
                there.contact.smallest_gap,
            )
            here = there
            if on_point is not None:
                on_point(here)
            if here.iterations <= _EASY:
                step = 1.7 * max(tried, step if here.d == target else 0.0)
            elif here.iterations >= _HARD:
                step = tried / 2
            else:
                step = tried
            step = min(max(step, _SMALLEST_STEP * size), _LARGEST_STEP * size)
        points.append(here)
    return points, ""


def _advance(
    mechanics: ContactMechanics, here: ContactPoint, distance: float, tried: float
) -> tuple[ContactPoint, float]:
    """One step of at most `tried`; the step that was made may be shorter."""
    begin = mechanics.full_field(here.d, here.u)
    while True:
        whole = tried == abs(distance)
        d = here.d + distance if whole else here.d + float(np.copysign(tried, distance))
        guess = mechanics.predicted(here, d)
        end = mechanics.full_field(d, guess)
        free_way = mechanics.skeleton.largest_step(begin, end)
        if free_way == 1.0 and not mechanics.solid.inverted(end):
            return mechanics.equilibrium(d, guess), tried
        tried *= 0.5 if free_way == 1.0 else max(0.8 * free_way, 0.1)
        if tried < 0.1 * _SMALLEST_STEP * mechanics.size:
            raise ConvergenceError("every step would carry a wall through another")


def contact_onset(
    mechanics: ContactMechanics, before: ContactPoint, after: ContactPoint, accuracy: float
) -> float:
    """Displacement in mm where contact starts, between a point without and one with contact.

    By bisection, with an equilibrium at each trial; as accurate as that where one cannot be found.
    """
    low, high = before, after.d
    while abs(high - low.d) > accuracy:
        d = (low.d + high) / 2
        try:
            middle = mechanics.equilibrium(d, low.u + (d - low.d) * low.tangent)
        except ConvergenceError:
            break
        if middle.contact.smallest_gap < 0.0:
            high = d
        else:
            low = middle
    return (low.d + high) / 2
