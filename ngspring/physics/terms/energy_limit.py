"""A bound on the strain energy density of the solid, at every control point."""

from __future__ import annotations

from typing import ClassVar

import ngsolve as ng

from ngspring.physics.brackets import power
from ngspring.physics.chi import CF, stiffness
from ngspring.physics.elasticity import strain_energy
from ngspring.physics.terms.base import Fields, Term
from ngspring.problem.spring import SpringProblem


class EnergyLimit(Term):
    """E(chi) k_s/n <(W - limit)/limit>^n with the strain energy density W of the solid (Eq. 14)."""

    name: ClassVar[str] = "energy"
    weight: ClassVar[str] = "k_s"
    of_u: ClassVar[bool] = True

    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        """Integrand at one control point."""
        n, limit = problem.n, problem.energy_limit
        excess = strain_energy(fields.u, fields.grad_u, problem) / limit - 1
        bracket = power(ng.IfPos(excess, excess, 0), n)
        return problem.k_s / n * stiffness(fields.chi, problem) * bracket

    def active(self, problem: SpringProblem) -> bool:
        """Whether there is a limit."""
        return problem.energy_limit > 0.0
