"""The eight-chain law of Arruda and Boyce."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ngspring.basics.checks import refused
from ngspring.problem.kinematics.base import Value
from ngspring.problem.laws.base import Deformation, checked_parameters
from ngspring.problem.laws.first_invariant import FirstInvariantLaw

#: Coefficients of the series of the inverse Langevin function.
SERIES = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)


@dataclass(frozen=True)
class ArrudaBoyce(FirstInvariantLaw):
    """``mu (1/2 (I_1 - 3) + 1/(20 lambda_m^2) (I_1^2 - 9) + ...)``, I_1 being ``J^(-2/3) F : F``.

    The usual series of five terms, ``mu sum_i C_i lambda_m^(2 - 2 i) (I_1^i - 3^i)``, with
    ``C = 1/2, 1/20, 11/1050, 19/7000, 519/673750``. It goes on beyond the locking stretch lambda_m,
    where the inverse Langevin function itself ends. The initial shear modulus is larger than mu:
    ``G = mu (1 + 3/5 lambda_m^-2 + 99/175 lambda_m^-4 + 513/875 lambda_m^-6
    + 42039/67375 lambda_m^-8)``.

    Parameters
    ----------
    K : float
        Bulk modulus in MPa.
    mu : float
        In MPa.
    lambda_m : float
        Locking stretch, without dimension.

    Raises
    ------
    ProblemError
        If K or mu is not a positive number, or lambda_m not larger than 1.

    References
    ----------
    E. M. Arruda and M. C. Boyce: A three-dimensional constitutive model for the large stretch
    behavior of rubber elastic materials. Journal of the Mechanics and Physics of Solids 41 (1993)
    389-412.
    """

    K: float
    mu: float
    lambda_m: float

    name: ClassVar[str] = "arruda-boyce"
    stresses: ClassVar[tuple[str, ...]] = ("K", "mu")

    def __post_init__(self) -> None:
        checked_parameters(self, positive=("K", "mu", "lambda_m"))
        if self.lambda_m <= 1.0:
            raise refused("lambda_m", self.lambda_m, "larger than 1, a stretch")

    @property
    def initial_moduli(self) -> tuple[float, float]:
        """K, and mu with the factor of the series."""
        terms = enumerate(self._coefficients, start=1)
        return self.K, 2 * sum(i * c * 3 ** (i - 1) for i, c in terms)

    @property
    def _coefficients(self) -> tuple[float, ...]:
        """Of I_1, I_1^2, ... in MPa."""
        return tuple(self.mu * c * self.lambda_m ** (-2 * k) for k, c in enumerate(SERIES))

    def of_invariant(self, F: Deformation, I_1: Value) -> Value:
        """The series."""
        value: Value = 0.0
        for c in reversed(self._coefficients):
            value = (c + value) * I_1
        return value - sum(c * 3**i for i, c in enumerate(self._coefficients, start=1))

    def slope(self, F: Deformation, I_1: Value) -> Value:
        """Its derivative."""
        value: Value = 0.0
        for i, c in reversed(list(enumerate(self._coefficients, start=1))):
            value = i * c + value * I_1
        return value
