"""The Lagrangian C* (Eq. 5) as NGSolve forms; everything else is its automatic linearisation.

After eliminating q_j and its multiplier (u_Ty is known, q_j = q*_j + lam_Ty / w_j) the functional
reads::

    C*(chi, u, lam) = sum_j [ R_j(chi + eta_j, u_j; lam_j) - q*_j lam_Ty,j - lam_Ty,j^2 / (2 w_j) ]
                      + C_chi(chi; chi_old, dt)

with ``R_j`` the internal virtual work of Eq. 19. Its first variation is Eqs. 4, 7 and 8 at once,
its second one the symmetric Newton matrix. The forms here act on the compound space
(chi, u, lam) of one control point; `ngspring.kkt.system` puts the blocks together.
"""

from __future__ import annotations

import ngsolve as ng
import numpy as np
from scipy.special import expit

from ngspring.basics.arrays import FloatArray
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.fem.process import tasks
from ngspring.fem.reduction import form_matrix
from ngspring.physics import energies
from ngspring.physics.void import ElementTable, VoidBlocks, VoidRegularisation, integration_rule


class ControlPointForm:
    """R(chi + eta, u; lam) of Eq. 19 without its boundary term, for any control point.

    Vectors are the dofs of the compound space (chi, u, lam), ``5 ndof`` numbers.
    """

    def __init__(self, scalar: ScalarSpace) -> None:
        grid = scalar.grid
        problem = grid.problem
        self.ndof = scalar.ndof
        displacement = ng.VectorH1(grid.mesh, order=2)
        self.space = ng.FESpace([scalar.space, displacement, displacement])
        self._eta = ng.Parameter(0.0)
        chi, u, lam = self.space.TrialFunction()
        work = energies.virtual_work(u, ng.Grad(u), lam, ng.Grad(lam), problem)
        density = energies.measure(grid) * energies.stiffness(chi + self._eta, problem) * work
        self.form = ng.BilinearForm(self.space, symmetric=True)
        rule = {ng.ET.QUAD: integration_rule()}
        self.form += ng.Variation(density.Compile() * ng.dx(intrules=rule))
        self.void = VoidRegularisation(scalar)
        self._state = ng.GridFunction(self.space)
        self._result = self._state.vec.CreateVector()

    def _load(self, vector: FloatArray, eta: float) -> FloatArray:
        self._eta.Set(eta)
        self._state.vec.FV().NumPy()[:] = vector
        return self.void.chi_at_points(vector[: self.ndof]) + eta

    def residual(self, vector: FloatArray, eta: float) -> FloatArray:
        """First derivative of R, on the dofs of the compound space."""
        at_points = self._load(vector, eta)
        with tasks():
            self.form.Apply(self._state.vec, self._result)
        n = self.ndof
        void = self.void.residual(at_points, vector[n : 3 * n], vector[3 * n :])
        return np.asarray(self._result.FV().NumPy() + np.concatenate(void))

    def tangent(self, vector: FloatArray, eta: float) -> tuple[FloatArray, VoidBlocks]:
        """Second derivative of R: values on the form's pattern, and the void's blocks."""
        at_points = self._load(vector, eta)
        with tasks():
            self.form.AssembleLinearization(self._state.vec)
        n = self.ndof
        blocks = self.void.blocks(at_points, vector[n : 3 * n], vector[3 * n :])
        return self.form.mat.AsVector().FV().NumPy(), blocks


class DesignForm:
    """C_chi of Eq. 11 on the H1 dofs of chi; the transient term is a matrix times 1/dt."""

    def __init__(self, scalar: ScalarSpace) -> None:
        grid: Grid = scalar.grid
        problem = grid.problem
        space = scalar.space
        chi = space.TrialFunction()
        measure = energies.measure(grid)
        rule = {ng.ET.QUAD: integration_rule()}
        terms = energies.design_energy(chi, ng.grad(chi), chi.Operator("hesse"), problem)
        self.terms: dict[str, ng.BilinearForm] = {}
        for name, density in terms.items():
            form = ng.BilinearForm(space, symmetric=True)
            form += ng.Variation((measure * density).Compile() * ng.dx(intrules=rule))
            self.terms[name] = form
        # Volume and interface change with chi; curvature and transient are quadratic.
        self.nonlinear = ng.BilinearForm(space, symmetric=True)
        density = measure * (terms["volume"] + terms["interface"])
        self.nonlinear += ng.Variation(density.Compile() * ng.dx(intrules=rule))
        zero = ng.CF(0.0)
        transient = energies.transient_energy(chi, ng.grad(chi), zero, ng.CF((0, 0)), problem)
        self.transient = ng.BilinearForm(space, symmetric=True)
        self.transient += ng.Variation((measure * transient).Compile() * ng.dx(intrules=rule))
        self._chi = ng.GridFunction(space)
        self._chi.vec[:] = 0.0
        self._result = self._chi.vec.CreateVector()
        for form in (self.transient, self.terms["curvature"]):
            with tasks():
                form.AssembleLinearization(self._chi.vec)
        self.transient_matrix = form_matrix(self.transient)
        self.curvature_matrix = form_matrix(self.terms["curvature"])
        self._table = ElementTable(scalar)

    def _load(self, chi: FloatArray) -> None:
        self._chi.vec.FV().NumPy()[:] = chi

    def gradient(self, chi: FloatArray, term: str) -> FloatArray:
        """First derivative of one term of C_chi, by its name in `energies.design_energy`."""
        if term == "curvature":
            return np.asarray(self.curvature_matrix @ chi)
        self._load(chi)
        with tasks():
            self.terms[term].Apply(self._chi.vec, self._result)
        return np.array(self._result.FV().NumPy())

    def tangent_nonlinear(self, chi: FloatArray) -> FloatArray:
        """Second derivative of the volume and interface terms, on the form's pattern."""
        self._load(chi)
        with tasks():
            self.nonlinear.AssembleLinearization(self._chi.vec)
        return np.asarray(self.nonlinear.mat.AsVector().FV().NumPy())

    def values(self, chi: FloatArray) -> dict[str, float]:
        """The terms of C_chi, and the volume V in mm^3 (Eq. 10 or 23) as "V"."""
        self._load(chi)
        values = {
            name: float(self.terms[name].Energy(self._chi.vec)) for name in ("volume", "interface")
        }
        values["curvature"] = float(chi @ (self.curvature_matrix @ chi)) / 2
        at_points = chi[self._table.dofs] @ self._table.value.T
        values["V"] = float((self._table.weights * expit(at_points)).sum())
        return values
