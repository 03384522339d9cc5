"""The Lagrangian C* (Eq. 5) as NGSolve forms; everything else is its automatic linearisation.

After eliminating q_j and its multiplier (u_Ty is known, q_j = q*_j + lam_Ty / w_j) the functional
reads::

    C*(chi, u, lam) = sum_j [ R_j(chi + eta_j, u_j; lam_j) + C_u(chi + eta_j, u_j)
                              - q*_j lam_Ty,j - lam_Ty,j^2 / (2 w_j) ]
                      + C_chi(chi; chi_old, dt)

with ``R_j`` the internal virtual work of Eq. 19, ``C_chi`` the terms of the objective that depend
on the design alone (Eq. 11, and walls and gaps), and ``C_u`` those that depend on displacements
(none in the paper). Its first variation is Eqs. 4, 7 and 8 at once, its second one the symmetric
Newton matrix. The forms here act on the compound space (chi, u, lam) of one control point;
`ngspring.kkt` puts the blocks together.
"""

from __future__ import annotations

from collections.abc import Sequence

import ngsolve as ng
import numpy as np
import scipy.sparse as sp

from ngspring.basics.arrays import FloatArray
from ngspring.fem.grid import ScalarSpace
from ngspring.fem.process import tasks
from ngspring.fem.reduction import form_matrix, stored_values
from ngspring.physics.chi import CF, rho, stiffness
from ngspring.physics.elasticity import measure, virtual_work
from ngspring.physics.offset import OffsetField
from ngspring.physics.pressure import PressureBlocks, PressureField
from ngspring.physics.terms import TERMS
from ngspring.physics.terms.base import Fields, Term
from ngspring.physics.void import (
    ElementTable,
    VoidBlocks,
    VoidRegularisation,
    dx,
)
from ngspring.problem.imperfection import Offset
from ngspring.problem.scaling import adjoint_unit
from ngspring.problem.spring import SpringProblem


def internal_virtual_work(chi: CF, u: CF, lam: CF, problem: SpringProblem) -> CF:
    """Integrand over the mesh of R (Eq. 19) without the terms of the void and of a pressure field.

    Parameters
    ----------
    chi : ngsolve.CoefficientFunction
        With the offset eta of the control point.
    u, lam : proxies or grid functions of a vector-valued H1 space
    problem : SpringProblem
    """
    work = virtual_work(u, ng.Grad(u), lam, ng.Grad(lam), problem)
    return measure(problem) * stiffness(chi, problem) * work


def design_fields(chi: CF) -> Fields:
    """The design field, a proxy or a grid function of the scalar space, for a term's density."""
    return Fields(chi, ng.grad(chi), chi.Operator("hesse"))


def fields_with_displacements(chi: CF, offset: CF, u: CF) -> Fields:
    """The fields at a control point, for the density of a term that depends on displacements."""
    return Fields(chi + offset, ng.grad(chi), chi.Operator("hesse"), u, ng.Grad(u))


def transient_energy(
    chi: CF, grad_chi: CF, chi_old: CF, grad_chi_old: CF, problem: SpringProblem
) -> CF:
    """Last term of Eq. 11 after backward Euler, times dt: its variation is that of Eq. 12."""
    change, grad_change = chi - chi_old, grad_chi - grad_chi_old
    return 0.5 * (change * change + problem.l_t**2 * ng.InnerProduct(grad_change, grad_change))


class ControlPointForm:
    """R(chi + eta, u; lam) of Eq. 19 without its boundary term, for any control point.

    With the terms of the objective that depend on displacements. Vectors are the dofs of the
    compound space (chi, u, lam), ``5 ndof`` numbers. With an imperfection they are those of one of
    the copies that are analysed (`ngspring.fem.images`), and its offset is taken with its sign.
    """

    def __init__(self, scalar: ScalarSpace, terms: Sequence[Term] = TERMS) -> None:
        grid = scalar.grid
        problem = grid.problem
        self.ndof = scalar.ndof
        self.terms = tuple(term for term in terms if term.of_u and term.active(problem))
        displacement = ng.VectorH1(grid.mesh, order=2)
        self.space = ng.FESpace([scalar.space, displacement, displacement])
        self._problem = problem
        odd_in = [point.odd_in for point in problem.control_points if point.eta_odd]
        self._offset = OffsetField(problem, odd_in)
        chi, u, lam = self.space.TrialFunction()
        #: lam of the form's own vectors is in this unit: NGSolve takes mixed second derivatives by
        #: polarisation, and with lam far from the size of u nothing would remain of them.
        self.lam_unit = adjoint_unit(problem)
        density = self.lam_unit * internal_virtual_work(chi + self._offset.value, u, lam, problem)
        self.form = ng.BilinearForm(self.space, symmetric=True)
        self.form += ng.Variation(density.Compile() * dx())
        self.void = VoidRegularisation(scalar)
        self.pressure = PressureField.where_needed(scalar, self.void.table)
        self._state = ng.GridFunction(self.space)
        self._result = self._state.vec.CreateVector()
        fields = fields_with_displacements(chi, self._offset.value, u)
        self._of_term: dict[str, ng.BilinearForm] = {}
        for term in self.terms:
            part = (measure(problem) * term.density(fields, problem)).Compile() * dx()
            self.form += ng.Variation(part)
            self._of_term[term.name] = ng.BilinearForm(self.space, symmetric=True)
            self._of_term[term.name] += ng.Variation(part)

    def _load(self, vector: FloatArray, offset: Offset) -> FloatArray:
        self._offset.set(offset)
        own = self._state.vec.FV().NumPy()
        own[:] = vector
        own[3 * self.ndof :] /= self.lam_unit
        table, problem = self.void.table, self._problem
        of_offset = offset.at(table.x, table.y, problem.L, problem.H)
        return np.asarray(self.void.chi_at_points(vector[: self.ndof]) + of_offset)

    def residual(self, vector: FloatArray, offset: Offset) -> FloatArray:
        """First derivative, on the dofs of the compound space."""
        at_points = self._load(vector, offset)
        with tasks():
            self.form.Apply(self._state.vec, self._result)
        n = self.ndof
        void = self.void.residual(at_points, vector[n : 3 * n], vector[3 * n :])
        result = np.array(self._result.FV().NumPy())
        result[3 * n :] /= self.lam_unit
        result = result + np.concatenate(void)
        if self.pressure is not None:
            pressure = self.pressure.residual(at_points, vector[n : 3 * n], vector[3 * n :])
            result = result + np.concatenate(pressure)
        return np.asarray(result)

    def tangent(
        self, vector: FloatArray, offset: Offset
    ) -> tuple[FloatArray, VoidBlocks, PressureBlocks | None]:
        """Second derivative: values on the form's pattern, the void's blocks and the pressure's.

        The values are by lam in units of `lam_unit`, the blocks by lam in N^-1.
        """
        at_points = self._load(vector, offset)
        with tasks():
            self.form.AssembleLinearization(self._state.vec)
        n = self.ndof
        u, lam = vector[n : 3 * n], vector[3 * n :]
        void = self.void.blocks(at_points, u, lam)
        pressure = None if self.pressure is None else self.pressure.blocks(at_points, u, lam)
        return stored_values(self.form), void, pressure

    def values(self, vector: FloatArray, offset: Offset) -> dict[str, float]:
        """The terms that depend on displacements, at one control point."""
        self._load(vector, offset)
        return {name: float(form.Energy(self._state.vec)) for name, form in self._of_term.items()}

    def adjoint_load(self, chi: FloatArray, u: FloatArray, offset: Offset) -> FloatArray:
        """Derivative of those terms by u (dofs of the VectorH1 space).

        The right-hand side that they give Eq. 7: R is linear in lam, and vanishes for lam = 0.
        """
        vector = np.concatenate([chi, u, np.zeros_like(u)])
        return self.residual(vector, offset)[self.ndof : 3 * self.ndof]


class DesignForm:
    """C_chi of Eq. 11 on the H1 dofs of chi; the transient term is a matrix times 1/dt."""

    def __init__(self, scalar: ScalarSpace, terms: Sequence[Term] = TERMS) -> None:
        problem = scalar.grid.problem
        space = scalar.space
        chi = space.TrialFunction()
        per_area = measure(problem)
        fields = design_fields(chi)

        def form(*densities: CF) -> ng.BilinearForm:
            result = ng.BilinearForm(space, symmetric=True)
            result += ng.Variation((per_area * sum(densities, ng.CF(0.0))).Compile() * dx())
            return result

        of_design = [term for term in terms if not term.of_u and term.active(problem)]
        densities = {term.name: term.density(fields, problem) for term in of_design}
        self.terms = {name: form(density) for name, density in densities.items()}
        fixed = [term.name for term in of_design if term.quadratic]
        self.nonlinear = form(*(d for name, d in densities.items() if name not in fixed))
        self.quadratic = [self.terms[name] for name in fixed]
        self.transient = form(
            transient_energy(chi, ng.grad(chi), ng.CF(0.0), ng.CF((0, 0)), problem)
        )
        self._chi = ng.GridFunction(space)
        self._chi.vec[:] = 0.0
        self._result = self._chi.vec.CreateVector()
        self.transient_matrix = self._assembled(self.transient)
        self._matrices = {name: self._assembled(self.terms[name]) for name in fixed}
        self._table = ElementTable(scalar)

    def _assembled(self, form: ng.BilinearForm) -> sp.csr_matrix:
        with tasks():
            form.AssembleLinearization(self._chi.vec)
        return form_matrix(form)

    def _load(self, chi: FloatArray) -> None:
        self._chi.vec.FV().NumPy()[:] = chi

    def gradient(self, chi: FloatArray, term: str) -> FloatArray:
        """First derivative of one term of C_chi, by its name."""
        if term in self._matrices:
            return np.asarray(self._matrices[term] @ chi)
        self._load(chi)
        with tasks():
            self.terms[term].Apply(self._chi.vec, self._result)
        return np.array(self._result.FV().NumPy())

    def tangent_nonlinear(self, chi: FloatArray) -> FloatArray:
        """Second derivative of the terms that are not quadratic, on the form's pattern."""
        self._load(chi)
        with tasks():
            self.nonlinear.AssembleLinearization(self._chi.vec)
        return stored_values(self.nonlinear)

    def values(self, chi: FloatArray) -> dict[str, float]:
        """The terms of C_chi, and the volume V in mm^3 (Eq. 10 or 23) as "V"."""
        self._load(chi)
        values = {
            name: float(chi @ (self._matrices[name] @ chi)) / 2
            if name in self._matrices
            else float(form.Energy(self._chi.vec))
            for name, form in self.terms.items()
        }
        at_points = chi[self._table.dofs] @ self._table.value.T
        values["V"] = float((self._table.weights * rho(at_points)).sum())
        return values
