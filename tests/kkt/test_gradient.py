"""The left-hand side of Eq. 8, with u, q and lam solved for, is the gradient of C (Eq. 1)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ngspring import cases, load_displacement
from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.kkt.start import initial_state
from ngspring.kkt.system import CoupledSystem
from ngspring.physics.lagrangian import DesignForm
from ngspring.problem.spring import SpringProblem


class Objective:
    """C(chi) of Eqs. 1, 9 and 11 by the forward solver; dimensionless coefficients in and out."""

    def __init__(self, problem: SpringProblem) -> None:
        self.problem = problem
        scalar = ScalarSpace(Grid(problem))
        self.extraction = spline_extraction(scalar)
        self.design_form = DesignForm(scalar)

    def forces(self, chi: FloatArray) -> FloatArray:
        design = Design(self.problem, chi.reshape(self.problem.coefficient_shape))
        q = []
        for point in self.problem.control_points:
            response = load_displacement(design, [point.d], eta=point.eta, threads=1)
            assert response.complete
            q.append(response.q[0])
        return np.array(q)

    def __call__(self, chi: FloatArray) -> float:
        terms = self.design_form.values(self.extraction @ chi)
        c_chi = terms["volume"] + terms["interface"] + terms["curvature"]
        points = self.problem.control_points
        deviation = self.forces(chi) - [point.q for point in points]
        return c_chi + float(np.array([p.weight for p in points]) / 2 @ deviation**2)


def gradient(problem: SpringProblem, chi: FloatArray) -> FloatArray:
    system = CoupledSystem(problem)
    state = initial_state(system, Design(problem, chi.reshape(problem.coefficient_shape)))
    return system.residual(state, state.chi, np.inf).chi


def derivative(f: Callable[[FloatArray], float], x: FloatArray, d: FloatArray, h: float) -> float:
    """Central difference of fourth order."""
    return (8 * (f(x + h * d) - f(x - h * d)) - (f(x + 2 * h * d) - f(x - 2 * h * d))) / (12 * h)


def test_reduced_gradient_is_the_derivative_of_the_objective(rough: Design) -> None:
    chi = rough.coefficients.ravel()
    d = np.random.default_rng(1).uniform(-1, 1, chi.shape)
    slope = gradient(rough.problem, chi) @ d
    difference = derivative(Objective(rough.problem), chi, d, 2e-3)
    assert difference == pytest.approx(slope, rel=1e-6)


def test_reduced_gradient_of_each_control_point_alone(rough: Design) -> None:
    chi = rough.coefficients.ravel()
    d = np.random.default_rng(2).uniform(-1, 1, chi.shape)
    for point in rough.problem.control_points:
        problem = rough.problem.replace(control_points=(point,), k_rho=0.0, k_i=0.0, k_H=0.0)
        slope = gradient(problem, chi) @ d
        assert slope != 0.0
        difference = derivative(Objective(problem), chi, d, 2e-3)
        assert difference == pytest.approx(slope, rel=1e-6), point


def test_reduced_gradient_with_the_weights_of_table_1(kinematics: str) -> None:
    case = cases["C7" if kinematics == "plane strain" else "A4"]
    problem = case.replace(elements=8, l_i=10.0)
    chi = Design.column(problem).coefficients.ravel()
    d = np.random.default_rng(3).uniform(-1, 1, chi.shape)
    slope = gradient(problem, chi) @ d
    assert derivative(Objective(problem), chi, d, 2e-3) == pytest.approx(slope, rel=1e-6)


def test_weights_scale_the_gradient(rough: Design) -> None:
    chi = rough.coefficients.ravel()
    point = rough.problem.control_points[0]
    bare = rough.problem.replace(control_points=(point,), k_rho=0.0, k_i=0.0, k_H=0.0)
    heavy = type(point)(point.d, point.q, 10 * point.weight, point.eta)
    one, ten = (gradient(bare.replace(control_points=(p,)), chi) for p in (point, heavy))
    np.testing.assert_allclose(ten, 10 * one, rtol=1e-8, atol=1e-12 * np.abs(ten).max())


def test_more_material_makes_a_stiffer_spring(rough: Design) -> None:
    # Where no term but the force counts, the gradient points the way q goes.
    problem = rough.problem
    chi = rough.coefficients.ravel()
    objective = Objective(problem)
    assert (np.abs(objective.forces(chi + 0.1)) > np.abs(objective.forces(chi))).all()
