"""A pattern of imperfection that breaks the symmetries of a spring.

A design is doubly symmetric, and so is its computed path. A real part is not: where the symmetric
path is unstable, the smallest error of its mould decides where it goes. So surfaces are moved by a
little, outwards here and inwards at the mirror image, and the spring has to do the same as before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ngspring.basics.checks import choice, refused
from ngspring.problem.kinematics.base import Value

#: In which axes a pattern may be odd: "xy" stays point-symmetric, as the buckling of most springs
#: of the paper; "y" stays symmetric about x = L/2, "x" about y = H/2.
ODD_IN = ("xy", "x", "y")


def usual_odd_in(axis: bool) -> str:
    """In which axes a pattern is odd if nothing is said: in y of a body of revolution."""
    return "y" if axis else "xy"


def checked_odd_in(field: str, odd_in: str, axis: bool) -> str:
    """Return ``odd_in`` if a spring, a body of revolution or not, can have such a pattern.

    Raises
    ------
    ProblemError
        If it is none, or one that a body of revolution cannot have; the message names the field.
    """
    choice(field, odd_in, ODD_IN)
    if axis and odd_in != "y":
        raise refused(field, odd_in, "'y' in a body of revolution")
    return odd_in


def odd_pattern(x: Value, y: Value, L: float, H: float, odd_in: str, sin: Any = np.sin) -> Value:
    """f(x, y) from -1 to 1, odd about the centre of the domain in the named axes.

    One sine over the width and one over the height: a column is bent into an S (odd in x and y),
    thickened on one side (in x), or at one end (in y).

    Parameters
    ----------
    x, y : value
        Places in mm in the full domain.
    L, H : float
        Its size in mm.
    odd_in : {"xy", "x", "y"}
    sin : callable
        The sine of this kind of numbers.
    """
    along = {"x": 2 * math.pi * (x / L - 0.5), "y": 2 * math.pi * (y / H - 0.5)}
    result = 1.0
    for axis in odd_in:
        result = result * sin(along[axis])
    return result


@dataclass(frozen=True)
class Offset:
    """What is added to chi: a number, and one times a pattern.

    Attributes
    ----------
    eta : float
        Dilation (2.6).
    odd : float
        Factor of the pattern.
    odd_in : {"xy", "x", "y"}
        See `odd_pattern`.
    """

    eta: float = 0.0
    odd: float = 0.0
    odd_in: str = "xy"

    def mirrored(self, sign: float) -> Offset:
        """As it is at the mirror images where the pattern has another sign."""
        return replace(self, odd=sign * self.odd)

    def at(self, x: Value, y: Value, L: float, H: float) -> Value:
        """Its value at places in mm."""
        if not self.odd:
            return self.eta
        return self.eta + self.odd * odd_pattern(x, y, L, H, self.odd_in)
