"""Laws of the first isochoric invariant alone."""

from __future__ import annotations

from abc import abstractmethod

from ngspring.problem.kinematics.base import Value
from ngspring.problem.laws.base import Deformation, Law


class FirstInvariantLaw(Law):
    """A law whose energy of the change of shape is a function of ``I_1 = J^(-2/3) F : F`` alone.

    Its derivatives are written by hand: automatic ones take longer to assemble.
    """

    @abstractmethod
    def of_invariant(self, F: Deformation, I_1: Value) -> Value:
        """Energy density in MPa; F has the functions."""

    @abstractmethod
    def slope(self, F: Deformation, I_1: Value) -> Value:
        """Its derivative by I_1; not finite where the energy is not."""

    def isochoric_energy(self, F: Deformation) -> Value:
        """Energy density in MPa of the change of shape."""
        return self.of_invariant(F, F.isochoric_I_1)

    def partial_derivatives(self, F: Deformation) -> tuple[Value, Value] | None:
        """d energy / d I_1 and J d energy / d J."""
        by_I_1 = self.slope(F, F.isochoric_I_1) * F.exp(-2 / 3 * F.log_J)
        return by_I_1, self.K * F.log_J - 2 / 3 * by_I_1 * F.I_1
