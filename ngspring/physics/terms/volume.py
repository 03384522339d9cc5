"""The volume of the solid (Eqs. 10, 11, 23)."""

from __future__ import annotations

from typing import ClassVar

from ngspring.physics.chi import CF, rho
from ngspring.physics.terms.base import Fields, Term
from ngspring.problem.spring import SpringProblem


class Volume(Term):
    """k_rho rho."""

    name: ClassVar[str] = "volume"
    weight: ClassVar[str] = "k_rho"

    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        """First term of Eq. 11's integrand."""
        return problem.k_rho * rho(fields.chi)
