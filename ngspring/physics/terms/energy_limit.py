"""A bound on the strain energy density of the solid, at every control point."""

from __future__ import annotations

from typing import ClassVar

from ngspring.physics.brackets import bracket, power
from ngspring.physics.chi import CF, rho
from ngspring.physics.elasticity import strain_energy
from ngspring.physics.terms.base import Fields, Term
from ngspring.problem.spring import SpringProblem


class EnergyLimit(Term):
    """k_s/n <rho(chi) (W - limit)/limit>^n with the strain energy density W of the solid (Eq. 14).

    rho(chi) is inside of the power as in `ngspring.physics.terms.stretch_limit`.
    """

    name: ClassVar[str] = "energy"
    weight: ClassVar[str] = "k_s"
    asked_by: ClassVar[str] = "energy_limit"
    of_u: ClassVar[bool] = True

    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        """Integrand at one control point."""
        n, limit = problem.n, problem.energy_limit
        excess = strain_energy(fields.u, fields.grad_u, problem) / limit - 1
        return problem.k_s / n * power(rho(fields.chi) * bracket(excess), n)
