"""The bound on the slope of chi, which gives the interface its width (Eq. 11)."""

from __future__ import annotations

from typing import ClassVar

import ngsolve as ng

from ngspring.physics.brackets import beyond, power
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
        return problem.k_i / n * power(beyond(squared, limit), n)
