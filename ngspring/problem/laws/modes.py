"""The homogeneous tests of rubber, of an incompressible solid: what a law says in each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.problem.laws.base import Law, Stretches

#: Whose square is zero in double precision.
_STEP = 1e-200


@dataclass(frozen=True)
class Mode:
    """A homogeneous deformation of constant volume that one stretch describes.

    Attributes
    ----------
    name : str
    exponents : tuple of float
        The principal stretches are these powers of the stretch that is prescribed. The force acts
        along the first one (and the second, if that is the same), and none along the third.
    """

    name: str
    exponents: tuple[float, float, float]

    def stretches(self, stretch: Any) -> Stretches:
        """Principal stretches, their product being 1."""
        return Stretches(*(stretch**exponent for exponent in self.exponents))

    def largest(self, stretch: float) -> float:
        """The largest of the principal stretches."""
        return max(float(stretch**exponent) for exponent in self.exponents)

    def nominal_stress(self, law: Law, stretch: FloatArray) -> FloatArray:
        """Force over original area in MPa, by a complex step: exact to rounding.

        Of a law that has no energy at such a stretch it is not a number.
        """
        moved = self.stretches(np.asarray(stretch, float) + 1j * _STEP)
        with np.errstate(all="ignore"):
            along = np.imag(law.isochoric_energy(moved)) / _STEP
        return np.asarray(along / self.exponents.count(1.0), float)


#: By name.
MODES: Mapping[str, Mode] = MappingProxyType(
    {
        mode.name: mode
        for mode in (
            Mode("uniaxial", (1.0, -0.5, -0.5)),
            Mode("planar", (1.0, 0.0, -1.0)),
            Mode("equibiaxial", (1.0, 1.0, -2.0)),
        )
    }
)


def tangent(law: Law, first: FloatArray, second: FloatArray) -> FloatArray:
    """Smallest eigenvalue of d tau / d epsilon in MPa, of an incompressible solid without tau_3.

    With Kirchhoff stresses and logarithmic strains in two principal directions, the third following
    from the volume. Positive where the solid is stable in the sense of Drucker and Hill: each
    further step of strain needs more stress in its own direction.

    Parameters
    ----------
    law : Law
    first, second : arrays (points,)
        Principal stretches.
    """
    strains = np.log(np.asarray(first, float)), np.log(np.asarray(second, float))
    h = 1e-5

    def stress(k: int, moves: tuple[float, float]) -> FloatArray:
        e = [strain + move for strain, move in zip(strains, moves, strict=True)]
        e[k] = e[k] + 1j * _STEP
        energy = law.isochoric_energy(Stretches(np.exp(e[0]), np.exp(e[1]), np.exp(-e[0] - e[1])))
        return np.asarray(np.imag(energy) / _STEP)

    with np.errstate(all="ignore"):
        a = (stress(0, (h, 0)) - stress(0, (-h, 0))) / (2 * h)
        b = (stress(0, (0, h)) - stress(0, (0, -h))) / (2 * h)
        c = (stress(1, (0, h)) - stress(1, (0, -h))) / (2 * h)
        return np.asarray((a + c) / 2 - np.hypot((a - c) / 2, b))
