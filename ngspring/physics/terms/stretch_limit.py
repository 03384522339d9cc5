"""A bound on the largest principal stretch of the solid, at every control point."""

from __future__ import annotations

from typing import ClassVar

import ngsolve as ng

from ngspring.physics.brackets import beyond, bracket, power
from ngspring.physics.chi import CF, rho
from ngspring.physics.elasticity import gradient
from ngspring.physics.terms.base import Fields, Term
from ngspring.problem.spring import SpringProblem

#: Where both stretches in the plane are the same their derivatives are not defined: rounded off.
_SMOOTH = 1e-12


class StretchLimit(Term):
    """k_s/n <rho(chi) (lambda - limit)/limit>^n of the stretches in the plane and out of it.

    It is the solid's stretch that counts. Grey material between two surfaces that part stretches
    by hundreds of percent, which outside of the power not even E(chi) outweighs: with rho(chi)
    inside of it the solid decides.
    """

    name: ClassVar[str] = "stretch"
    weight: ClassVar[str] = "k_s"
    asked_by: ClassVar[str] = "stretch_limit"
    of_u: ClassVar[bool] = True

    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        """Integrand at one control point."""
        n, limit = problem.n, problem.stretch_limit
        F = gradient(fields.u, fields.grad_u, problem)
        half, det = ng.InnerProduct(F.in_plane, F.in_plane) / 2, ng.Det(F.in_plane)
        spread = half * half - det * det
        squared = half + ng.sqrt(bracket(spread) + _SMOOTH)
        share = rho(fields.chi) / limit
        excess = power(share * beyond(squared, limit), n)
        excess = excess + power(share * beyond(F.F_33 * F.F_33, limit), n)
        return problem.k_s / n * excess
