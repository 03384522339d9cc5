"""The tabulated void regularisation is the variation NGSolve takes of Eq. 14's second term."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
import scipy.sparse as sp

from ngspring.basics.arrays import FloatArray
from ngspring.design.splines import evaluate
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.fem.reduction import form_matrix
from ngspring.physics.chi import void_indicator, void_indicator_derivatives
from ngspring.physics.void import VoidRegularisation, dx
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem


class Symbolic:
    """I(chi) Hu : Hlam integrated by NGSolve, on the dofs of (chi, u_x, u_y, lam_x, lam_y)."""

    def __init__(self, scalar: ScalarSpace) -> None:
        grid = scalar.grid
        problem = grid.problem
        vector = ng.VectorH1(grid.mesh, order=2)
        space = ng.FESpace([scalar.space, vector, vector])
        chi, u, lam = space.TrialFunction()
        t = ng.IfPos(-5 - chi, ng.IfPos(-6 - chi, 1, -5 - chi), 0)
        step = 6 * t**5 - 15 * t**4 + 10 * t**3
        product = ng.InnerProduct(u.Operator("hesse"), lam.Operator("hesse"))
        measure = 2 * ng.pi * (problem.L / 2 - ng.x) if problem.motion.axis else problem.T
        scale = problem.k_r * problem.K * problem.H**2 * grid.sector.copies
        density = scale * measure * step * product
        self.form = ng.BilinearForm(space)
        self.form += ng.Variation(density * dx())
        self.state = ng.GridFunction(space)

    def residual(self, vector: FloatArray) -> FloatArray:
        self.state.vec.FV().NumPy()[:] = vector
        result = self.state.vec.CreateVector()
        self.form.Apply(self.state.vec, result)
        return np.array(result.FV().NumPy())

    def matrix(self, vector: FloatArray) -> sp.csr_matrix:
        self.state.vec.FV().NumPy()[:] = vector
        self.form.AssembleLinearization(self.state.vec)
        return form_matrix(self.form)


@pytest.fixture
def scalar(coarse: SpringProblem) -> ScalarSpace:
    return ScalarSpace(Grid(coarse.replace(elements=6)))


@pytest.fixture
def vector(scalar: ScalarSpace, random: np.random.Generator) -> FloatArray:
    """chi around the transition from -5 to -6, u and lam rough."""
    n = scalar.ndof
    vertex = scalar.is_vertex(np.arange(n))
    chi = random.uniform(-0.7, 0.7, n) - np.where(vertex, 5.5, 0.0)
    return np.concatenate([chi, random.uniform(-2, 2, 4 * n)])


def agree(value: FloatArray, expected: FloatArray) -> None:
    # NGSolve takes its second derivatives by differences, to about ten digits.
    assert np.abs(value - expected).max() <= 1e-9 * np.abs(expected).max()
    assert np.abs(expected).max() > 0


def test_chi_at_the_gauss_points_is_the_field(scalar: ScalarSpace, vector: FloatArray) -> None:
    void = VoidRegularisation(scalar)
    field = ng.GridFunction(scalar.space)
    field.vec.FV().NumPy()[:] = vector[: scalar.ndof]
    table = void.table
    expected = np.ravel(field(scalar.grid.mesh(table.x.ravel(), table.y.ravel())))
    value = void.chi_at_points(vector[: scalar.ndof]).ravel()
    np.testing.assert_allclose(value, expected, rtol=0, atol=1e-13)


def test_residual_is_the_first_variation(scalar: ScalarSpace, vector: FloatArray) -> None:
    n = scalar.ndof
    void = VoidRegularisation(scalar)
    chi, u, lam = vector[:n], vector[n : 3 * n], vector[3 * n :]
    parts = void.residual(void.chi_at_points(chi), u, lam)
    expected = Symbolic(scalar).residual(vector)
    for value, part in zip(parts, np.split(expected, [n, 3 * n]), strict=True):
        agree(value, part)
    agree(void.forces(void.chi_at_points(chi), u), expected[3 * n :])


def test_blocks_are_the_second_variation(scalar: ScalarSpace, vector: FloatArray) -> None:
    n = scalar.ndof
    void = VoidRegularisation(scalar)
    chi, u, lam = vector[:n], vector[n : 3 * n], vector[3 * n :]
    at_points = void.chi_at_points(chi)
    blocks = void.blocks(at_points, u, lam)
    expected = Symbolic(scalar).matrix(vector).toarray()

    def scattered(element: FloatArray) -> FloatArray:
        dofs = void.table.dofs
        full = np.zeros((n, n))
        np.add.at(full, (dofs[:, :, None], dofs[:, None, :]), element.reshape(-1, 9, 9))
        return full

    agree(scattered(blocks.chi_chi), expected[:n, :n])
    for c in range(2):
        u_c, lam_c = slice((1 + c) * n, (2 + c) * n), slice((3 + c) * n, (4 + c) * n)
        agree(scattered(blocks.chi_u[c]), expected[:n, u_c])
        agree(scattered(blocks.chi_lam[c]), expected[:n, lam_c])
        agree(scattered(blocks.stiffness), expected[u_c, lam_c])
        agree(scattered(void.stiffness(at_points)), expected[lam_c, u_c])
    # The components do not couple, and u and lam do not couple with themselves.
    assert np.abs(expected[n : 2 * n, 4 * n :]).max() == 0.0
    assert np.abs(expected[n : 3 * n, n : 3 * n]).max() == 0.0
    assert np.abs(expected[3 * n :, 3 * n :]).max() == 0.0


def test_second_derivatives_are_those_of_the_field(
    scalar: ScalarSpace, random: np.random.Generator
) -> None:
    problem = scalar.grid.problem
    coefficients = random.uniform(-1, 1, problem.coefficient_shape)
    void = VoidRegularisation(scalar)
    dofs = spline_extraction(scalar) @ coefficients.ravel()
    hesse = void.hesse_at_points(np.concatenate([dofs, 2 * dofs]))
    x, y = void.table.x, void.table.y
    for k, derivative in enumerate([(2, 0), (0, 2), (1, 1)]):
        expected = evaluate(problem, coefficients, x, y, derivative)
        expected = expected * (np.sqrt(2) if derivative == (1, 1) else 1.0)
        size = np.abs(expected).max()
        for component, factor in enumerate((1, 2)):
            error = hesse[component, :, k] - factor * expected
            assert np.abs(error).max() < 1e-12 * size


def test_displacements_linear_in_x_and_y_cost_nothing(scalar: ScalarSpace) -> None:
    void = VoidRegularisation(scalar)
    n = scalar.ndof
    vertex = scalar.is_vertex(np.arange(n))
    linear = np.where(vertex, scalar.node @ [0.3, -0.2], 0.0)
    forces = void.forces(np.full_like(void.table.x, -8.0), np.concatenate([linear, -linear]))
    assert np.abs(forces).max() < 1e-14


def test_smooth_step_is_eq_15(random: np.random.Generator) -> None:
    chi = np.concatenate([[-7, -6, -5.5, -5, 0, 1e3, -1e3], random.uniform(-6.2, -4.8, 50)])
    t = np.clip(-5 - chi, 0, 1)
    value = void_indicator(chi)
    np.testing.assert_allclose(value, 6 * t**5 - 15 * t**4 + 10 * t**3, atol=1e-15)
    mesh = Grid(SpringProblem((ControlPoint(10.0, 2.0),), elements=4)).mesh
    for c, expected in zip(chi, value, strict=True):
        assert void_indicator(ng.CF(c))(mesh(1, 1)) == pytest.approx(expected, abs=1e-14)


def test_derivatives_of_the_smooth_step(random: np.random.Generator) -> None:
    chi = random.uniform(-5.99, -5.01, 50)
    h = 1e-5
    first, second = void_indicator_derivatives(chi)
    above, below = void_indicator(chi + h), void_indicator(chi - h)
    slope_above, slope_below = (void_indicator_derivatives(chi + s)[0] for s in (h, -h))
    np.testing.assert_allclose(first, (above - below) / (2 * h), rtol=0, atol=1e-8)
    np.testing.assert_allclose(second, (slope_above - slope_below) / (2 * h), rtol=0, atol=1e-7)


def test_the_smooth_step_has_continuous_second_derivatives() -> None:
    for end in (-5.0, -6.0):
        for side in (-1e-9, 0.0, 1e-9):
            first, second = void_indicator_derivatives(np.array([end + side]))
            assert abs(first[0]) < 1e-15
            assert abs(second[0]) < 1e-6
