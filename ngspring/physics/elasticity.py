"""Strain energy and virtual work of a spring's solid: Eqs. 13, 14, 16, 17, 21, 22, 24.

The law (`ngspring.problem.laws`) knows a 3 x 3 deformation gradient, the kinematics
(`ngspring.problem.kinematics`) what displacements in the plane make of it; here they meet as
expressions of NGSolve.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property

import ngsolve as ng

from ngspring.physics.chi import CF
from ngspring.physics.powers import MeanPowers
from ngspring.problem.laws.base import Deformation, Law
from ngspring.problem.material import split_bulk_modulus
from ngspring.problem.spring import SpringProblem


class Gradient(Deformation):
    """A deformation gradient whose third axis is out of the plane, for `Law.energy`.

    Parameters
    ----------
    in_plane : ngsolve.CoefficientFunction (2, 2)
    F_33 : ngsolve.CoefficientFunction
    """

    def __init__(self, in_plane: CF, F_33: CF) -> None:
        self.in_plane = in_plane
        self.F_33 = F_33

    @cached_property
    def J(self) -> CF:
        """det F."""
        return ng.Det(self.in_plane) * self.F_33

    @cached_property
    def log_J(self) -> CF:
        """ln det F."""
        return ng.log(self.J)

    @cached_property
    def I_1(self) -> CF:
        """F : F."""
        return ng.InnerProduct(self.in_plane, self.in_plane) + self.F_33 * self.F_33

    @cached_property
    def I_2(self) -> CF:
        """Second invariant of F^T F."""
        det = ng.Det(self.in_plane)
        squares = ng.InnerProduct(self.in_plane, self.in_plane)
        return det * det + squares * self.F_33 * self.F_33

    def power_sum(self, alpha: float) -> CF:
        """Sum of the principal stretches of ``J^(-1/3) F``, each to the power of alpha.

        F_33 is one of them; the two others have the geometric mean ``j^(1/2)``, j being the
        determinant in the plane.
        """
        log_j, log_33 = self._logs
        both = 2 * ng.exp(alpha / 6 * (log_j - 2 * log_33)) * self._mean_powers.of(alpha)
        return both + ng.exp(-alpha / 3 * (log_j - 2 * log_33))

    @cached_property
    def _logs(self) -> tuple[CF, CF]:
        return ng.log(ng.Det(self.in_plane)), ng.log(self.F_33)

    @cached_property
    def _mean_powers(self) -> MeanPowers:
        """From how unlike the stretches in the plane are, ``(l_1 - l_2)^2 / (4 l_1 l_2)``."""
        f = self.in_plane
        a, b = f[0, 0] - f[1, 1], f[0, 1] + f[1, 0]
        return MeanPowers((a * a + b * b) / (4 * ng.Det(f)))

    @cached_property
    def matrix(self) -> CF:
        """F, (3, 3)."""
        f = self.in_plane
        rows = (f[0, 0], f[0, 1], 0, f[1, 0], f[1, 1], 0, 0, 0, self.F_33)
        return ng.CF(rows, dims=(3, 3))

    def exp(self, x: CF) -> CF:
        """Exponential function."""
        return ng.exp(x)

    def log(self, x: CF) -> CF:
        """Natural logarithm; not finite where x is not positive."""
        return ng.log(x)


def measure(problem: SpringProblem) -> CF:
    """What turns an integral over the mesh into one over the whole spring, in mm.

    ``T`` (plane strain) or ``2 pi r`` (axisymmetric, Eq. 24), times the number of mirrored copies.
    """
    return ng.CF(problem.measure(ng.x))


def F_33(u: CF, problem: SpringProblem) -> CF:
    """Stretch out of the plane: 1 in plane strain (Eq. 13), 1 + u_r / r axisymmetric (Eq. 21)."""
    return ng.CF(problem.motion.F_33(u[0], ng.x, problem.L))


def gradient(u: CF, grad_u: CF, problem: SpringProblem) -> Gradient:
    """Deformation gradient of a displacement field (Eq. 13 or Eq. 21)."""
    return Gradient(ng.Id(2) + grad_u, F_33(u, problem))


def pointwise_law(problem: SpringProblem) -> Law:
    """The law as it is integrated point by point.

    Where the solid is nearly incompressible without the excess of its bulk modulus, which a
    pressure field carries (`ngspring.problem.material.split_bulk_modulus`).
    """
    carried, excess = split_bulk_modulus(problem.K, problem.G)
    law = problem.law
    # Every law is a dataclass with its K.
    return dataclasses.replace(law, K=carried) if excess else law  # type: ignore[type-var]


def strain_energy(u: CF, grad_u: CF, problem: SpringProblem) -> CF:
    """Strain energy density of the solid, Eq. 14 without E(chi), in MPa, by `pointwise_law`."""
    return pointwise_law(problem).energy(gradient(u, grad_u, problem))


def virtual_work(u: CF, grad_u: CF, v: CF, grad_v: CF, problem: SpringProblem) -> CF:
    """P(u) : delta F, Eqs. 16, 17 and 22: the derivative of `strain_energy` in direction v.

    From the law's partial derivatives where it has them, otherwise taken by NGSolve.
    """
    F = gradient(u, grad_u, problem)
    partial = pointwise_law(problem).partial_derivatives(F)
    if partial is None:
        return automatic_virtual_work(u, grad_u, v, grad_v, problem)
    by_I_1, by_log_J = partial
    stress = by_log_J * ng.Inv(F.in_plane).trans + 2 * by_I_1 * F.in_plane
    work = ng.InnerProduct(stress, grad_v)
    delta_F_33 = problem.motion.delta_F_33(v[0], ng.x, problem.L)
    if delta_F_33 is not None:
        work = work + (by_log_J / F.F_33 + 2 * by_I_1 * F.F_33) * delta_F_33
    return work


def volume_rate(u: CF, grad_u: CF, v: CF, grad_v: CF, problem: SpringProblem) -> CF:
    """Derivative of ln J in direction v."""
    F = gradient(u, grad_u, problem)
    rate = ng.InnerProduct(ng.Inv(F.in_plane).trans, grad_v)
    delta_F_33 = problem.motion.delta_F_33(v[0], ng.x, problem.L)
    return rate if delta_F_33 is None else rate + delta_F_33 / F.F_33


def automatic_virtual_work(u: CF, grad_u: CF, v: CF, grad_v: CF, problem: SpringProblem) -> CF:
    """The same as NGSolve's derivative of the energy, for any law."""
    in_plane = (ng.Id(2) + grad_u).MakeVariable()
    out_of_plane = F_33(u, problem).MakeVariable()
    energy = pointwise_law(problem).energy(Gradient(in_plane, out_of_plane))
    work = ng.InnerProduct(energy.Diff(in_plane), grad_v)
    delta_F_33 = problem.motion.delta_F_33(v[0], ng.x, problem.L)
    if delta_F_33 is not None:
        work = work + energy.Diff(out_of_plane) * delta_F_33
    return work
