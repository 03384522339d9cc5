"""The law of Mooney and Rivlin: linear in both invariants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ngspring.basics.checks import refused
from ngspring.problem.kinematics.base import Value
from ngspring.problem.laws.base import Deformation, Law, checked_parameters


@dataclass(frozen=True)
class MooneyRivlin(Law):
    """``C10 (I_1 - 3) + C01 (I_2 - 3)`` with the invariants of ``J^(-1/3) F``.

    In plane strain of an incompressible solid I_1 = I_2: there it is neo-Hooke with
    ``G = 2 (C10 + C01)``, and only other tests tell the two parameters apart.

    Parameters
    ----------
    K, C10, C01 : float
        Bulk modulus and coefficients in MPa.

    Raises
    ------
    ProblemError
        If one is not a number, or K or the initial shear modulus is not positive.

    References
    ----------
    R. S. Rivlin: Large elastic deformations of isotropic materials IV. Philosophical Transactions
    of the Royal Society A 241 (1948) 379-397.
    """

    K: float
    C10: float
    C01: float

    name: ClassVar[str] = "mooney-rivlin"
    stresses: ClassVar[tuple[str, ...]] = ("K", "C10", "C01")

    def __post_init__(self) -> None:
        checked_parameters(self, positive=("K",))
        if self.C10 + self.C01 <= 0.0:
            raise refused("C10 + C01", self.C10 + self.C01, "positive, half the shear modulus")

    @property
    def initial_moduli(self) -> tuple[float, float]:
        """K and 2 (C10 + C01)."""
        return self.K, 2 * (self.C10 + self.C01)

    def isochoric_energy(self, F: Deformation) -> Value:
        """Linear in both invariants."""
        return self.C10 * (F.isochoric_I_1 - 3) + self.C01 * (F.isochoric_I_2 - 3)
