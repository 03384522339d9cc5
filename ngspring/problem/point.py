"""One point of the target load path."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import finite_number, refused


@dataclass(frozen=True)
class ControlPoint:
    """One point of the target load path, with its term w/2 (q - q_*)² in the objective (Eq. 9).

    Parameters
    ----------
    d : float
        Prescribed displacement of the top side in mm; positive is tension.
    q : float
        Target reaction force q_* in N; positive is tension.
    weight : float
        Weight w_q of the term in N⁻².
    eta : float
        Offset of chi in the mechanics of this point (section 2.6): the design that is loaded is the
        one with chi + eta, whose solid is dilated by l_i eta / 8; negative values erode it.
    aim : float, optional
        Force in N that the third medium is asked for instead of `q`: corrected, so that the part
        carries `q` (`ngspring.realise`).

    Raises
    ------
    ProblemError
        If a value is not a finite number, `d` is zero or `weight` is not positive.
    """

    d: float
    q: float
    weight: float = 1.0
    eta: float = 0.0
    aim: float | None = None

    def __post_init__(self) -> None:
        for field in ("d", "q", "weight", "eta", *(() if self.aim is None else ("aim",))):
            object.__setattr__(self, field, finite_number(field, getattr(self, field)))
        if self.d == 0.0:
            # The undeformed state is in equilibrium with q = 0 whatever the design.
            raise refused("d", self.d, "different from zero, where the force is zero anyway")
        if self.weight <= 0.0:
            raise refused("weight", self.weight, "positive")

    @property
    def q_star(self) -> float:
        """q_* of Eq. 9, which the third medium is asked for: `aim`, or `q`."""
        return self.q if self.aim is None else self.aim


def deviation(q: ArrayLike, target: ArrayLike) -> FloatArray:
    """Deviation of forces from others in size: positive is stiffer or stronger, whatever the side.

    In N; where nothing is asked for, the size of the force.
    """
    q, target = np.asarray(q, dtype=float), np.asarray(target, dtype=float)
    return np.asarray(np.where(target == 0.0, np.abs(q), (q - target) * np.sign(target)))


def relative_deviation(q: ArrayLike, target: ArrayLike) -> FloatArray:
    """`deviation` as a share of what is asked for; NaN where that is nothing."""
    size = np.abs(np.asarray(target, dtype=float))
    return deviation(q, target) / np.where(size == 0.0, np.nan, size)


def worst_deviation(points: Iterable[ControlPoint], forces: Iterable[float]) -> float | None:
    """The relative deviation of the third medium's forces that is largest in size.

    Of points without eta, from what the third medium is asked for. None if there is no force yet,
    or no target to compare it with.
    """
    far = [
        float(relative_deviation(q, point.q_star))
        for point, q in zip(points, forces, strict=False)
        if point.q_star and not point.eta
    ]
    return max(far, key=abs, default=None)
