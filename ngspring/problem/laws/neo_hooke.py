"""The compressible neo-Hookean law of the paper (Eq. 14)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ngspring.basics.checks import positive_number
from ngspring.problem.kinematics.base import Value
from ngspring.problem.laws.base import Deformation, Law


@dataclass(frozen=True)
class NeoHooke(Law):
    """``K/2 (ln J)^2 + G/2 (J^(-2/3) F : F - 3)``.

    Parameters
    ----------
    K, G : float
        Bulk and shear modulus in MPa.

    Raises
    ------
    ProblemError
        If one is not a positive number.
    """

    K: float
    G: float

    name: ClassVar[str] = "neo-hooke"
    stresses: ClassVar[tuple[str, ...]] = ("K", "G")

    def __post_init__(self) -> None:
        for name in self.stresses:
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))

    @property
    def initial_moduli(self) -> tuple[float, float]:
        """K and G themselves."""
        return self.K, self.G

    def isochoric_energy(self, F: Deformation) -> Value:
        """Eq. 14 without E(chi) and the term of J."""
        return self.G / 2 * (F.isochoric_I_1 - 3)

    def partial_derivatives(self, F: Deformation) -> tuple[Value, Value] | None:
        """By hand: automatic ones take a fifth longer to assemble (`docs/performance.md`)."""
        isochoric = self.G * F.exp(-2 / 3 * F.log_J)
        return isochoric / 2, self.K * F.log_J - isochoric * F.I_1 / 3
