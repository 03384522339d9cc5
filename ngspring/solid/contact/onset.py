"""Where contact starts along a load path."""

from __future__ import annotations

from dataclasses import replace

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
            middle = mechanics.equilibrium(d, mechanics.predicted(low, d))
        except ConvergenceError:
            break
        if mechanics.touching(middle):
            high = d
        else:
            low = replace(middle, before=replace(low, before=None))
    return (low.d + high) / 2
