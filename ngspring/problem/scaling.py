"""Similar problems: other units, sizes and stiffnesses with the same design.

With lengths times ``a``, thickness times ``b`` and stresses times ``s``, forces are multiplied by
``f = s a b`` and volumes by ``v = a^2 b`` (axisymmetric springs have no thickness: b = a). Every
term of C* (Eqs. 5, 9, 11) keeps its value, and chi stays the same, if

=============  ======================================================================
L, H, l_i, l_t, d   times ``a``; so wall and gap
K, G                times ``s``
q_*                 times ``f``
w_q                 divided by ``f^2``
k_rho               divided by ``v``; so k_s and k_w
k_i                 times ``a^n / v``: a slope of chi is an inverse length
k_H                 times ``a^4 / v``
dt                  times ``v`` (see `time_unit`)
=============  ======================================================================

and E_0, k_r, p, n and eta, which have no dimension, stay as they are. From mm and MPa to m and Pa
is ``a = b = 1e-3``, ``s = 1e6``: forces stay in N.
"""

from __future__ import annotations

import dataclasses
import statistics

import numpy as np

from ngspring.basics.checks import finite_number, shown
from ngspring.basics.errors import ProblemError
from ngspring.problem.dimension import dimensions, weights
from ngspring.problem.material import young_and_poisson
from ngspring.problem.spring import SpringProblem

#: Force over relative displacement q / (d / H) in N at which the paper's weights are w_q = 1 N^-2.
REFERENCE_STIFFNESS = 20.0


def length_unit(problem: SpringProblem) -> float:
    """A hundredth of the domain's size, 1 mm for the paper's: what "small" is measured with."""
    return float(np.sqrt(problem.L * problem.H)) / 100


def force_unit(problem: SpringProblem) -> float:
    """Young's modulus times a hundredth of the top's area: 1 N for the paper's plane springs."""
    return young_and_poisson(problem.K, problem.G)[0] * problem.top_area / 100


def adjoint_unit(problem: SpringProblem) -> float:
    """The adjoint displacements lam in N^-1 that are 1 mm, in these units: 1 N^-1 for the paper's.

    In this unit lam and u are of one size, and so are the second derivatives of the Lagrangian.
    """
    return 1 / (force_unit(problem) * length_unit(problem))


def scaled(
    problem: SpringProblem,
    *,
    length: float = 1.0,
    stress: float = 1.0,
    thickness: float | None = None,
) -> SpringProblem:
    """The similar problem: same design field chi, other size, stiffness or units.

    Parameters
    ----------
    problem : SpringProblem
    length : float
        Factor of all lengths in the plane.
    stress : float
        Factor of the elastic moduli.
    thickness : float, optional
        Factor of the out-of-plane thickness T; as ``length`` by default. Axisymmetric springs have
        none.

    Returns
    -------
    SpringProblem
        With targets, weights and length scales changed so that the objective keeps its value.

    Raises
    ------
    ProblemError
        If a factor is not a positive number.
    """
    a = _factor("length", length)
    s = _factor("stress", stress)
    b = a if thickness is None else _factor("thickness", thickness)
    third = b if problem.motion.thick else a
    force, volume = s * a * third, a * a * third
    points = tuple(
        dataclasses.replace(
            p,
            d=p.d * a,
            q=p.q * force,
            weight=p.weight / force**2,
            aim=None if p.aim is None else p.aim * force,
        )
        for p in problem.control_points
    )
    factors = {
        name: dimension.factor(a, volume, s, problem.n)
        for name, dimension in dimensions(problem).items()
    }
    law = None if problem.material is None else problem.material.scaled(s)
    return dataclasses.replace(
        problem,
        control_points=points,
        T=problem.T * b,
        material=law,
        **{name: getattr(problem, name) * factor for name, factor in factors.items()},
    )


def _factor(name: str, value: float) -> float:
    factor = finite_number(name, value)
    if not 1e-15 <= factor <= 1e15:
        raise ProblemError(
            f"{name} = {shown(value)} is not valid: a factor must be positive, from 1e-15 to 1e15"
        )
    return factor


def target_stiffness(problem: SpringProblem) -> float:
    """Median of ``|q_*| H / |d|`` over the control points of the design itself (eta = 0), in N.

    If there is none with eta = 0, or if all ask for no force, the others count, or 1.
    """
    points = [p for p in problem.control_points if p.own] or problem.control_points
    secants = [abs(p.q) * problem.H / abs(p.d) for p in points if p.q != 0.0]
    return statistics.median(secants) if secants else 1.0


def with_similar_weights(problem: SpringProblem) -> SpringProblem:
    """The problem with the weights and length scales of the paper's springs, scaled to its size.

    - ``w_q`` so that the targets weigh as much as the paper's, ``(20 N / target_stiffness)^2``,
      against the terms that grow with the volume: times the volume of the paper's domain in these
      kinematics over the plane one's. Weights keep their proportions: the largest becomes this.
    - ``k_rho``, ``k_i``, ``k_H``, ``l_t`` by the rules of `scaled`, with the ratio of the domain's
      size ``sqrt(L H)`` and volume to the paper's.
    - ``l_i`` four fifths of an element, as in the paper (section 3.5).

    For the paper's plane springs these are the values of Table 1 (w_q of those that stiffen or
    soften strongly is up to a third larger or smaller). A1 to A4 have a w_q 79 times smaller, and
    miss their targets by up to 0.07 % where plane springs miss theirs by 0.001 %.
    """
    paper = SpringProblem
    a = float(np.sqrt(problem.L * problem.H)) / paper.L
    reference = problem.motion.top_area(paper.L, paper.T)
    v = float(problem.top_area * problem.H / (reference * paper.H))
    bulk = problem.motion.volume(paper.L, paper.H, paper.T) / (paper.L * paper.H * paper.T)
    w_q = bulk * (REFERENCE_STIFFNESS / target_stiffness(problem)) ** 2
    largest = max(point.weight for point in problem.control_points)
    points = tuple(
        dataclasses.replace(point, weight=point.weight * (w_q / largest))
        for point in problem.control_points
    )
    units = dimensions(problem)
    scaled_weights = {
        name: getattr(paper, name) * units[name].factor(a, v, 1.0, paper.n)
        for name in weights(problem)
    }
    return dataclasses.replace(
        problem,
        control_points=points,
        l_i=0.8 * max(problem.h_x, problem.h_y),
        l_t=paper.l_t * a,
        n=paper.n,
        **scaled_weights,
    )


def time_unit(problem: SpringProblem) -> float:
    """Size of the domain's volume relative to the paper's 10^4 mm^3; pseudo-time scales with it."""
    return problem.motion.volume(problem.L, problem.H, problem.T) / 1e4


def on_mesh(problem: SpringProblem, elements: int) -> tuple[SpringProblem, str]:
    """The problem on another mesh, and a line about what else had to change (or nothing).

    A coarser mesh needs a wider interface to resolve it: l_i grows by the same factor.

    Raises
    ------
    ProblemError
        If there cannot be such a mesh.
    """
    changed = problem.replace(elements=elements)
    if elements >= problem.elements:
        return changed, ""
    factor = problem.elements / elements
    changed = changed.replace(l_i=problem.l_i * factor)
    note = (
        f"{elements} instead of {problem.elements} elements: l_i = {changed.l_i:g} mm instead of"
        f" {problem.l_i:g} mm, so that the mesh resolves the interface"
    )
    if any(point.eta for point in problem.control_points):
        note += f" (dilation and erosion grow by {factor:g}, too)"
    return changed, note
