"""What every material law says: an energy of a 3 x 3 deformation gradient."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.basics.checks import finite_number, positive_number, refused
from ngspring.problem.kinematics.base import Value

Self = TypeVar("Self", bound="Law")

#: With parameters up to this size nothing overflows.
LARGEST_PARAMETER = 1e15


class Deformation(Protocol):
    """What a law may ask of a deformation gradient F, with the functions for its kind of numbers.

    `Stretches` is one of numbers and arrays, `ngspring.physics.elasticity.Gradient` one of NGSolve.

    Attributes
    ----------
    J, log_J : value
        det F, and its logarithm.
    I_1, I_2 : value
        Invariants of F^T F; the first one is F : F.
    isochoric_I_1, isochoric_I_2 : value
        Those of ``J^(-1/3) F``: 3 without deformation, and larger whenever the shape changes.
    """

    @property
    def J(self) -> Value:
        """det F."""

    @property
    def log_J(self) -> Value:
        """ln det F."""

    @property
    def I_1(self) -> Value:
        """F : F."""

    @property
    def I_2(self) -> Value:
        """Second invariant of F^T F."""

    @property
    def isochoric_I_1(self) -> Value:
        """``J^(-2/3) I_1``."""
        return self.exp(-2 / 3 * self.log_J) * self.I_1

    @property
    def isochoric_I_2(self) -> Value:
        """``J^(-4/3) I_2``."""
        return self.exp(-4 / 3 * self.log_J) * self.I_2

    def power_sum(self, alpha: float) -> Value:
        """Sum of the principal stretches of ``J^(-1/3) F``, each to the power of alpha."""

    def exp(self, x: Value) -> Value:
        """Exponential function."""

    def log(self, x: Value) -> Value:
        """Natural logarithm; not finite where x is not positive."""


class Law(ABC):
    """A hyperelastic law; subclasses are frozen dataclasses of their parameters.

    The energy is a sum of two: one of the change of shape, ``J^(-1/3) F``, in which laws differ,
    and one of the change of volume, which is that of Eq. 14 for all of them. The parameters that
    are stresses are named in `stresses`, so that similar problems have similar laws (`scaled`).

    Attributes
    ----------
    name : str
        As in a TOML file.
    stresses : tuple of str
        Parameters in MPa; the others have no dimension.
    K : float
        Bulk modulus in MPa, a parameter of every law.
    """

    name: ClassVar[str]
    stresses: ClassVar[tuple[str, ...]]
    K: float

    @abstractmethod
    def isochoric_energy(self, F: Deformation) -> Value:
        """Energy density in MPa of the change of shape, zero without deformation."""

    def volumetric_energy(self, log_J: Value) -> Value:
        """Energy density in MPa of the change of volume, ``K/2 (ln J)^2``."""
        return self.K / 2 * log_J * log_J

    def energy(self, F: Deformation) -> Value:
        """Strain energy density in MPa, zero without deformation."""
        return self.volumetric_energy(F.log_J) + self.isochoric_energy(F)

    @property
    @abstractmethod
    def initial_moduli(self) -> tuple[float, float]:
        """Bulk and shear modulus K, G in MPa at small strains."""

    def partial_derivatives(self, F: Deformation) -> tuple[Value, Value] | None:
        """d energy / d I_1 and J d energy / d J, where they are worth writing by hand.

        Only for an energy of I_1 and J. None: the derivatives are taken automatically.
        """
        return None

    def scaled(self: Self, stress: float) -> Self:
        """The law of the similar material whose stresses are so many times larger."""
        factors = {name: getattr(self, name) * stress for name in self.stresses}
        return dataclasses.replace(self, **factors)  # type: ignore[type-var]

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters by their names."""
        return dataclasses.asdict(self)  # type: ignore[call-overload, no-any-return]


def checked_parameters(law: Law, positive: Sequence[str] = ()) -> None:
    """Make all parameters of a law, which is being made, numbers.

    Raises
    ------
    ProblemError
        If one is not a finite number, or one of those in ``positive`` not a positive one.
    """
    for field in dataclasses.fields(law):  # type: ignore[arg-type]
        check = positive_number if field.name in positive else finite_number
        number = check(field.name, getattr(law, field.name))
        if abs(number) > LARGEST_PARAMETER:
            raise refused(field.name, number, f"at most {LARGEST_PARAMETER:g} in size")
        object.__setattr__(law, field.name, number)


@dataclass(frozen=True, eq=False)
class Stretches(Deformation):
    """A deformation given by its principal stretches, numbers or arrays (real or complex)."""

    first: Any
    second: Any
    third: Any

    @property
    def J(self) -> Value:
        """det F."""
        return self.first * self.second * self.third

    @property
    def log_J(self) -> Value:
        """ln det F, without the rounding of the product."""
        first, second, third = self._logs
        return first + second + third

    @cached_property
    def _logs(self) -> tuple[Value, Value, Value]:
        return self.log(self.first), self.log(self.second), self.log(self.third)

    @property
    def I_1(self) -> Value:
        """F : F."""
        return self.first**2 + self.second**2 + self.third**2

    @property
    def I_2(self) -> Value:
        """Second invariant of F^T F."""
        a, b, c = self.first**2, self.second**2, self.third**2
        return a * b + b * c + c * a

    def power_sum(self, alpha: float) -> Value:
        """Sum of the principal stretches of ``J^(-1/3) F``, each to the power of alpha."""
        mean = self.log_J / 3
        return sum(self.exp(alpha * (log - mean)) for log in self._logs)

    def exp(self, x: Value) -> Value:
        """Exponential function."""
        return np.exp(x)

    def log(self, x: Value) -> Value:
        """Natural logarithm; not a number where x is not positive, also if it is complex."""
        possible = np.real(x) > 0.0
        return np.where(possible, np.log(np.where(possible, x, 1.0)), np.nan)


def principal_stresses(
    law: Law, first: Value, second: Value, third: Value
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Principal nominal (first Piola-Kirchhoff) stresses in MPa for given principal stretches.

    Derivatives of the energy by a complex step, exact to rounding. Not numbers where the law has no
    energy.
    """
    stretches = [np.asarray(value, dtype=complex) for value in (first, second, third)]
    step = 1e-200  # whose square is zero
    stresses = []
    for k in range(3):
        moved = [value + (1j * step if i == k else 0.0) for i, value in enumerate(stretches)]
        with np.errstate(all="ignore"):
            stresses.append(np.asarray(np.imag(law.energy(Stretches(*moved))) / step))
    return stresses[0], stresses[1], stresses[2]
