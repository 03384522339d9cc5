"""Ogden's law: powers of the principal stretches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ngspring.basics.checks import refused, shown
from ngspring.basics.errors import ProblemError
from ngspring.problem.kinematics.base import Value
from ngspring.problem.laws.base import Deformation, Law, checked_parameters

#: Larger exponents belong to no material.
LARGEST_EXPONENT = 30.0


@dataclass(frozen=True)
class Ogden(Law):
    """``sum_p mu_p/alpha_p (l_1^alpha_p + l_2^alpha_p + l_3^alpha_p - 3)``, one to three terms.

    l_i are the principal stretches of ``J^(-1/3) F``. These are Ogden's own mu_p, the initial shear
    modulus is ``G = 1/2 sum_p mu_p alpha_p``; programs that write the energy with
    ``2 mu_p/alpha_p^2`` have ``mu_p alpha_p / 2`` for mu_p.

    Parameters
    ----------
    K : float
        Bulk modulus in MPa.
    mu1, mu2, mu3 : float
        In MPa; without the second or third there are so few terms.
    alpha1, alpha2, alpha3 : float
        Exponents of any sign.

    Raises
    ------
    ProblemError
        If one is not a number, a mu is without its alpha, an alpha is larger than 30, or K or the
        initial shear modulus is not positive.

    References
    ----------
    R. W. Ogden: Large deformation isotropic elasticity - on the correlation of theory and
    experiment for incompressible rubberlike solids. Proceedings of the Royal Society A 326 (1972)
    565-584.
    """

    K: float
    mu1: float
    alpha1: float
    mu2: float = 0.0
    alpha2: float = 0.0
    mu3: float = 0.0
    alpha3: float = 0.0

    name: ClassVar[str] = "ogden"
    stresses: ClassVar[tuple[str, ...]] = ("K", "mu1", "mu2", "mu3")

    def __post_init__(self) -> None:
        checked_parameters(self, positive=("K",))
        if not self.mu1:
            raise refused("mu1", self.mu1, "another number: the first term of the law")
        for k, (mu, alpha) in enumerate(self._pairs, start=1):
            if bool(mu) != bool(alpha):
                raise ProblemError(
                    f"mu{k} = {shown(mu)} and alpha{k} = {shown(alpha)} are not valid: a term needs"
                    " both, and neither may be 0"
                )
            if abs(alpha) > LARGEST_EXPONENT:
                raise refused(f"alpha{k}", alpha, f"at most {LARGEST_EXPONENT:g} in size")
        G = self.initial_moduli[1]
        if G <= 0.0:
            raise ProblemError(
                f"the initial shear modulus G = {G:g} MPa is not valid: the sum of mu alpha / 2"
                " must be positive"
            )

    @property
    def _pairs(self) -> tuple[tuple[float, float], ...]:
        return (self.mu1, self.alpha1), (self.mu2, self.alpha2), (self.mu3, self.alpha3)

    @property
    def terms(self) -> tuple[tuple[float, float], ...]:
        """The pairs (mu_p, alpha_p) that there are."""
        return tuple(pair for pair in self._pairs if pair[0])

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters by their names, without terms that there are not."""
        return {name: value for name, value in super().parameters.items() if value}

    @property
    def initial_moduli(self) -> tuple[float, float]:
        """K and half the sum of mu_p alpha_p."""
        return self.K, sum(mu * alpha for mu, alpha in self.terms) / 2

    def isochoric_energy(self, F: Deformation) -> Value:
        """The sum over the terms."""
        return sum(mu / alpha * (F.power_sum(alpha) - 3) for mu, alpha in self.terms)
