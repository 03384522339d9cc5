"""Yeoh's law: a cubic polynomial of the first invariant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ngspring.problem.kinematics.base import Value
from ngspring.problem.laws.base import Deformation, checked_parameters
from ngspring.problem.laws.first_invariant import FirstInvariantLaw


@dataclass(frozen=True)
class Yeoh(FirstInvariantLaw):
    """``C10 (I_1 - 3) + C20 (I_1 - 3)^2 + C30 (I_1 - 3)^3``, I_1 being ``J^(-2/3) F : F``.

    Filled rubber: C20 is usually negative (it softens first), and C30 positive (it stiffens in the
    end).

    Parameters
    ----------
    K, C10, C20, C30 : float
        Bulk modulus and coefficients in MPa.

    Raises
    ------
    ProblemError
        If one is not a number, or K or the initial shear modulus ``G = 2 C10`` is not positive.

    References
    ----------
    O. H. Yeoh: Some forms of the strain energy function for rubber. Rubber Chemistry and Technology
    66 (1993) 754-771.
    """

    K: float
    C10: float
    C20: float
    C30: float

    name: ClassVar[str] = "yeoh"
    stresses: ClassVar[tuple[str, ...]] = ("K", "C10", "C20", "C30")

    def __post_init__(self) -> None:
        checked_parameters(self, positive=("K", "C10"))

    @property
    def initial_moduli(self) -> tuple[float, float]:
        """K and 2 C10."""
        return self.K, 2 * self.C10

    def of_invariant(self, F: Deformation, I_1: Value) -> Value:
        """The cubic polynomial."""
        x = I_1 - 3
        return x * (self.C10 + x * (self.C20 + x * self.C30))

    def slope(self, F: Deformation, I_1: Value) -> Value:
        """Its derivative."""
        x = I_1 - 3
        return self.C10 + x * (2 * self.C20 + 3 * self.C30 * x)
