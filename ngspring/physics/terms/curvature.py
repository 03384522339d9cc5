"""The curvature of chi (Eq. 11)."""

from __future__ import annotations

from typing import ClassVar

import ngsolve as ng

from ngspring.physics.chi import CF
from ngspring.physics.terms.base import Fields, Term
from ngspring.problem.spring import SpringProblem


class Curvature(Term):
    """k_H/2 H chi : H chi."""

    name: ClassVar[str] = "curvature"
    weight: ClassVar[str] = "k_H"
    quadratic: ClassVar[bool] = True

    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        """Third term of Eq. 11's integrand."""
        return problem.k_H / 2 * ng.InnerProduct(fields.hesse_chi, fields.hesse_chi)
