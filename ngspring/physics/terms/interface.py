"""The bound on the slope of chi, which gives the interface its width (Eq. 11)."""

from __future__ import annotations

from typing import ClassVar

import ngsolve as ng

from ngspring.physics.chi import CF
from ngspring.physics.terms.base import Fields, Term
from ngspring.problem.spring import SpringProblem


class Interface(Term):
    """k_i/n <|grad chi| - 8/l_i>^n."""

    name: ClassVar[str] = "interface"
    weight: ClassVar[str] = "k_i"

    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        """Second term of Eq. 11's integrand."""
        n, limit = problem.n, 8 / problem.l_i
        squared = ng.InnerProduct(fields.grad_chi, fields.grad_chi)
        # Guarded inside: the derivative of a square root at 0 is NaN even in a branch not taken.
        slope = ng.sqrt(ng.IfPos(squared - limit**2, squared, limit**2))
        return problem.k_i / n * _power(slope - limit, n)


def _power(base: CF, exponent: float) -> CF:
    """base^exponent for base >= 0; pow() of NGSolve has NaN derivatives at 0."""
    if exponent != int(exponent):
        return ng.IfPos(base - 1e-12, base, 1e-12) ** exponent
    result = base
    for _ in range(int(exponent) - 1):
        result = result * base
    return result
