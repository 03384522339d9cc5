"""Laws of silicones by name, fitted to measurements.

One term of Ogden's law through the nominal stresses at strains of 0.5, 1 and 2: within 2 % of them,
and stable at every stretch. Softer than 10 Shore A, or stiffening strongly, these are not described
by a Shore A hardness.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from ngspring.problem.laws.ogden import Ogden
from ngspring.problem.material import bulk_modulus, plain_name

#: Where the stresses come from.
SOURCE = (
    "L. Marechal et al., Soft Robotics 8 (2021) 284-297, and its Soft Robotics Materials Database:"
    " pulled once to failure (ASTM D412)"
)


@dataclass(frozen=True)
class NamedLaw:
    """What was measured of a material, and the law through it.

    Attributes
    ----------
    name : str
    stresses : tuple of float
        Nominal stress in MPa at strains of 0.5, 1 and 2, uniaxial tension.
    mu1, alpha1 : float
        Parameters of one term of Ogden's law; mu1 in MPa.
    """

    name: str
    stresses: tuple[float, float, float]
    mu1: float
    alpha1: float

    def law(self, nu: float) -> Ogden:
        """The law with K for a Poisson's ratio.

        Raises
        ------
        ProblemError
            If nu is not between -1 and 0.5.
        """
        return Ogden(bulk_modulus(self.mu1 * self.alpha1 / 2, nu), self.mu1, self.alpha1)

    @property
    def E(self) -> float:
        """Young's modulus in MPa at small strains, of an incompressible solid."""
        return 1.5 * self.mu1 * self.alpha1


_MEASURED = (
    NamedLaw("Ecoflex 00-30", (0.0169, 0.0297, 0.0524), 0.013827, 2.2385),
    NamedLaw("Ecoflex 00-50", (0.0228, 0.0410, 0.0790), 0.016307, 2.4515),
    NamedLaw("Dragon Skin 10", (0.0530, 0.1130, 0.2728), 0.026396, 3.1355),
    NamedLaw("Dragon Skin 30", (0.2139, 0.4371, 0.9595), 0.12088, 2.8995),
)
#: By name.
NAMED: Mapping[str, NamedLaw] = MappingProxyType({each.name: each for each in _MEASURED})


def find_named(name: str) -> NamedLaw | None:
    """The measured material of this name, in upper or lower case; None if there is none."""
    plain = plain_name(name)
    for each in _MEASURED:
        own = plain_name(each.name)
        if plain in (own, f"{own}a", f"{own} a", f"{own} medium"):
            return each
    return None
