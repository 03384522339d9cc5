"""C* of Eq. 5, put together from the paper's formulas with NGSolve's symbolic second derivatives
and `ngsolve.Integrate`; it shares no expression with the package."""

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

#: K / G of nu = 0.45: more than this goes through a pressure field.
K_OVER_G = 29 / 3
#: Nominal stress, (3, 3), of a deformation gradient, (3, 3).
Stress: TypeAlias = Callable[[ng.CoefficientFunction, SpringProblem], ng.CoefficientFunction]


def eq_17(F: ng.CoefficientFunction, problem: SpringProblem) -> ng.CoefficientFunction:
    """The paper's law, with as much of K as is taken point by point."""
    G = problem.G
    K = min(problem.K, K_OVER_G * G)
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
        self.excess = self._excess()

    def _tensor(self, x: str, y: str) -> ng.CoefficientFunction:
        (a, b), (c, d) = ng.grad(self.f[x]), ng.grad(self.f[y])
        hoop = -self.f[x] / self.r if self.problem.motion.axis else ng.CF(0.0)
        return ng.CF((a, b, 0, c, d, 0, 0, 0, hoop), dims=(3, 3))

    def _work(self) -> ng.CoefficientFunction:
        problem, f = self.problem, self.f
        K = min(problem.K, K_OVER_G * problem.G)
        P = self.stress(ng.Id(3) + self._tensor("ux", "uy"), problem)
        chi = f["chi"] + self.eta
        rho = 1 / (1 + ng.exp(-chi))
        stiffness = problem.E_0 + (1 - problem.E_0) * rho / (1 + problem.p * (1 - rho))
        t = ng.IfPos(-5 - chi, ng.IfPos(-6 - chi, 1, -5 - chi), 0)
        void = problem.k_r * K * problem.H**2 * (6 * t**5 - 15 * t**4 + 10 * t**3)
        hesse = [f[name].Operator("hesse") for name in ("ux", "uy", "lx", "ly")]
        product = ng.InnerProduct(hesse[0], hesse[2]) + ng.InnerProduct(hesse[1], hesse[3])
        density = stiffness * ng.InnerProduct(P, self._tensor("lx", "ly")) + void * product
        return self.measure * density

    def _excess(self) -> dict[str, list[ng.CoefficientFunction]]:
        """Integrands of what a pressure field needs in each element."""
        problem, f = self.problem, self.f
        ratio = problem.K / (K_OVER_G * problem.G)
        chi = f["chi"] + self.eta
        e_0 = problem.E_0 / ratio
        stiffness = e_0 + (1 - e_0) / (1 + (1 + problem.p) * ratio * ng.exp(-chi))
        weight = self.measure * problem.K * (1 - 1 / ratio) * stiffness
        middle = ng.GridFunction(ng.VectorL2(self.mesh, order=0))
        middle.Set(ng.CF((ng.x, ng.y)))
        psi = (ng.CF(1.0), (ng.x - middle[0]) / problem.L, (ng.y - middle[1]) / problem.H)
        F = ng.Id(3) + self._tensor("ux", "uy")
        rate = ng.Trace(ng.Inv(F) * self._tensor("lx", "ly"))
        return {
            "M": [weight * a * b for a in psi for b in psi],
            "volume": [weight * a * ng.log(ng.Det(F)) for a in psi],
            "rate": [weight * a * rate for a in psi],
        }

    def _excess_work(self) -> float:
        """Of the part of K beyond that of nu = 0.45: its ln J is projected in each element."""
        if self.problem.K <= K_OVER_G * self.problem.G:
            return 0.0
        M, volume, rate = (
            np.array(
                [ng.Integrate(f, self.mesh, order=5, element_wise=True).NumPy() for f in integrands]
            ).T
            for integrands in self.excess.values()
        )
        theta = np.linalg.solve(M.reshape(-1, 3, 3), volume[:, :, None])[:, :, 0]
        return float((theta * rate).sum())

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
            total += self._integral(self.work) + self._excess_work()
        return total
