"""The energies are those of Eqs. 2, 3, 10, 11, 13-17 and 20-24, against plain NumPy."""

from __future__ import annotations

from typing import Any

import ngsolve as ng
import numpy as np
import pytest

from ngspring.basics.arrays import FloatArray
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.physics import chi as design_field
from ngspring.physics import elasticity
from ngspring.physics.lagrangian import DesignForm, transient_energy
from ngspring.physics.terms import TERMS
from ngspring.physics.terms.base import Fields
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem

POINT = (ControlPoint(10.0, 2.0),)


@pytest.fixture
def problem(kinematics: str) -> SpringProblem:
    return SpringProblem(POINT, kinematics=kinematics, elements=4, K=1.9, G=0.6)


@pytest.fixture
def grid(problem: SpringProblem) -> Grid:
    return Grid(problem)


class Displacement:
    """A displacement and its gradient at one point of the mesh, in NGSolve and in NumPy."""

    def __init__(self, problem: SpringProblem, u: Any, grad: Any, x: float = 20.0) -> None:
        self.problem, self.x = problem, x
        self.u, self.grad = np.asarray(u, float), np.asarray(grad, float)
        self.cf = ng.CF(tuple(self.u)), ng.CF(tuple(self.grad.ravel()), dims=(2, 2))

    def F(self) -> FloatArray:
        """Eq. 13 or Eq. 21; r = L/2 - x, so that u_r = -u_x."""
        F = np.eye(3)
        F[:2, :2] += self.grad
        if self.problem.motion.axis:
            F[2, 2] += -self.u[0] / (self.problem.L / 2 - self.x)
        return F

    def evaluate(self, grid: Grid, cf: ng.CoefficientFunction) -> float:
        return float(cf(grid.mesh(self.x, 15.0)))

    def energy(self, grid: Grid) -> float:
        return self.evaluate(grid, elasticity.strain_energy(*self.cf, self.problem))

    def work(self, grid: Grid, v: Displacement) -> float:
        return self.evaluate(grid, elasticity.virtual_work(*self.cf, *v.cf, self.problem))


def psi(F: Any, K: float, G: float) -> Any:
    """Eq. 14 without E(chi)."""
    J = np.linalg.det(F) if not np.iscomplexobj(F) else determinant(F)
    return K / 2 * np.log(J) ** 2 + G / 2 * (J ** (-2 / 3) * (F * F).sum() - 3)


def determinant(F: Any) -> Any:
    return F[2, 2] * (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0])


def first_piola_kirchhoff(F: FloatArray, K: float, G: float) -> FloatArray:
    """Eq. 17, with the deviator of the 3 x 3 tensor."""
    J = np.linalg.det(F)
    B = F @ F.T
    dev = B - np.trace(B) / 3 * np.eye(3)
    inverse_transposed = np.linalg.inv(F).T
    return K * np.log(J) * inverse_transposed + G * J ** (-2 / 3) * dev @ inverse_transposed


def some_displacements(
    problem: SpringProblem, random: np.random.Generator, size: float = 0.4
) -> list[Displacement]:
    return [
        Displacement(problem, random.uniform(-8, 8, 2), random.uniform(-size, size, (2, 2)))
        for _ in range(5)
    ]


@pytest.mark.parametrize("chi", [-30.0, -5.5, -1.0, 0.0, 2.0, 40.0])
def test_density_stiffness_and_void_indicator_have_their_values(chi: float, grid: Grid) -> None:
    problem = grid.problem
    point = grid.mesh(20.0, 15.0)
    rho = 1 / (1 + np.exp(-chi))
    stiffness = problem.E_0 + (1 - problem.E_0) * rho / (1 + problem.p * (1 - rho))
    t = min(max(-5 - chi, 0.0), 1.0)
    step = 6 * t**5 - 15 * t**4 + 10 * t**3
    assert design_field.rho(ng.CF(chi))(point) == pytest.approx(rho, rel=1e-14)
    assert design_field.stiffness(ng.CF(chi), problem)(point) == pytest.approx(stiffness, rel=1e-12)
    assert design_field.void_indicator(ng.CF(chi))(point) == pytest.approx(step, abs=1e-15)


@pytest.mark.parametrize(("chi", "step"), [(-5, 0), (-6, 1), (-5.5, 0.5), (-4, 0), (-7, 1)])
def test_void_begins_at_minus_5_and_is_full_at_minus_6(chi: float, step: float) -> None:
    mesh = Grid(SpringProblem(POINT, elements=4)).mesh
    assert design_field.void_indicator(ng.CF(chi))(mesh(1, 1)) == pytest.approx(step, abs=1e-15)


def test_strain_energy_is_eq_14(grid: Grid, random: np.random.Generator) -> None:
    problem = grid.problem
    for u in some_displacements(problem, random):
        assert np.linalg.det(u.F()) > 0
        assert u.energy(grid) == pytest.approx(psi(u.F(), problem.K, problem.G), rel=1e-12)


def test_virtual_work_is_eqs_16_17_and_22(grid: Grid, random: np.random.Generator) -> None:
    problem = grid.problem
    for u in some_displacements(problem, random):
        v = Displacement(problem, random.uniform(-1, 1, 2), random.uniform(-1, 1, (2, 2)))
        delta_F = v.F() - np.eye(3)
        work = (first_piola_kirchhoff(u.F(), problem.K, problem.G) * delta_F).sum()
        assert u.work(grid, v) == pytest.approx(work, rel=1e-11)


def test_virtual_work_is_the_derivative_of_strain_energy(
    grid: Grid, random: np.random.Generator
) -> None:
    problem = grid.problem
    for u in some_displacements(problem, random):
        v = Displacement(problem, random.uniform(-1, 1, 2), random.uniform(-1, 1, (2, 2)))
        complex_step = u.F() + 1e-30j * (v.F() - np.eye(3))
        derivative = psi(complex_step, problem.K, problem.G).imag / 1e-30
        assert u.work(grid, v) == pytest.approx(derivative, rel=1e-11)


def test_the_reference_state_is_free_of_stress(grid: Grid, random: np.random.Generator) -> None:
    problem = grid.problem
    rest = Displacement(problem, [0, 0], np.zeros((2, 2)))
    assert rest.energy(grid) == pytest.approx(0.0, abs=1e-15)
    for v in some_displacements(problem, random):
        assert rest.work(grid, v) == pytest.approx(0.0, abs=1e-15)


def test_small_strains_see_the_bulk_and_the_shear_modulus(
    grid: Grid, random: np.random.Generator
) -> None:
    problem = grid.problem
    for _ in range(4):
        grad = 1e-5 * random.uniform(-1, 1, (2, 2))
        u = Displacement(problem, 1e-4 * random.uniform(-1, 1, 2), grad)
        strain = (u.F() + u.F().T) / 2 - np.eye(3)
        deviator = strain - np.trace(strain) / 3 * np.eye(3)
        stress = problem.K * np.trace(strain) * np.eye(3) + 2 * problem.G * deviator
        v = Displacement(problem, random.uniform(-1, 1, 2), random.uniform(-1, 1, (2, 2)))
        linear = (stress * (v.F() - np.eye(3))).sum()
        # Relative to the size of the stress: the sum may cancel.
        assert u.work(grid, v) == pytest.approx(linear, abs=3e-4 * np.abs(stress).max())


@pytest.mark.parametrize("angle", [0.3, 1.7, np.pi])
def test_rotations_cost_no_energy(angle: float, random: np.random.Generator) -> None:
    problem = SpringProblem(POINT, elements=4)
    grid = Grid(problem)
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s], [s, c]])
    for u in some_displacements(problem, random):
        turned = Displacement(problem, [3, 4], rotation @ (np.eye(2) + u.grad) - np.eye(2))
        assert turned.energy(grid) == pytest.approx(u.energy(grid), rel=1e-12)


def test_a_radial_expansion_stretches_the_hoops() -> None:
    problem = SpringProblem(POINT, elements=4, kinematics="axisymmetric")
    grid = Grid(problem)
    # u_r = 0.1 r, on the mesh left of the axis x = 50.
    u = ng.CF((-0.1 * (50 - ng.x), 0.0))
    for x in (1.0, 20.0, 49.0):
        assert elasticity.F_33(u, problem)(grid.mesh(x, 3.0)) == pytest.approx(1.1)


def test_compression_to_nothing_costs_infinite_energy(grid: Grid) -> None:
    values = [
        Displacement(grid.problem, [0, 0], [[0, 0], [0, -1 + 10.0**-k]]).energy(grid)
        for k in (1, 3, 9, 30)
    ]
    assert (np.diff(values) > 0).all()
    assert values[-1] > 1e3
    assert not np.isfinite(Displacement(grid.problem, [0, 0], [[0, 0], [0, -1.5]]).energy(grid))


def test_measure_integrates_over_the_whole_spring(coarse: SpringProblem) -> None:
    grid = Grid(coarse)
    volume = float(ng.Integrate(elasticity.measure(coarse), grid.mesh))
    if coarse.motion.axis:
        expected = np.pi * (coarse.L / 2) ** 2 * coarse.H
    else:
        expected = coarse.L * coarse.H * coarse.T
    assert volume == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("n", [2.0, 2.5, 3.0, 6.0])
@pytest.mark.parametrize("steepness", [0.3, 1.5])
def test_design_energy_is_eq_11(n: float, steepness: float, grid: Grid) -> None:
    problem = grid.problem.replace(l_i=10.0, n=n)
    a, b, c = 0.6 * steepness, 0.8 * steepness, 0.01
    chi = a * ng.x - b * ng.y + c * ng.x * ng.y + 2 * c * ng.x**2 - 30 * steepness
    x, y = 1.0, 2.0
    value = a * x - b * y + c * x * y + 2 * c * x**2 - 30 * steepness
    slope = np.hypot(a + c * y + 4 * c * x, -b + c * x)
    hesse = ng.CF((4 * c, c, c, 0), dims=(2, 2))
    fields = Fields(chi, ng.CF((chi.Diff(ng.x), chi.Diff(ng.y))), hesse)
    of_design = [term for term in TERMS if not term.of_u and term.active(problem)]
    terms = {term.name: term.density(fields, problem) for term in of_design}
    expected = {
        "volume": problem.k_rho / (1 + np.exp(-value)),
        "interface": problem.k_i / n * max(slope - 0.8, 0.0) ** n,
        "curvature": problem.k_H / 2 * (16 + 1 + 1) * c**2,
    }
    assert (expected["interface"] > 0) == (steepness > 1)
    assert terms.keys() == expected.keys()
    for name, term in terms.items():
        value = term(grid.mesh(x, y))
        assert value == pytest.approx(expected[name], rel=1e-12, abs=1e-25), name


def test_transient_energy_is_the_last_term_of_eq_11_times_dt(grid: Grid) -> None:
    problem = grid.problem
    chi, old = ng.x * ng.y, 3 * ng.x - ng.y
    energy = transient_energy(chi, ng.CF((ng.y, ng.x)), old, ng.CF((3.0, -1.0)), problem)
    x, y = 7.0, 2.0
    change = x * y - 3 * x + y
    expected = (change**2 + problem.l_t**2 * ((y - 3) ** 2 + (x + 1) ** 2)) / 2
    assert energy(grid.mesh(x, y)) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("n", [2.0, 2.5, 6.0])
@pytest.mark.parametrize("slope", [0.0, 0.8])
def test_derivatives_are_finite_where_chi_is_flat_and_at_the_limit_of_the_slope(
    slope: float, n: float, grid: Grid
) -> None:
    scalar = ScalarSpace(Grid(grid.problem.replace(l_i=10.0, n=n)))
    form = DesignForm(scalar)
    chi = np.zeros(scalar.ndof)
    vertex = scalar.is_vertex(np.arange(scalar.ndof))
    chi[vertex] = slope * (scalar.node[vertex, 0] * scalar.grid.problem.h_x / 2 - 20.0)
    for name in form.terms:
        assert np.isfinite(form.gradient(chi, name)).all(), name
    assert np.isfinite(form.tangent_nonlinear(chi)).all()
    assert np.isfinite(list(form.values(chi).values())).all()


def test_volume_of_a_solid_block_is_that_of_the_domain(coarse: SpringProblem) -> None:
    scalar = ScalarSpace(Grid(coarse))
    chi = np.where(scalar.is_vertex(np.arange(scalar.ndof)), 60.0, 0.0)
    volume = DesignForm(scalar).values(chi)["V"]
    if coarse.motion.axis:
        assert volume == pytest.approx(np.pi * (coarse.L / 2) ** 2 * coarse.H, rel=1e-12)
    else:
        assert volume == pytest.approx(coarse.L * coarse.H * coarse.T, rel=1e-12)
