"""Elastic constants: E and nu for K and G, and Young's modulus from a Shore A hardness.

The solid of the paper is neo-Hookean with an initial bulk modulus K and an initial shear modulus G
(Eq. 14). Materials are sold by hardness and described by Young's modulus E and Poisson's ratio nu.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from ngspring.basics.checks import finite_number, positive_number, shown
from ngspring.basics.errors import ProblemError

#: Poisson's ratio of the paper's solid (K = 5/3 MPa, G = 5/14 MPa), and the one taken by default.
NU = 0.4

#: Above this the solid is nearly incompressible: what its bulk modulus has more than one with this
#: ratio goes through a pressure field, see `split_bulk_modulus`.
LARGEST_NU = 0.45

#: Above this nothing has been tried, see `nu_advice`.
NEAREST_NU = 0.4999

#: The one of laws that were fitted to tests of a nearly incompressible material.
FITTED_NU = 0.45

#: Gent's relation is used between these hardnesses; beyond them it is a guess.
GENT_RANGE = (20.0, 80.0)


def bulk_and_shear_modulus(E: float, nu: float) -> tuple[float, float]:
    """K and G of an isotropic solid.

    ``K = E / (3 (1 - 2 nu))``, ``G = E / (2 (1 + nu))``.

    Parameters
    ----------
    E : float
        Young's modulus (in MPa, then K and G are, too).
    nu : float
        Poisson's ratio.

    Raises
    ------
    ProblemError
        If E is not positive, or nu not between -1 and 0.5, both excluded.
    """
    E, nu = positive_number("E", E), finite_number("nu", nu)
    if not -1.0 < nu < 0.5:
        raise ProblemError(
            f"nu = {shown(nu)} is not valid: it must be between -1 and 0.5, both excluded;"
            f" {NU} is the paper's, and {NEAREST_NU} is as good as incompressible"
        )
    return E / (3 * (1 - 2 * nu)), E / (2 * (1 + nu))


def young_and_poisson(K: float, G: float) -> tuple[float, float]:
    """E and nu of an isotropic solid.

    ``E = 9 K G / (3 K + G)``, ``nu = (3 K - 2 G) / (6 K + 2 G)``.

    Raises
    ------
    ProblemError
        If K or G is not positive.
    """
    K, G = positive_number("K", K), positive_number("G", G)
    return 9 * K * G / (3 * K + G), (3 * K - 2 * G) / (6 * K + 2 * G)


def bulk_modulus(G: float, nu: float) -> float:
    """K in MPa of a solid with this shear modulus and Poisson's ratio.

    Raises
    ------
    ProblemError
        If they are not valid.
    """
    return bulk_and_shear_modulus(2 * G * (1 + nu), nu)[0]


def split_bulk_modulus(K: float, G: float) -> tuple[float, float]:
    """The part of K that displacements carry at every point, and the excess of a pressure field.

    A displacement element locks where K is far larger than G: it cannot keep its volume at every
    point and bend. So only as much of K is taken point by point as a solid with nu = `LARGEST_NU`
    has, and the rest acts on a smoother change of volume (`ngspring.physics.pressure`, and
    `ngspring.solid.contact.pressure`). Up to that nu there is no rest, and the formulation is that
    of the paper; above, forces go on continuously.

    Two curved walls 15 mm thick that bend in the 100 x 100 mm domain are, on 16 x 16 elements (2.4
    across a wall), stiffer than on 64 x 64 by 1.4 % for nu = 0.4 and 2.2 % for 0.45; by 2.2, 2.1
    and 2.1 % for 0.49, 0.499 and 0.4999. With all of K at every point the last three would be 6.3,
    25 and 53 %; on 32 x 32 they are 0.5, 0.4 and 0.3 %, and would be 1.2, 4.2 and 9.9 %.

    Parameters
    ----------
    K, G : float
        Initial bulk and shear modulus in MPa.

    Returns
    -------
    tuple of float
        Both in MPa; their sum is K.
    """
    largest = bulk_and_shear_modulus(1.0, LARGEST_NU)
    carried = G * largest[0] / largest[1]
    excess = K - carried
    # K and G of this very nu must not differ from it by rounding.
    return (K, 0.0) if excess <= 1e-9 * carried else (carried, excess)


def young_from_shore_A(hardness: float) -> float:
    """Young's modulus in MPa of a rubber with a Shore A hardness, by Gent's relation.

    ``E = 0.0981 (56 + 7.62336 S) / (0.137505 (254 - 2.54 S))``. It follows from the indentation of
    a linear elastic half-space; use it between 20 and 80 Shore A, and do not expect more than
    about 20 % of accuracy: compounds of the same hardness differ. A tensile test of the material
    that is cast or printed beats every table.

    References
    ----------
    A. N. Gent: On the relation between indentation hardness and Young's modulus. Rubber Chemistry
    and Technology 31 (1958) 896-906.

    Raises
    ------
    ProblemError
        If the hardness is not between 0 and 100, both excluded.
    """
    S = finite_number("shore_A", hardness)
    if not 0.0 < S < 100.0:
        raise ProblemError(
            f"shore_A = {shown(hardness)} is not valid: it must be between 0 and 100, both excluded"
            f" (Gent's relation is good for {GENT_RANGE[0]:g} to {GENT_RANGE[1]:g})"
        )
    return 0.0981 * (56 + 7.62336 * S) / (0.137505 * (254 - 2.54 * S))


def nu_advice(nu: float) -> str:
    """What to know about a Poisson's ratio very close to 0.5; empty for others.

    Up to `NEAREST_NU` there is nothing to know: above `LARGEST_NU` a pressure field keeps elements
    from locking (`split_bulk_modulus`).
    """
    if nu <= NEAREST_NU + 1e-9:
        return ""
    return (
        f"nu = {nu:g} is closer to 0.5 than has been tried, and the linear systems lose digits:"
        f" {NEAREST_NU} is as incompressible as a spring can tell, since it may bulge"
    )


@dataclass(frozen=True)
class Elastomer:
    """A family of elastomers.

    Attributes
    ----------
    name : str
    symbol : str
        ISO 1629 or ISO 18064 symbol, or the usual abbreviation; empty if there is none.
    shore_A : pair of float
        Hardness in which it is commonly offered.
    typical : float
        Shore A hardness of a usual grade.
    note : str
        How springs of it are made.
    """

    name: str
    symbol: str
    shore_A: tuple[float, float]
    typical: float
    note: str


#: Hardness ranges as suppliers of sheets, casting resins and filaments commonly offer them
#: (rounded to 5; no standard fixes them). Moduli are not tabulated: they follow from the hardness.
ELASTOMERS: tuple[Elastomer, ...] = (
    Elastomer("silicone", "VMQ", (10, 80), 30, "cast; little hysteresis"),
    Elastomer("natural rubber", "NR", (30, 90), 50, "moulded; little hysteresis, tough"),
    Elastomer("styrene-butadiene", "SBR", (40, 90), 60, "moulded"),
    Elastomer("nitrile", "NBR", (40, 90), 70, "moulded; resists oil"),
    Elastomer("neoprene", "CR", (30, 90), 60, "moulded; resists weather"),
    Elastomer("EPDM", "EPDM", (30, 90), 60, "moulded; resists weather, not oil"),
    Elastomer("butyl", "IIR", (40, 80), 55, "moulded; damps strongly"),
    Elastomer("fluoroelastomer", "FKM", (55, 90), 75, "moulded; resists heat"),
    Elastomer("cast polyurethane", "PUR", (20, 95), 60, "cast; resists abrasion"),
    Elastomer("TPU", "TPU", (60, 95), 85, "printed; noticeable hysteresis"),
    Elastomer("SEBS", "TPS", (10, 90), 50, "moulded or printed"),
    # 44 (cured at 25 °C) to 54 (200 °C): Johnston et al., J. Micromech. Microeng. 24 (2014) 035017.
    Elastomer("Sylgard 184", "PDMS", (44, 54), 45, "cast; Johnston et al. 2014"),
    # "Available in Shore 10A, 20A and 30A": Smooth-On, technical bulletin of the series.
    Elastomer("Dragon Skin", "", (10, 30), 20, "cast; Smooth-On"),
)

#: What else they are called, in lower case.
_ALIASES = {
    **dict.fromkeys(("silicone rubber", "silicon rubber", "silikon", "lsr", "rtv"), "silicone"),
    **dict.fromkeys(("rubber", "latex"), "natural rubber"),
    **dict.fromkeys(("nitrile rubber", "buna n"), "nitrile"),
    **dict.fromkeys(("polyurethane", "pu"), "cast polyurethane"),
    **dict.fromkeys(("thermoplastic polyurethane", "tpu filament"), "tpu"),
    "viton": "fluoroelastomer",
    "sylgard": "sylgard 184",
}
#: A name with a Shore A hardness, ``TPU 95A``.
_WITH_HARDNESS = re.compile(
    r"(?P<name>.*?[^\W\d]) (shore ?)?(a ?)?(?P<hardness>\d{1,2}) ?((shore )?a)?"
)


def plain_name(name: str) -> str:
    """A name in lower case, with single blanks in place of blanks and hyphens."""
    return " ".join(name.casefold().replace("-", " ").split())


def find_elastomer(name: str) -> Elastomer:
    """The elastomer with this name or symbol, in upper or lower case.

    A Shore A hardness behind the name, as in ``TPU 95A`` or ``Dragon Skin 30``, is the typical one
    of what is returned.

    Raises
    ------
    ProblemError
        If there is none; the message says what to give instead.
    """
    known = {plain_name(key): e for e in ELASTOMERS for key in (e.name, e.symbol) if key}
    known |= {alias: known[meant] for alias, meant in _ALIASES.items()}
    if not isinstance(name, str):
        raise ProblemError(f"material = {shown(name)} is not valid: it must be a name")
    plain = plain_name(name)
    if plain in known:
        return known[plain]
    match = _WITH_HARDNESS.fullmatch(plain)
    if match and match["name"] in known:
        found = known[match["name"]]
        return replace(found, name=name.strip(), typical=float(match["hardness"]))
    # Only what must be a slip: no other material than the one that is meant.
    near = difflib.get_close_matches(plain, known, n=1, cutoff=0.8)
    hint = f" (did you mean {known[near[0]].name!r}?)" if near else ""
    raise ProblemError(
        f"there is no material {shown(name)} in the table of elastomers{hint}: give its Young's"
        " modulus E in MPa and nu, or its hardness if that is on the Shore A scale (not 00 or D)"
    )


#: Keys that describe a material instead of K and G.
MATERIAL_KEYS = ("E", "nu", "shore_A", "material")


def moduli_from(described: Mapping[str, object]) -> tuple[float, float] | None:
    """K and G from a description by E, a Shore A hardness or a name, and nu.

    Parameters
    ----------
    described : mapping
        May have the keys ``E`` (MPa), ``shore_A``, ``material`` (a name, see `find_elastomer`:
        stands for its typical hardness), ``nu`` (0.4 by default), and ``K`` and ``G`` instead;
        others are ignored.

    Returns
    -------
    pair of float, or None
        K and G in MPa; None if there is none of ``MATERIAL_KEYS``.

    Raises
    ------
    ProblemError
        If the stiffness is given twice or not at all, or a value is not valid.
    """
    keys = [key for key in MATERIAL_KEYS if key in described]
    if not keys:
        return None
    twice = [key for key in ("K", "G") if key in described]
    if twice:
        raise ProblemError(
            f"the material is described twice, by {keys[0]} and by {twice[0]}: give either K and G,"
            " or E (or shore_A, or material) and nu"
        )
    stiffness = [key for key in keys if key != "nu"]
    if not stiffness:
        raise ProblemError("nu is given without E, shore_A or material: say how stiff the solid is")
    if "E" in stiffness and len(stiffness) > 1:
        raise ProblemError(
            f"the stiffness is described twice, by E and by {stiffness[1]}: give one of them"
        )
    nu = finite_number("nu", described.get("nu", NU))
    if "E" in stiffness:
        return bulk_and_shear_modulus(finite_number("E", described["E"]), nu)
    hardness: object = None
    if "material" in stiffness:
        name = described["material"]
        hardness = find_elastomer(name if isinstance(name, str) else shown(name)).typical
    hardness = described.get("shore_A", hardness)
    return bulk_and_shear_modulus(young_from_shore_A(finite_number("shore_A", hardness)), nu)
