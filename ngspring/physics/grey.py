"""How much of the strain energy is in material that is neither solid nor void."""

from __future__ import annotations

import ngsolve as ng

from ngspring.design.soundness import GREY
from ngspring.physics.chi import CF, rho, stiffness
from ngspring.physics.elasticity import measure, strain_energy
from ngspring.physics.void import dx
from ngspring.problem.spring import SpringProblem


def grey_share(chi: CF, u: CF, mesh: ng.Mesh, problem: SpringProblem) -> float:
    """Share of the strain energy in material whose density is in `GREY`.

    Parameters
    ----------
    chi : ngsolve.CoefficientFunction
        With the offset eta of its control point.
    u : ngsolve.GridFunction
        Displacement in mm.
    mesh : ngsolve.Mesh
    problem : SpringProblem
    """
    low, high = GREY
    energy = measure(problem) * stiffness(chi, problem) * strain_energy(u, ng.Grad(u), problem)
    inside = ng.IfPos(rho(chi) - low, ng.IfPos(high - rho(chi), 1.0, 0.0), 0.0)
    whole, grey = (float(ng.Integrate(f.Compile() * dx(), mesh)) for f in (energy, energy * inside))
    return grey / whole if whole > 0.0 else 0.0
