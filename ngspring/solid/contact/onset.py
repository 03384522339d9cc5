"""Where contact starts along a load path."""

from __future__ import annotations

from ngspring.basics.errors import ConvergenceError
from ngspring.solid.contact.mechanics import ContactMechanics, ContactPoint


def contact_onset(
    mechanics: ContactMechanics, before: ContactPoint, after: ContactPoint, accuracy: float
) -> float:
    """Displacement in mm where contact starts, between a point without and one with contact.

    By bisection, with an equilibrium at each trial; as accurate as that where one cannot be found.
    """
    low, high = before, after.d
    while abs(high - low.d) > accuracy:
        d = (low.d + high) / 2
        try:
            middle = mechanics.equilibrium(d, low.u + (d - low.d) * low.tangent)
        except ConvergenceError:
            break
        if middle.contact.smallest_gap < 0.0:
            high = d
        else:
            low = middle
    return (low.d + high) / 2
