"""The whole state of a design in one compound space (chi, u_1, lam_1, ..., u_J, lam_J).

The solver works point by point (`ngspring.kkt.system`); here all fields of Eq. 5 live in one
GridFunction of NGSolve, to be drawn, integrated and differentiated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np

from ngspring.basics.checks import shown
from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.fem.process import parallel
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.physics.chi import CF
from ngspring.physics.elasticity import measure
from ngspring.physics.lagrangian import (
    design_fields,
    fields_with_displacements,
    internal_virtual_work,
)
from ngspring.physics.offset import OffsetField
from ngspring.physics.terms import TERMS
from ngspring.physics.void import dx, void_virtual_work
from ngspring.problem.material import LARGEST_NU, split_bulk_modulus
from ngspring.problem.spring import SpringProblem


@dataclass(frozen=True, eq=False)
class CompoundState:
    """All fields of a design and its control points.

    Attributes
    ----------
    problem : SpringProblem
    mesh : ngsolve.Mesh
        Of the analysed part, in mm.
    space : ngsolve.FESpace
        Compound space of chi (H1, order 2) and, for each control point, u in mm and lam in N^-1
        (VectorH1, order 2).
    state : ngsolve.GridFunction
        Its ``components`` are the fields.
    """

    problem: SpringProblem
    mesh: ng.Mesh
    space: ng.FESpace
    state: ng.GridFunction

    @property
    def chi(self) -> ng.GridFunction:
        """The design field."""
        return self.state.components[0]

    def u(self, j: int) -> ng.GridFunction:
        """Displacements in mm at control point j (from 0)."""
        return self.state.components[1 + 2 * j]

    def lam(self, j: int) -> ng.GridFunction:
        """Adjoint displacements in N^-1 at control point j (from 0)."""
        return self.state.components[2 + 2 * j]

    def lagrangian(self) -> ng.BilinearForm:
        """C* of Eq. 5 without the transient term, as a form on `space`.

        Its ``Energy(state.vec)`` is the value; ``Apply`` gives the first variation on all dofs,
        which vanishes at a stationary point in the directions that the boundary conditions of 2.5
        and the splines allow, and ``AssembleLinearization`` the second. For looking, not for
        solving: `ngspring.kkt.system` is far faster.

        Raises
        ------
        ProblemError
            If the solid is nearly incompressible, so that it has a pressure field.
        """
        problem = self.problem
        if split_bulk_modulus(problem.K, problem.G)[1]:
            raise ProblemError(
                f"K = {shown(problem.K)} and G = {shown(problem.G)} are those of a nearly"
                f" incompressible solid, whose pressure field is no part of this form: nu must be"
                f" at most {LARGEST_NU}"
            )
        chi, *fields = self.space.TrialFunction()
        form = ng.BilinearForm(self.space, symmetric=True)
        for term in TERMS:
            if not term.of_u and term.active(problem):
                density = term.density(design_fields(chi), problem)
                form += ng.Variation(measure(problem) * density * dx())
        for point, u, lam in zip(problem.control_points, fields[::2], fields[1::2], strict=True):
            offset = OffsetField(problem, [point.odd_in])
            offset.set(point.offset)
            eta = offset.value
            form += ng.Variation(internal_virtual_work(chi + eta, u, lam, problem) * dx())
            form += ng.Variation(void_virtual_work(chi + eta, u, lam, problem) * dx())
            form += ng.Variation(_of_force(point, lam, problem) * ng.ds("top"))
            for term in TERMS:
                if term.of_u and term.active(problem):
                    density = term.density(fields_with_displacements(chi, eta, u), problem)
                    form += ng.Variation(measure(problem) * density * dx())
        return form


def _of_force(point: Any, lam: CF, problem: SpringProblem) -> CF:
    """-q_* lam_Ty - lam_Ty^2 / (2 w) per length of the top side, where lam_y is constant."""
    sector = problem.sector
    lam_Ty = lam[1] / sector.share
    return -(point.q_star * lam_Ty + lam_Ty * lam_Ty / (2 * point.weight)) / sector.size[0]


def compound_state(
    design: Design,
    domain: str | None = None,
    *,
    state: State | None = None,
    threads: int | None = None,
    solver: str = "auto",
) -> CompoundState:
    """The compound space and GridFunction of (chi, u_1, lam_1, ..., u_J, lam_J) for a design.

    Equilibria and adjoints are solved from the undeformed state (Eqs. 4 and 7).

    Parameters
    ----------
    design : Design
    domain : {"quarter", "full"}, optional
        Overrides the problem's.
    state : State, optional
        Take these unknowns of the coupled system instead of solving for them.
    threads, solver
        See `ngspring.optimize`.

    Raises
    ------
    ProblemError
        If a control point has an imperfection, and only a quarter is to be shown.
    ConvergenceError
        If a control point cannot be reached from the undeformed state.

    Examples
    --------
    In a notebook::

        fields = compound_state(ngspring.gallery["C7"])
        Draw(rho(fields.chi), fields.mesh, deformation=fields.u(2))
        fields.lagrangian().Energy(fields.state.vec)
    """
    problem = design.problem if domain is None else design.problem.replace(domain=domain)
    if problem.sector.half_height and any(point.eta_odd for point in problem.control_points):
        raise ProblemError(
            "a control point with an imperfection has more than one field on the quarter: take the"
            ' full domain (domain = "full")'
        )
    with parallel(threads, problem) as count:
        system = CoupledSystem(problem, solver, count)
        if state is None:
            state = initial_state(system, design)
        mesh = system.grid.mesh
        vector = ng.VectorH1(mesh, order=2)
        space = ng.FESpace([system.scalar.space, *[vector] * (2 * len(system.points))])
        field = ng.GridFunction(space, name="chi, u_1, lam_1, ...")
        parts = [system.control_point_vector(state, j) for j in range(len(system.points))]
        n = system.scalar.ndof
        field.vec.FV().NumPy()[:] = np.concatenate([parts[0][:n], *(part[n:] for part in parts)])
    return CompoundState(problem, mesh, space, field)
