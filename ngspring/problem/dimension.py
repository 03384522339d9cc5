"""Units of the numbers of a problem, and how they change from a problem to a similar one."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Dimension:
    """Exponents of what a number is made of.

    Attributes
    ----------
    length : float
        Of lengths in the plane, mm.
    volume : float
        Of volumes, mm^3: twice a length in the plane and once one out of it.
    stress : float
        Of stresses, MPa.
    slope : bool
        Whether it weighs a slope of chi (an inverse length) to the power n of Eq. 11.
    """

    length: float = 0.0
    volume: float = 0.0
    stress: float = 0.0
    slope: bool = False

    def factor(self, length: float, volume: float, stress: float, n: float) -> float:
        """What a number is multiplied by where these units are."""
        a: float = length ** (self.length + (n if self.slope else 0.0))
        return float(a * volume**self.volume * stress**self.stress)

    def unit(self, n: float) -> str:
        """The unit in mm and MPa, such as ``mm^-3``; empty for a plain number."""
        mm = self.length + 3 * self.volume + (n if self.slope else 0.0)
        parts = [("mm", mm), ("MPa", self.stress)]
        return " ".join(
            name if power == 1 else f"{name}^{power:g}" for name, power in parts if power
        )


def quantity(default: float, *, weighs: str = "", **exponents: Any) -> Any:
    """A field of a description with a default and a `Dimension`.

    Parameters
    ----------
    default : float
    weighs : str
        What it weighs, in words, if it is the weight of a term of the objective.
    **exponents
        Of `Dimension`.
    """
    metadata = {"dimension": Dimension(**exponents), "weighs": weighs}
    return dataclasses.field(default=default, metadata=metadata)


def dimensions(described: Any) -> dict[str, Dimension]:
    """Dimensions of the fields of a dataclass that have one, by name."""
    fields = dataclasses.fields(described)
    return {f.name: f.metadata["dimension"] for f in fields if "dimension" in f.metadata}


def weights(described: Any) -> dict[str, str]:
    """What the weights among the fields of a dataclass weigh, by name."""
    fields = dataclasses.fields(described)
    return {f.name: f.metadata["weighs"] for f in fields if f.metadata.get("weighs")}


def used_weights(described: Any) -> dict[str, str]:
    """Those of them that are not zero, or usually are not."""
    fields = {f.name: f.default for f in dataclasses.fields(described)}
    found = weights(described)
    return {name: what for name, what in found.items() if fields[name] or getattr(described, name)}
