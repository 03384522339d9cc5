"""The pressure field of a nearly incompressible solid on second-order triangles.

What K has more than displacements carry point by point (`ngspring.problem.material`) acts on the
change of volume averaged around each vertex. With phi the linear function of a vertex and w the
excess modulus times the thickness::

    theta_v = g_v / m_v,   g_v = integral of w phi_v ln J,   m_v = integral of w phi_v
    W(u) = sum over v of g_v^2 / (2 m_v)

This is the pair of Taylor and Hood (quadratic displacements, linear continuous pressure), which
does not lock, with a lumped mass of the pressure: it can be eliminated vertex by vertex, W is a
function of u alone that is minimised as before, and the linear systems stay definite. Lumping
changes the compression that a pressure causes, not the constraint: nothing in the incompressible
limit. A pressure that jumps between triangles would be eliminated with fewer couplings, but next to
quadratic displacements it is either constant in each, and of first order only, or it locks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import ngsolve as ng
import numpy as np
import scipy.sparse as sp

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.fem.process import tasks
from ngspring.fem.reduction import Pattern, form_matrix, product_pattern
from ngspring.physics.chi import CF
from ngspring.physics.elasticity import gradient, measure, volume_rate
from ngspring.problem.material import split_bulk_modulus
from ngspring.problem.spring import SpringProblem


@dataclass(frozen=True, eq=False)
class Excess:
    """The part of a bulk modulus that a pressure field carries.

    Attributes
    ----------
    modulus : ngsolve.CoefficientFunction
        Per area of the mesh: thickness or 2 pi r and the number of copies included.
    problem : SpringProblem
        Its kinematics give ln J.
    """

    modulus: CF
    problem: SpringProblem


def excess_of(problem: SpringProblem) -> Excess | None:
    """The excess modulus of a spring's solid; None if displacements carry all of K."""
    excess = split_bulk_modulus(problem.K, problem.G)[1]
    return Excess(measure(problem) * excess, problem) if excess else None


class NodalPressure:
    """W(u) of the module, with its derivatives.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    excess : Excess
    matrix : sparse (2 ndof, free + 1)
        Linear constraints, as of `ngspring.solid.contact.elasticity.Solid`.
    rules : dict
        Points where the energy is integrated.
    """

    def __init__(self, mesh: Any, excess: Excess, matrix: sp.csr_matrix, rules: Any) -> None:
        self.excess = excess
        self._matrix = matrix
        linear = ng.H1(mesh, order=1)
        space = ng.FESpace([ng.VectorH1(mesh, order=2), linear])
        u, theta = space.TrialFunction()
        log_J = gradient(u, ng.Grad(u), excess.problem).log_J
        density = (excess.modulus * theta * log_J).Compile()
        self._form = ng.BilinearForm(space, symmetric=True)
        self._form += ng.Variation(density * ng.dx(intrules=rules))
        mass = ng.LinearForm(linear)
        mass += excess.modulus * linear.TestFunction() * ng.dx(intrules=rules)
        with tasks():
            mass.Assemble()
        self._mass: FloatArray = np.array(mass.vec.FV().NumPy())
        self._state = ng.GridFunction(space)
        self._result = self._state.vec.CreateVector()
        self._count = int(matrix.shape[0])

    @property
    def theta(self) -> ng.GridFunction:
        """The averaged ln J of the last displacements."""
        return self._state.components[1]

    def _derivative(self) -> FloatArray:
        with tasks():
            self._form.Apply(self._state.vec, self._result)
        return np.array(self._result.FV().NumPy())

    def set(self, full: FloatArray) -> FloatArray:
        """Load displacement dofs; returns theta at the vertices."""
        state = self._state.vec.FV().NumPy()
        state[: self._count] = full
        state[self._count :] = 0.0
        theta = self._derivative()[self._count :] / self._mass
        state[self._count :] = theta
        return np.asarray(theta)

    def energy(self, full: FloatArray) -> float:
        """W in N mm."""
        theta = self.set(full)
        return float(self._mass @ theta**2) / 2

    def forces(self, full: FloatArray) -> FloatArray:
        """Derivative of W by the dofs, in N."""
        self.set(full)
        return self._derivative()[: self._count]

    @cached_property
    def pattern(self) -> Pattern:
        """Places of the second derivative by the unknowns and d: neighbours of one vertex."""
        with tasks():
            self._form.AssembleLinearization(self._state.vec)
        derivative = form_matrix(self._form)
        derivative.data[:] = 1.0
        of_volume = sp.csr_matrix(derivative[self._count :, : self._count] @ abs(self._matrix))
        vertices: IntArray = np.arange(of_volume.shape[0])
        return product_pattern(vertices, vertices, of_volume, of_volume)

    def tangent(self, full: FloatArray) -> sp.csr_matrix:
        """Second derivative by the unknowns and d."""
        self.set(full)
        with tasks():
            self._form.AssembleLinearization(self._state.vec)
        derivative = form_matrix(self._form)
        of_volume = derivative[self._count :, : self._count] @ self._matrix
        bending = derivative[: self._count, : self._count]
        stretching = of_volume.T @ sp.diags_array(1 / self._mass) @ of_volume
        return sp.csr_matrix(self._matrix.T @ bending @ self._matrix + stretching)

    def virtual_work(self, u: CF, grad_u: CF, v: CF, grad_v: CF) -> CF:
        """Its share of P : delta F per area of the mesh, at the last displacements."""
        rate = volume_rate(u, grad_u, v, grad_v, self.excess.problem)
        return self.excess.modulus * self.theta * rate
