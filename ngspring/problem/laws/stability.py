"""In which range of stretches a law is stable, found numerically."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray
from ngspring.problem.kinematics.base import Kinematics
from ngspring.problem.laws.base import Law
from ngspring.problem.laws.modes import MODES, Mode, tangent

#: Stretches between which a law is examined.
SMALLEST, LARGEST = 0.1, 10.0
_PLACES = 400
#: Beyond this part of the shear modulus below zero a tangent is negative, and not rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class StableRange:
    """Where a law is stable in the sense of Drucker, of an incompressible solid.

    Attributes
    ----------
    ranges : mapping from str to pair of float
        By the name of the test: smallest and largest stretch up to which, from 1, it is; 0.1 and 10
        where it is as far as was examined.
    """

    ranges: Mapping[str, tuple[float, float]]

    def first_limit(self, tests: Iterable[str] = tuple(MODES)) -> tuple[float, str]:
        """The smallest principal stretch with which stability ends, and the test in which it does.

        Infinite, and no test, where it does not between 0.1 and 10. A test in compression counts
        with the stretch to the side.
        """
        limits = [
            (MODES[name].largest(end), f"{name} {'compression' if end < 1.0 else 'tension'}")
            for name in tests
            for end in self.ranges[name]
            if SMALLEST < end < LARGEST
        ]
        return min(limits, default=(float("inf"), ""))

    def __str__(self) -> str:
        parts = [f"{name} {low:.3g} to {high:.3g}" for name, (low, high) in self.ranges.items()]
        return ", ".join(parts)


@lru_cache(maxsize=64)
def stable_range(law: Law) -> StableRange:
    """Where a law is stable in uniaxial, planar and equibiaxial tension and compression.

    Parameters
    ----------
    law : Law

    Returns
    -------
    StableRange
    """
    return StableRange({name: _range(law, mode) for name, mode in MODES.items()})


def _range(law: Law, mode: Mode) -> tuple[float, float]:
    return _end(law, mode, SMALLEST), _end(law, mode, LARGEST)


def _end(law: Law, mode: Mode, end: float) -> float:
    """The stretch, on the way from 1 to an end, up to which the law is stable."""

    def stable(logs: FloatArray) -> NDArray[np.bool_]:
        stretches = mode.stretches(np.exp(logs))
        least = tangent(law, stretches.first, stretches.second)
        return np.asarray(least > -_ROUNDING * law.initial_moduli[1])

    places = np.linspace(0.0, np.log(end), _PLACES + 1)
    unstable = np.flatnonzero(~stable(places))
    if not unstable.size:
        return end
    if unstable[0] == 0:
        return 1.0
    inside, outside = places[unstable[0] - 1], places[unstable[0]]
    for _ in range(40):
        middle = (inside + outside) / 2
        if stable(np.array([middle]))[0]:
            inside = middle
        else:
            outside = middle
    return float(np.exp(inside))


def first_limit(law: Law, motion: Kinematics) -> tuple[float, str]:
    """The smallest principal stretch with which stability ends, and the test in which it does.

    In plane strain only the planar test counts. See `StableRange.first_limit`.
    """
    return stable_range(law).first_limit(MODES if motion.axis else ("planar",))


def instability(law: Law, stretch: float, motion: Kinematics) -> str:
    """A sentence on a principal stretch with which a law is not stable any more; else empty.

    Parameters
    ----------
    law : Law
    stretch : float
        Largest principal stretch of a solid.
    motion : Kinematics
    """
    limit, test = first_limit(law, motion)
    if not stretch > limit:
        return ""
    return (
        f"The solid is stretched to {stretch:.3g}, but the {law.name} law is stable only up to a"
        f" principal stretch of {limit:.3g} ({test}): do not trust it there."
    )
