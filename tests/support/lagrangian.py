"""C* put together from the paper's formulas, for derivatives to be compared with.

With NGSolve's symbolic second derivatives and `ngsolve.Integrate`; it shares no expression with the
package.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import ngsolve as ng
import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.fem.constraints import displacement_extraction, spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.kkt.state import State
from ngspring.problem.spring import SpringProblem

#: Nominal stress, (3, 3), of a deformation gradient, (3, 3).
Stress: TypeAlias = Callable[[ng.CoefficientFunction, SpringProblem], ng.CoefficientFunction]


def eq_17(F: ng.CoefficientFunction, problem: SpringProblem) -> ng.CoefficientFunction:
    """The paper's law."""
    K, G = problem.K, problem.G
    J = ng.Det(F)
    B = F * F.trans
    dev = B - ng.Trace(B) / 3 * ng.Id(3)
    return K * ng.log(J) * ng.Inv(F).trans + G * J ** (-2 / 3) * dev * ng.Inv(F).trans


class Lagrangian:
    """C* (Eqs. 5, 9, 11 and 19 or 24) as a plain function of a `State`."""

    def __init__(
        self, problem: SpringProblem, chi_old: FloatArray, dt: float, stress: Stress = eq_17
    ) -> None:
        self.problem, self.dt, self.stress = problem, dt, stress
        grid = Grid(problem)
        scalar = ScalarSpace(grid)
        self.mesh = grid.mesh
        self.of_chi = spline_extraction(scalar)
        self.of_u = displacement_extraction(scalar).matrix
        names = ("chi", "old", "ux", "uy", "lx", "ly")
        self.f = {name: ng.GridFunction(scalar.space) for name in names}
        self.f["old"].vec.FV().NumPy()[:] = self.of_chi @ chi_old
        self.eta = ng.Parameter(0.0)
        if problem.motion.axis:
            self.r = problem.L / 2 - ng.x
            self.measure = grid.sector.copies * 2 * ng.pi * self.r
        else:
            self.measure = ng.CF(grid.sector.copies * problem.T)
        self.work, self.design = self._work(), self._design()

    def _tensor(self, x: str, y: str) -> ng.CoefficientFunction:
        (a, b), (c, d) = ng.grad(self.f[x]), ng.grad(self.f[y])
        hoop = -self.f[x] / self.r if self.problem.motion.axis else ng.CF(0.0)
        return ng.CF((a, b, 0, c, d, 0, 0, 0, hoop), dims=(3, 3))

    def _work(self) -> ng.CoefficientFunction:
        problem, f = self.problem, self.f
        P = self.stress(ng.Id(3) + self._tensor("ux", "uy"), problem)
        chi = f["chi"] + self.eta
        rho = 1 / (1 + ng.exp(-chi))
        stiffness = problem.E_0 + (1 - problem.E_0) * rho / (1 + problem.p * (1 - rho))
        t = ng.IfPos(-5 - chi, ng.IfPos(-6 - chi, 1, -5 - chi), 0)
        void = problem.k_r * problem.K * problem.H**2 * (6 * t**5 - 15 * t**4 + 10 * t**3)
        hesse = [f[name].Operator("hesse") for name in ("ux", "uy", "lx", "ly")]
        product = ng.InnerProduct(hesse[0], hesse[2]) + ng.InnerProduct(hesse[1], hesse[3])
        density = stiffness * ng.InnerProduct(P, self._tensor("lx", "ly")) + void * product
        return self.measure * density

    def _design(self) -> ng.CoefficientFunction:
        problem, chi, old = self.problem, self.f["chi"], self.f["old"]
        slope = ng.Norm(ng.grad(chi)) - 8 / problem.l_i
        hesse = chi.Operator("hesse")
        change, grad_change = chi - old, ng.grad(chi) - ng.grad(old)
        return self.measure * (
            problem.k_rho / (1 + ng.exp(-chi))
            + problem.k_i / problem.n * ng.IfPos(slope, slope, 0) ** problem.n
            + problem.k_H / 2 * ng.InnerProduct(hesse, hesse)
            + (change**2 + problem.l_t**2 * grad_change * grad_change) / (2 * self.dt)
        )

    def _set(self, names: tuple[str, ...], dofs: FloatArray) -> None:
        for name, part in zip(names, np.split(dofs, len(names)), strict=True):
            self.f[name].vec.FV().NumPy()[:] = part

    def _integral(self, density: ng.CoefficientFunction) -> float:
        return float(ng.Integrate(density, self.mesh, order=5))

    def __call__(self, state: State) -> float:
        self._set(("chi",), self.of_chi @ state.chi)
        total = self._integral(self.design)
        for point, u, lam in zip(self.problem.control_points, state.u, state.lam, strict=True):
            self.eta.Set(point.eta)
            self._set(("ux", "uy"), self.of_u @ np.append(u, point.d))
            self._set(("lx", "ly"), self.of_u @ lam)
            # Stationary in q: w (q - q_*) = lam_Ty; u_Ty = d, so mu has nothing to act on.
            q = point.q + lam[-1] / point.weight
            total += point.weight / 2 * (q - point.q) ** 2 - q * lam[-1]
            total += self._integral(self.work)
        return total
