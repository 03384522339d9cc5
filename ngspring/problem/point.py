"""One point of the target load path."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import choice, finite_number, refused
from ngspring.problem.imperfection import ODD_IN, Offset


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
    eta_odd : float
        Offset of chi as `eta`, times a pattern from -1 to 1 that breaks the design's symmetries
        (`ngspring.problem.imperfection`): the design that is loaded has an imperfection.
    odd_in : {"xy", "x", "y"}
        The axes in which the pattern is odd.

    Raises
    ------
    ProblemError
        If a value is not a finite number, `d` is zero, `weight` is not positive, or there is no
        such `odd_in`.
    """

    d: float
    q: float
    weight: float = 1.0
    eta: float = 0.0
    aim: float | None = None
    eta_odd: float = 0.0
    odd_in: str = "xy"

    def __post_init__(self) -> None:
        numbers = ("d", "q", "weight", "eta", "eta_odd", *(() if self.aim is None else ("aim",)))
        for field in numbers:
            object.__setattr__(self, field, finite_number(field, getattr(self, field)))
        choice("odd_in", self.odd_in, ODD_IN)
        if self.d == 0.0:
            # The undeformed state is in equilibrium with q = 0 whatever the design.
            raise refused("d", self.d, "different from zero, where the force is zero anyway")
        if self.weight <= 0.0:
            raise refused("weight", self.weight, "positive")

    @property
    def own(self) -> bool:
        """Whether it belongs to the design itself, without an offset or an imperfection."""
        return not self.eta and not self.eta_odd

    @property
    def on_curves(self) -> bool:
        """Whether its state is one of a load-displacement curve.

        One with an imperfection has other symmetries than what curves are computed with.
        """
        return not self.eta_odd

    @property
    def offset(self) -> Offset:
        """What is added to chi."""
        return Offset(self.eta, self.eta_odd, self.odd_in)

    @property
    def variant(self) -> str:
        """How the design that is loaded differs from the design itself; empty if it does not."""
        parts = [f"η = {self.eta:g}"] if self.eta else []
        parts += [f"imperfect in {' and '.join(self.odd_in)}"] if self.eta_odd else []
        return ", ".join(parts)

    @property
    def eta_text(self) -> str:
        """Its offset in a table's column η; that of an imperfection with the sign of both."""
        odd = f"±{abs(self.eta_odd):g} {self.odd_in}" if self.eta_odd else ""
        return f"{self.eta:g}" if not odd else f"{self.eta:g} {odd}" if self.eta else odd

    @property
    def words(self) -> str:
        """What tells it from other control points, by the keys of a file."""
        odd = f", eta_odd = {self.eta_odd:g} in {self.odd_in}" if self.eta_odd else ""
        return f"d = {self.d}, eta = {self.eta}{odd}"

    @property
    def place(self) -> tuple[float, float, float, str]:
        """What is loaded, and how far; there is one target for each."""
        return self.d, self.eta, self.eta_odd, self.odd_in if self.eta_odd else ""

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

    Of the design's own points, from what the third medium is asked for. None if there is no force
    yet, or no target to compare it with.
    """
    far = [
        float(relative_deviation(q, point.q_star))
        for point, q in zip(points, forces, strict=False)
        if point.q_star and point.own
    ]
    return max(far, key=abs, default=None)
