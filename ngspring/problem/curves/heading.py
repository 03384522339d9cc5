"""What the heading of a column says: which quantity, in which unit, and how it was measured."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass

_NEWTON_PER_POUND = 4.4482216152605
_STANDARD_GRAVITY = 9.80665

#: Factors to mm, N, MPa and 1, by the spelling of `unit_of`. A library of units would take longer
#: to import than all else here, and knows neither "lbs" as a force nor headings.
UNITS: dict[str, dict[str, float]] = {
    "d": {"mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3, "in": 25.4},
    "q": {
        "N": 1.0,
        "kN": 1e3,
        "mN": 1e-3,
        "uN": 1e-6,
        "lbf": _NEWTON_PER_POUND,
        "kgf": _STANDARD_GRAVITY,
        "gf": 1e-3 * _STANDARD_GRAVITY,
    },
    "strain": {"-": 1.0, "1": 1.0, "": 1.0, "mm/mm": 1.0, "%": 0.01},
    "stress": {
        "MPa": 1.0,
        "N/mm2": 1.0,
        "kPa": 1e-3,
        "Pa": 1e-6,
        "GPa": 1e3,
        "bar": 0.1,
        "psi": _NEWTON_PER_POUND / 25.4**2,
        "kgf/cm2": 1e-2 * _STANDARD_GRAVITY,
    },
}
#: Further spellings. In force and stress a pound and a kilogram are forces.
_SPELLINGS = {
    **{"lb": "lbf", "lbs": "lbf", "kp": "kgf", "inch": "in", "inches": "in", "in/in": "mm/mm"},
    **{"m/m": "mm/mm", "kg/cm2": "kgf/cm2"},
}
#: What is measured in another unit if the unit says so: the elongation in %, the stretch in mm.
_PARTNERS = {"d": "strain", "strain": "d"}

#: Names of the columns that are understood, in lower case.
NAMES: dict[str, str] = {
    **dict.fromkeys(("d", "displacement", "deflection", "travel", "extension", "elongation"), "d"),
    **dict.fromkeys(("q", "force", "load", "reaction", "f"), "q"),
    **dict.fromkeys(("strain", "epsilon", "ε"), "strain"),
    **dict.fromkeys(("stress", "sigma", "σ"), "stress"),
}
_STRETCHES = ("stretch", "stretch ratio", "extension ratio", "lambda", "λ")
_QUALIFIER = re.compile(
    r"(compress\w*|tens\w*|axial|nominal|eng(ineering|\.)?|technical)[\s_]+(?=\w)"
)
_TRUE = re.compile(r"(true|cauchy|log(arithmic|\.)?|hencky|natural)[\s_]+(?=\w)")
#: Measures that are neither nominal nor true.
_OTHER_MEASURE = re.compile(r"green|almansi|(second|2nd)[\s_]+p|pk2", re.IGNORECASE)

_HEADING = re.compile(r"(?P<name>.*?)\s*(?:[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])])?")
#: ``name / unit`` as in ISO 80000, and ``name_unit``.
_WITH_SLASH = re.compile(
    r"(?P<name>[^/\[\](),]*[^/\[\](),\s])(?P<slash>\s*/\s*)[(\[]?(?P<unit>[^\[\]()]+?)[)\]]?"
)
_WITH_UNDERSCORE = re.compile(r"(?P<name>[^/\[\](),]+)_(?P<unit>[^_\[\]()\s]+)")


def unit_of(text: str) -> str:
    """A unit as `UNITS` spells it, whatever the micro sign, the exponent and the dot."""
    plain = unicodedata.normalize("NFKC", text).replace("μ", "u").strip(" .").replace("^", "")
    return _SPELLINGS.get(plain, plain)


def is_unit(text: str) -> bool:
    """Whether a text is a unit of `UNITS` and nothing else, in brackets or not."""
    unit = unit_of(text.strip("[]() "))
    return bool(unit) and any(unit in units for units in UNITS.values())


@dataclass(frozen=True)
class Heading:
    """The heading of a column.

    Attributes
    ----------
    text : str
        As it stands in the file.
    name : str
        In lower case, without unit and number.
    kind : str
        ``d``, ``q``, ``strain`` or ``stress``; empty if the name is not known.
    unit : str or None
        As `UNITS` spells it; None if there is none.
    measure : {"", "true", "stretch"}
        True stress or strain, or a stretch in place of a strain.
    """

    text: str
    name: str
    kind: str
    unit: str | None
    measure: str = ""

    @classmethod
    def of(cls, text: str, numbered: bool = False) -> Heading:
        """Read a heading; ``numbered`` names, such as ``Force 2``, have their number taken off."""
        text = text.strip().strip('"')
        # What pandas adds to the second column of a name.
        plain = re.sub(r"(?<=[^\W\d]|[\])])\.\d+$", "", text)
        for name, unit in cls._with_unit(plain):
            heading = cls._named(text, name, unit, numbered)
            if heading.unit in UNITS.get(heading.kind or heading.kind_of_unit, {}):
                return heading
        if is_unit(plain) and plain.casefold() not in NAMES:
            return cls(text, "", "", unit_of(plain.strip("[]() ")))
        match = _HEADING.fullmatch(plain)
        assert match is not None
        return cls._named(text, match["name"], match["unit"], numbered)

    @classmethod
    def _named(cls, text: str, name: str, unit: str | None, numbered: bool) -> Heading:
        name = re.sub(r"\s*[\[(].*?[\])]", "", name).strip().casefold()
        if numbered:
            name = re.sub(r"[\s_#]*\d+$", "", name)
        unit = None if unit is None else unit_of(unit)
        if name == "compression" and unit is None:
            return cls(text, name, "d", None)
        plain, measure = name, ""
        while match := _QUALIFIER.match(plain) or _TRUE.match(plain):
            measure = "true" if match.re is _TRUE else measure
            plain = plain[match.end() :]
        kind = NAMES.get(plain, "")
        if plain in _STRETCHES:
            kind, measure = "strain", "stretch"
        partner = _PARTNERS.get(kind, "")
        if unit and unit not in UNITS.get(kind, {}) and unit in UNITS.get(partner, {}):
            kind, measure = partner, ""
        return cls(text, name, kind, unit, measure if kind in ("strain", "stress") else "")

    @staticmethod
    def _with_unit(text: str) -> Iterator[tuple[str, str]]:
        """Names and units without brackets, if these are what they may be."""
        match = _WITH_SLASH.fullmatch(text)
        # "N/mm" and "rate mm/s" are units themselves.
        if match and (match["slash"] != "/" or not _ends_with_unit(match["name"])):
            yield match["name"], match["unit"]
        match = _WITH_UNDERSCORE.fullmatch(text)
        # The number of "d_1" is no unit.
        if match and match["unit"] not in ("1", "-"):
            yield match["name"].strip(), match["unit"]

    @property
    def kind_of_unit(self) -> str:
        """The kind of quantity that is measured in this unit; empty if there is none or several."""
        kinds = [kind for kind, units in UNITS.items() if self.unit and self.unit in units]
        return kinds[0] if len(kinds) == 1 and not self.has_other_measure else ""

    @property
    def has_other_measure(self) -> bool:
        """Whether this is a stress or strain of another kind than nominal or true."""
        return bool(_OTHER_MEASURE.search(self.name))


def _ends_with_unit(name: str) -> bool:
    """Whether the last word of a name is a unit, where it is not a known name as F and d are."""
    word = name.split()[-1]
    return word.casefold() not in NAMES and is_unit(word)
