"""How numbers are printed: by their significant digits, whatever their size."""

from __future__ import annotations

import math

#: Numbers below this are written out where that takes more than the significant digits.
_PLAIN = 1e7
#: What is smaller by this factor than what it stands among is rounding.
_ROUNDING = 1e-12


def significant(value: float, digits: int, sign: str = "", among: float = 0.0) -> str:
    """A number with this many significant digits, trailing zeros included; a dash for NaN or inf.

    With all digits before the point, if they are more, and no exponent for the first seven.

    Parameters
    ----------
    value : float
    digits : int
        At least two.
    sign : {"", "+"}
        "+" for a sign before positive numbers, too.
    among : float
        The size of the numbers beside it: what is 0 but for rounding is printed as 0.
    """
    if not math.isfinite(value):
        return "-"
    if abs(value) <= _ROUNDING * abs(among):
        return "0"
    if 10**digits <= abs(value) < _PLAIN:
        return format(value, f"{sign}.0f")
    return format(value, f"{sign}#.{digits}g").rstrip(".")
