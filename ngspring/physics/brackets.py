"""Macaulay brackets <x>^n with derivatives that NGSolve can take everywhere."""

from __future__ import annotations

import ngsolve as ng

from ngspring.physics.chi import CF


def bracket(x: CF) -> CF:
    """<x>: x where it is positive, and 0 elsewhere."""
    return ng.IfPos(x, x, 0)


def beyond(squared: CF, limit: float) -> CF:
    """<sqrt(squared) - limit>, of which 0 has derivatives, too."""
    # Guarded inside: the derivative of a square root at 0 is NaN even in a branch not taken.
    return ng.sqrt(ng.IfPos(squared - limit**2, squared, limit**2)) - limit


def power(base: CF, exponent: float) -> CF:
    """base^exponent for base >= 0; pow() of NGSolve has NaN derivatives at 0."""
    if exponent != int(exponent):
        return ng.IfPos(base - 1e-12, base, 1e-12) ** exponent
    result = base
    for _ in range(int(exponent) - 1):
        result = result * base
    return result
