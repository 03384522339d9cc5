"""The physics as NGSolve expressions: Eqs. 2, 3, 10, 11, 14-17, 21-24.

Every function takes NGSolve coefficient functions (proxies, grid functions or formulas alike) and
returns one. Nothing here is differentiated by hand: residuals, tangents, adjoints and
sensitivities are variations of these expressions taken by NGSolve.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import ngsolve as ng

from ngspring.fem.grid import Grid
from ngspring.problem.spring import SpringProblem

#: A coefficient function of NGSolve, which has no type information of its own.
CF: TypeAlias = Any


def _decay(chi: CF) -> CF:
    """exp(-chi), which would overflow deep in the void; at chi = -200 the density is 1e-87."""
    return ng.exp(-ng.IfPos(chi + 200, chi, -200))


def rho(chi: CF) -> CF:
    """Material density, the sigmoid of the design field (Eq. 2)."""
    return 1 / (1 + _decay(chi))


def stiffness(chi: CF, problem: SpringProblem) -> CF:
    """RAMP interpolation E(chi) of the stiffness between E_0 (void) and 1 (solid), Eq. 3.

    With Eq. 2 inserted, ``rho / (1 + p (1 - rho)) = 1 / (1 + (1 + p) exp(-chi))``.
    """
    e_0, p = problem.E_0, problem.p
    return e_0 + (1 - e_0) / (1 + (1 + p) * _decay(chi))


def void_indicator(chi: CF) -> CF:
    """I(chi), Eq. 15: smooth step from 0 for chi > -5 to 1 for chi < -6."""
    t = ng.IfPos(-5 - chi, ng.IfPos(-6 - chi, 1, -5 - chi), 0)
    return t * t * t * (10 + t * (6 * t - 15))


def radius(problem: SpringProblem) -> CF:
    """r in mm on the mesh of the axisymmetric case, which lies left of the axis x = L/2."""
    return problem.L / 2 - ng.x


def measure(grid: Grid) -> CF:
    """What turns an integral over the mesh into one over the whole spring.

    ``T`` (plane strain) or ``2 pi r`` (axisymmetric, Eq. 24), times the number of mirrored copies.
    """
    problem = grid.problem
    per_area = 2 * ng.pi * radius(problem) if problem.motion.axis else ng.CF(problem.T)
    return grid.copies * per_area


def hoop_stretch(u: CF, problem: SpringProblem) -> CF:
    """F_33: 1 in plane strain (Eq. 13), 1 + u_r / r in the axisymmetric case (Eq. 21)."""
    return 1 - u[0] / radius(problem) if problem.motion.axis else ng.CF(1.0)


def strain_energy(u: CF, grad_u: CF, problem: SpringProblem) -> CF:
    """Neo-Hookean energy density of the solid, Eq. 14 without E(chi), in MPa."""
    f = ng.Id(2) + grad_u
    f_33 = hoop_stretch(u, problem)
    det = ng.Det(f) * f_33
    norm_squared = ng.InnerProduct(f, f) + f_33 * f_33
    log_det = ng.log(det)
    return problem.K / 2 * log_det * log_det + problem.G / 2 * (
        ng.exp(-2 / 3 * log_det) * norm_squared - 3
    )


def virtual_work(u: CF, grad_u: CF, v: CF, grad_v: CF, problem: SpringProblem) -> CF:
    """P(u) : delta F, Eqs. 16, 17 and 22: the derivative of `strain_energy` in direction v."""
    f = ng.Id(2) + grad_u
    f_33 = hoop_stretch(u, problem)
    det = ng.Det(f) * f_33
    norm_squared = ng.InnerProduct(f, f) + f_33 * f_33
    isochoric = problem.G * det ** (-2 / 3)
    pressure = problem.K * ng.log(det) - isochoric * norm_squared / 3
    stress = pressure * ng.Inv(f).trans + isochoric * f
    work = ng.InnerProduct(stress, grad_v)
    if problem.motion.axis:
        delta_f_33 = hoop_stretch(v, problem) - 1
        work = work + (pressure / f_33 + isochoric * f_33) * delta_f_33
    return work


def void_regularisation_scale(problem: SpringProblem) -> float:
    """k_r K H^2, the weight of the void regularisation in Eq. 14, in N."""
    return problem.k_r * problem.K * problem.H**2


def design_energy(chi: CF, grad_chi: CF, hesse_chi: CF, problem: SpringProblem) -> dict[str, CF]:
    """The terms of C_chi's integrand (Eq. 11) without the transient one, by name.

    Returns
    -------
    dict
        ``volume`` k_rho rho, ``interface`` k_i/n <|grad chi| - 8/l_i>^n, ``curvature``
        k_H/2 H chi : H chi.
    """
    n = problem.n
    limit = 8 / problem.l_i
    squared = ng.InnerProduct(grad_chi, grad_chi)
    # Guarded inside: the derivative of a square root at 0 is NaN even in a branch not taken.
    slope = ng.sqrt(ng.IfPos(squared - limit**2, squared, limit**2))
    return {
        "volume": problem.k_rho * rho(chi),
        "interface": problem.k_i / n * _power(slope - limit, n),
        "curvature": problem.k_H / 2 * ng.InnerProduct(hesse_chi, hesse_chi),
    }


def _power(base: CF, exponent: float) -> CF:
    """base^exponent for base >= 0; pow() of NGSolve has NaN derivatives at 0."""
    if exponent != int(exponent):
        return ng.IfPos(base - 1e-12, base, 1e-12) ** exponent
    result = base
    for _ in range(int(exponent) - 1):
        result = result * base
    return result


def transient_energy(
    chi: CF, grad_chi: CF, chi_old: CF, grad_chi_old: CF, problem: SpringProblem
) -> CF:
    """Last term of Eq. 11 after backward Euler, times dt: its variation is that of Eq. 12."""
    change, grad_change = chi - chi_old, grad_chi - grad_chi_old
    return 0.5 * (change * change + problem.l_t**2 * ng.InnerProduct(grad_change, grad_change))
