"""Gent's law: chains that cannot be stretched beyond a limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ngspring.problem.kinematics.base import Value
from ngspring.problem.laws.base import Deformation, checked_parameters
from ngspring.problem.laws.first_invariant import FirstInvariantLaw


@dataclass(frozen=True)
class Gent(FirstInvariantLaw):
    """``-mu J_m/2 ln(1 - (I_1 - 3)/J_m)``, I_1 being ``J^(-2/3) F : F``.

    The energy is infinite where I_1 - 3 reaches J_m, and there is none beyond: a step that goes so
    far has failed, as one has that turns an element inside out.

    Parameters
    ----------
    K : float
        Bulk modulus in MPa.
    mu : float
        Initial shear modulus in MPa.
    J_m : float
        Limit of I_1 - 3, without dimension.

    Raises
    ------
    ProblemError
        If one is not a positive number.

    References
    ----------
    A. N. Gent: A new constitutive relation for rubber. Rubber Chemistry and Technology 69 (1996)
    59-61.
    """

    K: float
    mu: float
    J_m: float

    name: ClassVar[str] = "gent"
    stresses: ClassVar[tuple[str, ...]] = ("K", "mu")

    def __post_init__(self) -> None:
        checked_parameters(self, positive=("K", "mu", "J_m"))

    @property
    def initial_moduli(self) -> tuple[float, float]:
        """K and mu."""
        return self.K, self.mu

    def of_invariant(self, F: Deformation, I_1: Value) -> Value:
        """Gent's logarithm."""
        return -self.mu * self.J_m / 2 * F.log(1 - (I_1 - 3) / self.J_m)

    def slope(self, F: Deformation, I_1: Value) -> Value:
        """Its derivative, a quotient as a power: not a number beyond the limit."""
        return self.mu / 2 * F.exp(-F.log(1 - (I_1 - 3) / self.J_m))
