"""Every law in both kinematics: expressions and their derivatives, from a point to the system."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
from support.coupled import Flat
from support.designs import rough_coefficients
from support.lagrangian import Lagrangian

from ngspring import ControlPoint, Design, SpringProblem, load_displacement, taylor_test
from ngspring.analysis.mechanics import Mechanics
from ngspring.basics.arrays import FloatArray
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.physics.elasticity import Gradient, automatic_virtual_work, virtual_work
from ngspring.physics.powers import SMALL, MeanPowers
from ngspring.problem.laws import ArrudaBoyce, Gent, MooneyRivlin, Ogden, Yeoh
from ngspring.problem.laws.base import Law, Stretches
from ngspring.problem.targets.full_block import block_force

LAWS = (
    MooneyRivlin(K=1.7, C10=0.11, C01=0.07),
    Yeoh(K=1.7, C10=0.2, C20=-0.01, C30=0.003),
    Ogden(K=1.7, mu1=0.3, alpha1=1.0, mu2=-0.02, alpha2=-2.0, mu3=0.02, alpha3=3.0),
    Gent(K=1.7, mu=0.36, J_m=9.0),
    ArrudaBoyce(K=1.7, mu=0.3, lambda_m=2.0),
)
NAMES = [law.name for law in LAWS]
each_law = pytest.mark.parametrize("law", LAWS, ids=NAMES)


def at(problem: SpringProblem, value: ng.CoefficientFunction) -> FloatArray:
    mesh = Grid(problem).mesh  # a place in it does not keep it alive
    return np.asarray(value(mesh(20.0, 15.0)))


@pytest.fixture
def problem() -> SpringProblem:
    return SpringProblem.from_toml("elements = 8\n[[control_points]]\nd = 10\nq = 2\n")


def point(
    in_plane: tuple[float, ...], out_of_plane: float
) -> tuple[Gradient, ng.CoefficientFunction, ng.CoefficientFunction]:
    """A deformation, and what to differentiate by."""
    f = ng.CF(in_plane, dims=(2, 2)).MakeVariable()
    F_33 = ng.CF(out_of_plane).MakeVariable()
    return Gradient(f, F_33), f, F_33


# -- at a point ------------------------------------------------------------------------------------


@each_law
def test_expressions_have_the_energy_of_numbers_whatever_turns(
    law: Law, problem: SpringProblem
) -> None:
    a, b = 0.7, -0.4
    turns = [np.array([[np.cos(x), -np.sin(x)], [np.sin(x), np.cos(x)]]) for x in (a, b)]
    for first, second, third in ((1.6, 0.8, 1.1), (1.2, 1.2, 0.7), (1.3, 1.3 + 1e-9, 1.0)):
        f = turns[0] @ np.diag([first, second]) @ turns[1]
        F, _, _ = point(tuple(f.ravel()), third)
        expected = float(law.energy(Stretches(first, second, third)))
        assert at(problem, law.energy(F)) == pytest.approx(expected, rel=1e-12)


@each_law
def test_what_is_not_deformed_is_free_of_stress(law: Law, problem: SpringProblem) -> None:
    F, f, F_33 = point((1.0, 0.0, 0.0, 1.0), 1.0)
    energy = law.energy(F)
    np.testing.assert_allclose(at(problem, energy), 0.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(at(problem, energy.Diff(f)), 0.0, rtol=0, atol=2e-15)
    np.testing.assert_allclose(at(problem, energy.Diff(F_33)), 0.0, rtol=0, atol=2e-15)


@each_law
@pytest.mark.parametrize("shear", [1e-9, 1e-4, 0.15, 0.25, 1.5])
def test_simple_shear(law: Law, shear: float, problem: SpringProblem) -> None:
    """Closed forms: twice (W_1 + W_2) times the shear; of Ogden's by the stretch along."""
    F, f, _ = point((1.0, shear, 0.0, 1.0), 1.0)
    x = shear**2
    if isinstance(law, MooneyRivlin):
        expected = 2 * (law.C10 + law.C01) * shear
    elif isinstance(law, Yeoh):
        expected = 2 * (law.C10 + 2 * law.C20 * x + 3 * law.C30 * x**2) * shear
    elif isinstance(law, Gent):
        expected = law.mu * law.J_m / (law.J_m - x) * shear
    elif isinstance(law, ArrudaBoyce):
        series = zip((1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750), range(1, 6), strict=True)
        slope = sum(c * k * (3 + x) ** (k - 1) / law.lambda_m ** (2 * k - 2) for c, k in series)
        expected = 2 * law.mu * slope * shear
    else:
        assert isinstance(law, Ogden)
        log = np.arcsinh(shear / 2)
        of_log = sum(2 * mu * np.sinh(alpha * log) for mu, alpha in law.terms)
        expected = of_log / (2 * np.cosh(log))
    found = at(problem, law.energy(F).Diff(f))[1]
    assert found == pytest.approx(expected, rel=1e-10)


def test_powers_of_stretches_and_both_derivatives_are_exact_where_they_are_equal(
    problem: SpringProblem,
) -> None:
    z = ng.Parameter(0.0)
    # cosh(s) and cosh(3 s) with sinh(s)^2 = z.
    for alpha, exact in ((1.0, ng.sqrt(1 + z)), (-3.0, ng.sqrt(1 + z) * (1 + 4 * z))):
        found = MeanPowers(z).of(alpha)
        for _ in range(3):
            for value in (0.0, 1e-300, 1e-12, 1e-4, 0.999 * SMALL, 1.001 * SMALL, 0.3, 40.0):
                z.Set(value)
                assert at(problem, found) == pytest.approx(at(problem, exact), rel=1e-12)
            found, exact = found.Diff(z), exact.Diff(z)


@pytest.mark.parametrize("alpha", [0.37, -1.3, 5.0, 11.0, 30.0])
def test_the_series_and_the_closed_form_of_a_power_meet(
    alpha: float, problem: SpringProblem
) -> None:
    z = ng.Parameter(0.0)
    found = MeanPowers(z).of(alpha)
    for _ in range(3):
        both = []
        for value in (SMALL * (1 - 1e-14), SMALL * (1 + 1e-14)):
            z.Set(value)
            both.append(at(problem, found))
        assert both[0] == pytest.approx(both[1], rel=1e-11)
        found = found.Diff(z)


def test_beyond_its_limit_gents_law_has_neither_energy_nor_stress(problem: SpringProblem) -> None:
    law = Gent(K=1.7, mu=0.36, J_m=9.0)
    F, _, _ = point((3.6, 0.0, 0.0, 1 / 3.6), 1.0)
    partial = law.partial_derivatives(F)
    assert partial is not None
    assert not np.isfinite([at(problem, value) for value in (law.energy(F), *partial)]).any()
    assert not np.isfinite(law.energy(Stretches(3.6, 1 / 3.6, 1.0)))


@each_law
def test_derivatives_by_hand_are_the_automatic_ones(
    law: Law, coarse: SpringProblem, random: np.random.Generator
) -> None:
    problem = coarse.replace(material=law)
    mesh = Grid(problem).mesh
    space = ng.VectorH1(mesh, order=2)
    u, v = ng.GridFunction(space), ng.GridFunction(space)
    for field in (u, v):
        field.vec.FV().NumPy()[:] = random.uniform(-0.4, 0.4, space.ndof)
    places = mesh(np.linspace(1, 40, 7), np.linspace(2, 50, 7))
    both = [
        np.asarray(work(u, ng.Grad(u), v, ng.Grad(v), problem)(places))
        for work in (virtual_work, automatic_virtual_work)
    ]
    np.testing.assert_allclose(both[0], both[1], rtol=1e-10)


# -- in the analyses -------------------------------------------------------------------------------


@each_law
def test_forces_and_stiffness_are_derivatives_of_the_energy(
    law: Law, balanced: SpringProblem, random: np.random.Generator
) -> None:
    problem = balanced.replace(material=law)
    scalar = ScalarSpace(Grid(problem))
    chi = rough_coefficients(problem)
    mechanics = Mechanics(scalar, Flat(Design(problem, chi)).system.extraction_chi @ chi.ravel())
    u = mechanics.uniform_stretch(6.0) + 0.4 * random.uniform(-1, 1, mechanics.free)
    direction = random.uniform(-1, 1, mechanics.free)
    mechanics.assemble(6.0, u)
    tangent = mechanics.tangent[: mechanics.free, : mechanics.free]
    test = taylor_test(
        lambda x: mechanics.energy(6.0, x),
        lambda x: mechanics.forces(6.0, x)[: mechanics.free],
        u,
        direction,
        lambda x, d: tangent @ d,
    )
    assert test.first_order == pytest.approx(2, abs=0.05), str(test)
    assert test.second_order == pytest.approx(3, abs=0.1), str(test)


@each_law
def test_a_full_block_is_in_uniaxial_stress(law: Law, kinematics: str) -> None:
    """Another solution of the same state: one equation for the transverse stretch."""
    points = (ControlPoint(9.0, 1.5),)
    problem = SpringProblem(points, kinematics=kinematics, elements=4, L=90.0, H=110.0)
    problem = problem.replace(material=law)
    response = load_displacement(ng.CF(60.0), [30.0, -30.0], problem=problem, threads=1)
    expected = [block_force(problem, d) for d in (30.0, -30.0)]
    np.testing.assert_allclose(response.q, expected, rtol=1e-9)


class ThreeByThree:
    """What a law asks of F, from all of its nine components: shares nothing with the package."""

    def __init__(self, F: ng.CoefficientFunction) -> None:
        C = F.trans * F
        self.J, self.log_J = ng.Det(F), ng.log(ng.Det(F))
        self.I_1 = ng.Trace(C)
        self.I_2 = (self.I_1 * self.I_1 - ng.Trace(C * C)) / 2
        self.isochoric_I_1 = self.J ** (-2 / 3) * self.I_1
        self.isochoric_I_2 = self.J ** (-4 / 3) * self.I_2
        self.exp, self.log = ng.exp, ng.log
        self.third = F[2, 2]

    def power_sum(self, alpha: float) -> ng.CoefficientFunction:
        """Of l_1 and l_2, only their sum m and their product."""
        product = self.J / self.third
        m = ng.sqrt(self.I_1 - self.third**2 + 2 * product)
        both = {1.0: m, 3.0: m**3 - 3 * m * product, -2.0: (m**2 - 2 * product) / product**2}
        return self.J ** (-alpha / 3) * (both[alpha] + self.third**alpha)


@each_law
def test_first_and_second_variation_of_the_lagrangian(law: Law, balanced: SpringProblem) -> None:
    problem = balanced.replace(material=law)
    flat = Flat(Design(problem, rough_coefficients(problem)))

    def stress(F: ng.CoefficientFunction, _: SpringProblem) -> ng.CoefficientFunction:
        variable = F.MakeVariable()
        return law.energy(ThreeByThree(variable)).Diff(variable)

    lagrangian = Lagrangian(flat.problem, flat.chi_old, flat.dt, stress)
    matrix = flat.matrix(flat.x)
    test = taylor_test(
        lambda x: lagrangian(flat.state(x)),
        flat.residual,
        flat.x,
        flat.direction("all"),
        lambda x, d: matrix(d),
    )
    assert test.first_order == pytest.approx(2, abs=0.05), str(test)
    assert test.second_order == pytest.approx(3, abs=0.1), str(test)
