"""The design field is a doubly symmetric C1 quadratic spline, exactly (2.7)."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
from scipy.interpolate import BSpline

from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.design.splines import evaluate, greville_points
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem


def scipy_spline(
    problem: SpringProblem,
    coefficients: FloatArray,
    x: FloatArray,
    y: FloatArray,
    derivative: tuple[int, int] = (0, 0),
) -> FloatArray:
    """The same field from SciPy, with all (N + 2)^2 coefficients written out."""
    n = problem.elements
    in_x = np.concatenate([coefficients, coefficients[::-1]])
    half = np.concatenate([in_x[:, :1], in_x], axis=1)
    every = np.concatenate([half, half[:, ::-1]], axis=1)
    assert every.shape == (n + 2, n + 2)
    factors = []
    for t, h, order in ((x, problem.L / n, derivative[0]), (y, problem.H / n, derivative[1])):
        knots = h * np.arange(-2, n + 3)
        basis = BSpline(knots, np.eye(n + 2), 2)
        factors.append((basis.derivative(order) if order else basis)(t))
    return np.einsum("pk,kl,pl->p", factors[0], every, factors[1])


@pytest.fixture
def coefficients(coarse: SpringProblem, random: np.random.Generator) -> FloatArray:
    return random.uniform(-5, 5, coarse.coefficient_shape)


@pytest.fixture
def field(coarse: SpringProblem, coefficients: FloatArray) -> ng.GridFunction:
    scalar = ScalarSpace(Grid(coarse))
    chi = ng.GridFunction(scalar.space)
    chi.vec.FV().NumPy()[:] = spline_extraction(scalar) @ coefficients.ravel()
    return chi


def points_inside(
    problem: SpringProblem, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    width, height = Grid(problem).size
    return random.uniform(0, width, 200), random.uniform(0, height, 200)


def test_the_finite_element_field_is_the_spline(
    coarse: SpringProblem,
    coefficients: FloatArray,
    field: ng.GridFunction,
    random: np.random.Generator,
) -> None:
    x, y = points_inside(coarse, random)
    points = field.space.mesh(x, y)
    expected = scipy_spline(coarse, coefficients, x, y)
    np.testing.assert_allclose(np.ravel(field(points)), expected, rtol=0, atol=1e-12)
    gradient = np.asarray(ng.grad(field)(points))
    for axis, derivative in enumerate([(1, 0), (0, 1)]):
        expected = scipy_spline(coarse, coefficients, x, y, derivative)
        np.testing.assert_allclose(gradient[:, axis], expected, rtol=0, atol=1e-12)
    hesse = np.asarray(field.Operator("hesse")(points)).reshape(-1, 2, 2)
    for (i, j), derivative in (((0, 0), (2, 0)), ((1, 1), (0, 2)), ((0, 1), (1, 1))):
        expected = scipy_spline(coarse, coefficients, x, y, derivative)
        # NGSolve takes its second derivatives by differences.
        np.testing.assert_allclose(hesse[:, i, j], expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("derivative", [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2)])
def test_evaluation_anywhere_in_the_full_domain_is_the_spline(
    derivative: tuple[int, int], random: np.random.Generator
) -> None:
    problem = SpringProblem((ControlPoint(9.0, 1.5),), elements=10, L=90.0, H=110.0)
    coefficients = random.uniform(-5, 5, problem.coefficient_shape)
    x = np.append(random.uniform(0, problem.L, 200), [0, problem.L, 0, problem.L, 45])
    y = np.append(random.uniform(0, problem.H, 200), [0, 0, problem.H, problem.H, 55])
    value = evaluate(problem, coefficients, x, y, derivative)
    expected = scipy_spline(problem, coefficients, x, y, derivative)
    # A second derivative is not defined on a mesh line; SciPy takes the other side there.
    inside = slice(None) if 2 not in derivative else slice(200)
    np.testing.assert_allclose(value[inside], expected[inside], rtol=0, atol=1e-12)


def test_gradients_have_no_jump_between_elements(field: ng.GridFunction) -> None:
    sides = [(s, e) for e in (0.0, 1.0) for s in (0.2, 0.7)]
    reference = sides + [(e, s) for s, e in sides]
    rule = ng.IntegrationRule(points=reference, weights=[1.0] * len(reference))
    mesh = field.space.mesh
    mapped = mesh.MapToAllElements({ng.ET.QUAD: rule}, ng.VOL)
    where = np.round(np.asarray(ng.CF((ng.x, ng.y))(mapped)), 9)
    gradient = np.asarray(ng.grad(field)(mapped))
    _, group, count = np.unique(where, axis=0, return_inverse=True, return_counts=True)
    assert (count == 2).sum() > 20
    order = np.argsort(group.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    shared = first[count == 2]
    jump = gradient[order[shared]] - gradient[order[shared + 1]]
    assert np.abs(jump).max() < 1e-12
    assert np.abs(gradient).max() > 0.1


def test_chi_has_no_normal_derivative_at_bottom_and_top(random: np.random.Generator) -> None:
    problem = SpringProblem((ControlPoint(9.0, 1.5),), elements=10)
    design = Design(problem, random.uniform(-5, 5, problem.coefficient_shape))
    x = random.uniform(0, problem.L, 50)
    for y in (0.0, problem.H):
        assert np.abs(design.chi(x, y, derivative=(0, 1))).max() < 1e-13
    # Nothing is imposed on the sides.
    for x_side in (0.0, problem.L):
        assert np.abs(design.chi(x_side, x, derivative=(1, 0))).max() > 0.01


def test_the_finite_element_field_has_no_normal_derivative_at_the_bottom(
    coarse: SpringProblem, field: ng.GridFunction
) -> None:
    x = np.linspace(0, Grid(coarse).size[0], 33)
    slope = np.asarray(ng.grad(field)(field.space.mesh(x, np.zeros_like(x))))
    assert np.abs(slope[:, 1]).max() < 1e-13


def test_chi_is_mirror_symmetric_about_both_axes(random: np.random.Generator) -> None:
    problem = SpringProblem((ControlPoint(9.0, 1.5),), elements=12, L=90.0, H=110.0)
    design = Design(problem, random.uniform(-5, 5, problem.coefficient_shape))
    x, y = random.uniform(0, problem.L, 100), random.uniform(0, problem.H, 100)
    chi = design.chi(x, y)
    for mirrored in (
        design.chi(problem.L - x, y),
        design.chi(x, problem.H - y),
        design.chi(problem.L - x, problem.H - y),
    ):
        np.testing.assert_allclose(mirrored, chi, rtol=0, atol=1e-12)


def test_greville_points_are_the_cell_centres_and_one_ghost_column() -> None:
    problem = SpringProblem((ControlPoint(9.0, 1.5),), elements=8, L=80.0, H=160.0)
    x, y = greville_points(problem)
    assert x.shape == y.shape == problem.coefficient_shape == (5, 4)
    np.testing.assert_allclose(x[:, 0], [-5, 5, 15, 25, 35])
    np.testing.assert_allclose(y[0], [10, 30, 50, 70])


def test_splines_through_greville_points_reproduce_linear_functions() -> None:
    problem = SpringProblem((ControlPoint(9.0, 1.5),), elements=12, L=90.0, H=110.0)
    design = Design.from_function(problem, lambda x, y: 2 + 0.3 * x - 0.7 * y)
    x = np.linspace(0, problem.L / 2 - problem.h_x, 23)[:, None]
    y = np.linspace(problem.h_y, problem.H / 2 - problem.h_y, 19)
    np.testing.assert_allclose(design.chi(x, y), 2 + 0.3 * x - 0.7 * y, rtol=0, atol=1e-12)


def test_a_constant_stays_constant(coarse: SpringProblem) -> None:
    scalar = ScalarSpace(Grid(coarse))
    dofs = spline_extraction(scalar) @ np.full(np.prod(coarse.coefficient_shape), 3.0)
    vertex = scalar.is_vertex(np.arange(scalar.ndof))
    np.testing.assert_allclose(dofs[vertex], 3.0, rtol=1e-15)
    assert np.abs(dofs[~vertex]).max() < 1e-14


def test_the_design_has_the_same_unknowns_on_every_domain(
    coarse: SpringProblem, coefficients: FloatArray, field: ng.GridFunction
) -> None:
    other = "full" if coarse.domain == "quarter" else "quarter"
    scalar = ScalarSpace(Grid(coarse.replace(domain=other)))
    chi = ng.GridFunction(scalar.space)
    chi.vec.FV().NumPy()[:] = spline_extraction(scalar) @ coefficients.ravel()
    x, y = np.linspace(1, 44, 9), np.linspace(1, 54, 9)
    here = np.ravel(field(field.space.mesh(x, y)))
    there = np.ravel(chi(scalar.space.mesh(x, y)))
    np.testing.assert_allclose(here, there, rtol=0, atol=1e-12)
