"""Material laws; a new one is a file and a line here."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from ngspring.basics.checks import finite_number, nearest, shown
from ngspring.basics.errors import ProblemError
from ngspring.problem.laws.arruda_boyce import ArrudaBoyce as ArrudaBoyce
from ngspring.problem.laws.base import Law as Law
from ngspring.problem.laws.gent import Gent as Gent
from ngspring.problem.laws.mooney_rivlin import MooneyRivlin as MooneyRivlin
from ngspring.problem.laws.named import find_named
from ngspring.problem.laws.neo_hooke import NeoHooke as NeoHooke
from ngspring.problem.laws.ogden import Ogden as Ogden
from ngspring.problem.laws.yeoh import Yeoh as Yeoh
from ngspring.problem.material import FITTED_NU, MATERIAL_KEYS, moduli_from

#: By name, the paper's first.
LAWS: Mapping[str, type[Law]] = MappingProxyType(
    {law.name: law for law in (NeoHooke, MooneyRivlin, Yeoh, Ogden, Gent, ArrudaBoyce)}
)


def with_material(described: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a problem with K and G, or a law, in place of what describes the material.

    Parameters
    ----------
    described : mapping
        Fields, and ``E``, ``shore_A``, ``material`` and ``nu`` as for
        `ngspring.problem.material.moduli_from`; ``material`` may also be a law or its table, or
        the name of a material whose law is known, see `ngspring.problem.laws.named`.

    Raises
    ------
    ProblemError
        If the material is described twice, or not validly.
    """
    fields = {key: value for key, value in described.items() if key not in MATERIAL_KEYS}
    law = described.get("material")
    if isinstance(law, Law | Mapping):
        given = [key for key in ("K", "G", *MATERIAL_KEYS) if key in described]
        if given != ["material"]:
            raise ProblemError(
                "the material is described twice, by a law (material) and by"
                f" {next(key for key in given if key != 'material')}: give one"
            )
        return {**fields, "material": law if isinstance(law, Law) else law_from(law)}
    named = find_named(law) if isinstance(law, str) else None
    if named is not None and not described.keys() & {"K", "G", "E", "shore_A"}:
        return {
            **fields,
            "material": named.law(finite_number("nu", described.get("nu", FITTED_NU))),
        }
    moduli = moduli_from(described)
    return fields if moduli is None else {**fields, "K": moduli[0], "G": moduli[1]}


def law_from(described: Mapping[str, object]) -> Law:
    """A law from a table with its name as ``law``, and its parameters.

    Raises
    ------
    ProblemError
        If there is no such law, or a parameter is unknown, missing or not valid.
    """
    name = described.get("law")
    if not isinstance(name, str) or name.casefold() not in LAWS:
        hint = f" (did you mean {nearest(name, LAWS)!r}?)" if isinstance(name, str) else ""
        raise ProblemError(
            f"material.law = {shown(name)} is not valid: it must be {' or '.join(LAWS)}{hint}"
        )
    law = LAWS[name.casefold()]
    fields = dataclasses.fields(law)  # type: ignore[arg-type]
    names = [field.name for field in fields]
    needed = [field.name for field in fields if field.default is dataclasses.MISSING]
    given = {key: value for key, value in described.items() if key != "law"}
    for key in given:
        if key not in names:
            meant = nearest(key, names)
            raise ProblemError(f"unknown key {shown(key)} in material: did you mean {meant!r}?")
    missing = [key for key in needed if key not in given]
    if missing:
        raise ProblemError(f"missing key {missing[0]!r} in material: {law.name} needs it")
    return law(**given)
