"""The pressure field of a nearly incompressible third medium: exact, and without locking."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest
import scipy.sparse as sp

from ngspring.analysis.mechanics import Mechanics
from ngspring.basics.arrays import FloatArray
from ngspring.fem.constraints import displacement_extraction, stretched
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.fem.reduction import form_matrix
from ngspring.physics.chi import (
    excess_stiffness,
    excess_stiffness_derivatives,
    stiffness,
)
from ngspring.physics.pressure import PressureField
from ngspring.physics.void import ElementTable, dx
from ngspring.problem import material
from ngspring.problem.laws.base import principal_stresses
from ngspring.problem.material import bulk_and_shear_modulus, split_bulk_modulus
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.problem.targets.full_block import block_force


def with_nu(problem: SpringProblem, nu: float) -> SpringProblem:
    K, G = bulk_and_shear_modulus(1.0, nu)
    return problem.replace(K=K, G=G)


def solid_block(nu: float, kinematics: str = "plane strain") -> Mechanics:
    problem = SpringProblem((ControlPoint(-10.0, -5.0),), elements=8, kinematics=kinematics, T=2.0)
    return Mechanics(ScalarSpace(Grid(with_nu(problem, nu))), ng.CF(200.0))


# -- derivatives ---------------------------------------------------------------------------------


class Symbolic:
    """R with theta and tau as unknowns of their own, by NGSolve: three constants per element each.

    On the dofs of (chi, u_x, u_y, lam_x, lam_y, theta_1 ... theta_3, tau_1 ... tau_3).
    """

    def __init__(self, scalar: ScalarSpace) -> None:
        problem, mesh = scalar.grid.problem, scalar.grid.mesh
        vector, constant = ng.VectorH1(mesh, order=2), ng.L2(mesh, order=0)
        space = ng.FESpace([scalar.space, vector, vector, *[constant] * 6])
        chi, u, lam, *fields = space.TrialFunction()
        middle = ng.GridFunction(ng.VectorL2(mesh, order=0))
        middle.Set(ng.CF((ng.x, ng.y)))
        modes = (1.0, (ng.x - middle[0]) / problem.h_x, (ng.y - middle[1]) / problem.h_y)
        theta, tau = (
            sum(a * b for a, b in zip(part, modes, strict=True))
            for part in (fields[:3], fields[3:])
        )
        F, slope = ng.Id(2) + ng.Grad(u), ng.Grad(lam)
        log_J, rate = ng.log(ng.Det(F)), ng.InnerProduct(ng.Inv(F).trans, slope)
        weight = scalar.grid.sector.copies * problem.T
        if problem.motion.axis:
            r = problem.L / 2 - ng.x
            weight = scalar.grid.sector.copies * 2 * ng.pi * r
            log_J, rate = log_J + ng.log(1 - u[0] / r), rate - lam[0] / (r - u[0])
        carried, excess = split_bulk_modulus(problem.K, problem.G)
        e_0 = problem.E_0 * carried / problem.K
        sigmoid = 1 / (1 + (1 + problem.p) * problem.K / carried * ng.exp(-chi))
        weight = weight * excess * (e_0 + (1 - e_0) * sigmoid)
        self.form = ng.BilinearForm(space)
        self.form += ng.Variation(weight * (theta * rate + tau * (log_J - theta)) * dx())
        self.state = ng.GridFunction(space)
        self.outer = 5 * scalar.ndof
        self.inner = int(space.ndof) - self.outer

    def at(self, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First and second derivative by chi, u and lam once theta and tau are eliminated."""
        n, values = self.outer, self.state.vec.FV().NumPy()
        values[:n], values[n:] = vector, 0.0
        # R is quadratic in (theta, tau): one Newton step makes it stationary.
        for _ in range(2):
            self.form.AssembleLinearization(self.state.vec)
            matrix, result = form_matrix(self.form).toarray(), self.state.vec.CreateVector()
            self.form.Apply(self.state.vec, result)
            first = np.array(result.FV().NumPy())
            values[n:] -= np.linalg.solve(matrix[n:, n:], first[n:])
        self.form.Apply(self.state.vec, result)
        self.form.AssembleLinearization(self.state.vec)
        matrix = form_matrix(self.form).toarray()
        inside = np.linalg.solve(matrix[n:, n:], matrix[n:, :n])
        return result.FV().NumPy()[:n].copy(), matrix[:n, :n] - matrix[:n, n:] @ inside


def agree(value: FloatArray, expected: FloatArray) -> None:
    # NGSolve takes its second derivatives by differences, to about ten digits.
    assert np.abs(value - expected).max() <= 1e-8 * np.abs(expected).max()
    assert np.abs(expected).max() > 0


def test_derivatives_by_hand_are_those_of_ngsolve_after_eliminating_the_field(
    kinematics: str, random: np.random.Generator
) -> None:
    point = ControlPoint(9.0, 1.5)
    problem = SpringProblem((point,), kinematics=kinematics, elements=4, L=90.0, H=110.0, T=1.7)
    scalar = ScalarSpace(Grid(with_nu(problem, 0.499)))
    n, table = scalar.ndof, ElementTable(scalar)
    chi = random.uniform(-3, 3, n)
    u, lam = random.uniform(-1, 1, 2 * n), random.uniform(-1, 1, 2 * n)
    at_points = chi[table.dofs] @ table.value.T
    field = PressureField(scalar, table)
    first, second = Symbolic(scalar).at(np.concatenate([chi, u, lam]))
    for value, expected in zip(
        field.residual(at_points, u, lam), np.split(first, [n, 3 * n]), strict=True
    ):
        agree(value, expected)

    def dense(elements: FloatArray) -> FloatArray:
        rows, columns = np.repeat(table.dofs, 9, axis=1), np.tile(table.dofs, 9)
        entries = (elements.ravel(), (rows.ravel(), columns.ravel()))
        return sp.coo_matrix(entries, shape=(n, n)).toarray()

    def of(part: int) -> slice:
        return slice(part * n, (part + 1) * n)

    blocks = field.blocks(at_points, u, lam)
    agree(dense(blocks.chi_chi), second[of(0), of(0)])
    for c in (0, 1):
        agree(dense(blocks.chi_u[c]), second[of(0), of(1 + c)])
        agree(dense(blocks.chi_lam[c]), second[of(0), of(3 + c)])
        for r in (0, 1):
            agree(dense(blocks.u_u[r, c]), second[of(1 + r), of(1 + c)])
            agree(dense(blocks.u_lam[r, c]), second[of(1 + r), of(3 + c)])
            agree(dense(field.stiffness(at_points, u)[r, c]), second[of(1 + r), of(3 + c)])


def test_forces_are_the_derivative_of_the_energy(
    coarse: SpringProblem, random: np.random.Generator
) -> None:
    scalar = ScalarSpace(Grid(with_nu(coarse, 0.499)))
    field = PressureField(scalar, ElementTable(scalar))
    at_points = random.uniform(-4, 4, field.table.x.shape)
    u, d = (random.uniform(-0.3, 0.3, 2 * scalar.ndof) for _ in range(2))
    h = 1e-3

    def energy(t: float) -> float:
        return field.energy(at_points, u + t * d)

    slope = (8 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12 * h)
    assert field.forces(at_points, u) @ d == pytest.approx(slope, rel=1e-7)


def test_the_projection_never_has_more_energy_than_ln_j_itself(
    coarse: SpringProblem, random: np.random.Generator
) -> None:
    problem = with_nu(coarse, 0.49)
    scalar = ScalarSpace(Grid(problem))
    field = PressureField(scalar, ElementTable(scalar))
    at_points = random.uniform(-9, 9, field.table.x.shape)
    weights = split_bulk_modulus(problem.K, problem.G)[1] * field.table.weights
    weights = weights * excess_stiffness(at_points, problem)
    uniform = 0.1 * stretched(scalar)
    log_J = np.log(1 + 0.1 / problem.H)
    # A change of volume that is linear in an element is its own projection, whatever the weights.
    assert field.energy(at_points, uniform) == pytest.approx((weights * log_J**2).sum() / 2)
    rough = random.uniform(-0.3, 0.3, 2 * scalar.ndof)
    mesh = scalar.grid.mesh
    u = ng.GridFunction(ng.VectorH1(mesh, order=2))
    u.vec.FV().NumPy()[:] = rough
    F_33 = problem.motion.F_33(u[0], ng.x, problem.L)
    J = ng.Det(ng.Id(2) + ng.Grad(u)) * F_33
    pointwise = np.asarray(J(mesh(field.table.x.ravel(), field.table.y.ravel())))
    whole = (weights.ravel() * np.log(pointwise.ravel()) ** 2).sum() / 2
    assert 0.0 < field.energy(at_points, rough) < 0.999 * whole


# -- grey and void -------------------------------------------------------------------------------


@pytest.mark.parametrize("nu", [0.4501, 0.47, 0.49, 0.4999])
def test_grey_and_void_stay_compressible_and_solid_does_not(nu: float) -> None:
    problem = with_nu(SpringProblem((ControlPoint(-10.0, -5.0),)), nu)
    carried, excess = split_bulk_modulus(problem.K, problem.G)
    chi = np.linspace(-40.0, -2.0, 200)
    bulk = carried * stiffness(chi, problem) + excess * excess_stiffness(chi, problem)
    assert (bulk <= 2.2 * carried * stiffness(chi, problem)).all()
    assert excess_stiffness(np.array(30.0), problem) == pytest.approx(1.0, abs=1e-6)


def test_the_formulation_is_continuous_where_the_pressure_field_begins() -> None:
    forces = []
    for nu in (0.45, 0.4500001):
        problem = with_nu(SpringProblem((ControlPoint(-10.0, -5.0),), elements=8), nu)
        body = Mechanics(ScalarSpace(Grid(problem)), 6 * ng.cos(4 * ng.pi * ng.x / 100) - 1)
        assert PressureField.needed(problem) == (nu > 0.45)
        forces.append(body.at_rest().stiffness)
    assert forces[1] == pytest.approx(forces[0], rel=1e-5)


def test_derivatives_of_the_interpolation(random: np.random.Generator) -> None:
    problem = with_nu(SpringProblem((ControlPoint(-10.0, -5.0),)), 0.49)
    chi, h = random.uniform(-12, 12, 50), 1e-4
    first, second = excess_stiffness_derivatives(chi, problem)
    up, down = excess_stiffness(chi + h, problem), excess_stiffness(chi - h, problem)
    np.testing.assert_allclose((up - down) / (2 * h), first, atol=1e-8)
    up, down = (excess_stiffness_derivatives(chi + s * h, problem)[0] for s in (1, -1))
    np.testing.assert_allclose((up - down) / (2 * h), second, atol=1e-8)


# -- known solutions -----------------------------------------------------------------------------


@pytest.mark.parametrize("nu", [0.49, 0.499, 0.4999])
def test_a_block_with_free_sides_is_as_strong_as_its_law_says(nu: float, kinematics: str) -> None:
    body = solid_block(nu, kinematics)
    for d in (-20.0, 20.0):
        found = body.equilibrium(d, body.at_rest().tangent * d)
        assert found.q == pytest.approx(block_force(body.problem, d), rel=1e-8)


def test_planar_tension_of_an_incompressible_block() -> None:
    # P = 2 C_10 (lambda - lambda^-3) with 2 C_10 = G, of which 1 / K is left: two K remove it.
    stretch, forces = 1.2, []
    for ratio in (1e4, 2e4):
        problem = SpringProblem((ControlPoint(-10.0, -5.0),), elements=4, K=ratio, G=1.0)
        body = Mechanics(ScalarSpace(Grid(problem)), ng.CF(200.0))
        found = body.equilibrium(20.0, 20.0 * body.at_rest().tangent)
        forces.append(found.q / problem.top_area)
    expected = stretch - stretch**-3
    assert forces[0] == pytest.approx(expected, rel=1e-3)
    assert 2 * forces[1] - forces[0] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("nu", [0.49, 0.499, 0.4999])
def test_a_confined_block_has_the_stresses_of_its_law(nu: float) -> None:
    body = solid_block(nu)
    d, problem = -2.0, body.problem
    confined = displacement_extraction(body.scalar).restrict(d * stretched(body.scalar))
    forces = body.forces(d, confined[:-1])
    sideways, axial, _ = principal_stresses(problem.law, 1.0, 1 + d / problem.H, 1.0)
    assert forces[-1] == pytest.approx(float(axial) * problem.top_area, rel=1e-8)
    # The only other force is on the left side, which would move out. It stands for both sides.
    side = int(np.abs(forces[:-1]).argmax())
    assert forces[side] == pytest.approx(-2 * float(sideways) * problem.H * problem.T, rel=1e-8)
    others = np.delete(forces[:-1], side)
    assert np.abs(others).max() < 1e-10 * abs(forces[side])


def bending_stiffness(nu: float, elements: int) -> float:
    """dq/dd at rest of two curved walls that bend, 15 mm thick."""
    problem = SpringProblem((ControlPoint(-10.0, -1.0),), elements=elements)
    off = ng.x - 22 - 12 * ng.cos(2 * ng.pi * ng.y / 100)
    inside = 7.5 - ng.sqrt(off * off + 1e-9)
    chi = ng.IfPos(inside + 8, inside, -8.0)
    return Mechanics(ScalarSpace(Grid(with_nu(problem, nu))), chi).at_rest().stiffness


def test_a_bending_wall_does_not_lock(monkeypatch: pytest.MonkeyPatch) -> None:
    def error(nu: float) -> float:
        return bending_stiffness(nu, 16) / bending_stiffness(nu, 32) - 1

    compressible = error(0.4)
    assert 0.0 < compressible < 0.015
    for nu in (0.49, 0.4999):
        assert 0.0 < error(nu) < 0.02
    # With all of K at every point it does, so that this test can tell.
    monkeypatch.setattr(material, "LARGEST_NU", 0.49995)
    assert error(0.499) > 0.15


def test_an_inverted_element_is_not_finite() -> None:
    body = solid_block(0.49)
    force: Any = body.forces(-10.0, np.random.default_rng(1).uniform(-40, 40, body.free))
    assert not np.isfinite(force).all()
