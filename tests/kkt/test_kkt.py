"""The coupled Newton system: exact, symmetric, really solved, one for quarter and full domain."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from support.coupled import Flat
from support.designs import rough_coefficients

import ngspring
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.fem.linear import make_factorization
from ngspring.kkt.start import initial_state, state_near
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem, LinearSolveError
from ngspring.problem.material import bulk_and_shear_modulus
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem

needs_pardiso = pytest.mark.skipif(
    importlib.util.find_spec("pypardiso") is None, reason="pypardiso is not installed"
)
SOLVERS = ["sparsecholesky", pytest.param("pardiso", marks=needs_pardiso)]


@pytest.fixture
def flat(rough: Design) -> Flat:
    return Flat(rough)


def table_1(
    kinematics: str, domain: str = "quarter", elements: int = 8, nu: float = 0.4
) -> SpringProblem:
    """A problem with the paper's weights, small enough to solve in a moment."""
    K, G = bulk_and_shear_modulus(1.0, nu)
    unit = 1.0 if kinematics == "plane strain" else 50.0
    points = (
        ControlPoint(5.0, 1.0 * unit, weight=1 / unit**2),
        ControlPoint(-5.0, -1.4 * unit, weight=1 / unit**2),
    )
    return SpringProblem(
        points, kinematics=kinematics, domain=domain, elements=elements, l_i=10.0, K=K, G=G
    )


def start(problem: SpringProblem, solver: str = "auto") -> tuple[CoupledSystem, State]:
    """Equilibrium and adjoint states of the default start."""
    system = CoupledSystem(problem, solver)
    return system, initial_state(system, Design.column(problem))


def test_the_matrix_is_the_derivative_of_the_residual(flat: Flat) -> None:
    matrix = flat.matrix(flat.x)
    for field in ("chi", "u", "lam", "all"):
        d = flat.direction(field, seed=3)
        expected = flat.derivative(d)
        product = matrix(d)
        for block in ("chi", "u", "lam"):
            part = flat.field(block)
            size = np.abs(expected[part]).max()
            error = np.abs(product[part] - expected[part]).max()
            assert error <= 2e-7 * max(size, 1e-3 * np.abs(expected).max()), (field, block)


def test_the_residual_has_a_symmetric_derivative(flat: Flat) -> None:
    h = 1e-4
    v, w = flat.direction("all", 1), flat.direction("all", 2)

    def derivative(d: FloatArray) -> FloatArray:
        return (flat.residual(flat.x + h * d) - flat.residual(flat.x - h * d)) / (2 * h)

    assert v @ derivative(w) == pytest.approx(w @ derivative(v), rel=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(("dt", "nu"), [(1.0, 0.4), (1e8, 0.4), (np.inf, 0.4), (1e8, 0.4999)])
def test_solve_solves_the_system_the_residual_belongs_to(
    solver: str, dt: float, nu: float, kinematics: str
) -> None:
    # With the weights of Table 1 the rows of chi are some 1e-8 of the others.
    system, state = start(table_1(kinematics, nu=nu), solver)
    random = np.random.default_rng(4)
    old = state.chi + random.uniform(-0.1, 0.1, state.chi.shape)
    residual = system.residual(state, old, dt)
    system.assemble(state, dt)
    update = system.solve(residual)
    assert np.abs(update.chi).max() > 0
    # K update = -residual, with K update by differences of the residual.
    h = 1e-3 / max(np.abs(update.chi).max(), np.abs(update.u).max())

    def at(t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        chi, u, lam = state.chi + t * update.chi, state.u + t * update.u, state.lam + t * update.lam
        r = system.residual(State(chi, u, lam), old, dt)
        return r.chi, r.u, r.lam

    plus, minus, far_plus, far_minus = at(h), at(-h), at(2 * h), at(-2 * h)
    terms = system.residual(state, old, dt).chi_terms
    given = (residual.chi, residual.u, residual.lam)
    for k, rhs in enumerate(given):
        near, far = plus[k] - minus[k], far_plus[k] - far_minus[k]
        product = (8 * near - far) / (12 * h)
        error = np.abs(product + rhs).max()
        # chi is what is solved for: its rows are judged by its own small right-hand side.
        size = max(terms.values()) if k == 0 else np.abs(state.lam).max() + 1
        assert error <= 1e-6 * size, k


@needs_pardiso
def test_both_linear_solvers_give_the_same_update(kinematics: str) -> None:
    updates = []
    for solver in ("sparsecholesky", "pardiso"):
        system, state = start(table_1(kinematics), solver)
        residual = system.residual(state, state.chi, 1e3)
        system.assemble(state, 1e3)
        updates.append(system.solve(residual))
    for a, b in zip(*(vars(u).values() for u in updates), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-8 * np.abs(b).max())


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_solver_can_be_used_again_at_another_state(solver: str) -> None:
    problem = table_1("plane strain")
    system, state = start(problem, solver)
    fresh_system, _ = start(problem, solver)
    system.assemble(state, 1.0)
    state.chi += 0.3
    for each in (system, fresh_system):
        each.assemble(state, 1e4)
    residual = system.residual(state, state.chi, 1e4)
    again, fresh = system.solve(residual), fresh_system.solve(residual)
    np.testing.assert_allclose(again.chi, fresh.chi, rtol=1e-9)
    np.testing.assert_allclose(again.lam, fresh.lam, rtol=1e-9, atol=1e-12)


@needs_pardiso
@pytest.mark.parametrize("nu", [0.4, 0.499])
def test_a_convex_state_has_free_plus_one_negative_eigenvalues_per_control_point(
    kinematics: str, domain: str, nu: float
) -> None:
    system, state = start(table_1(kinematics, domain, nu=nu), "pardiso")
    # A small dt makes the block of chi convex, small displacements those of u.
    system.assemble(state, 1e-2)
    assert system.negative_eigenvalues == len(system.points) * (system.free + 1)


@needs_pardiso
def test_a_concave_design_block_shows_in_the_inertia() -> None:
    problem = table_1("plane strain")
    system, state = start(problem, "pardiso")
    system.assemble(state, -1e-2)
    convex = len(system.points) * (system.free + 1)
    assert system.negative_eigenvalues == convex + system.coefficients


def test_without_pardiso_the_inertia_is_not_known() -> None:
    system, state = start(table_1("plane strain"), "sparsecholesky")
    assert system.negative_eigenvalues is None
    system.assemble(state, 1.0)
    assert system.negative_eigenvalues is None


def test_unknown_linear_solver_is_refused() -> None:
    system, state = start(table_1("plane strain"))
    system.solver = "umfpack"
    with pytest.raises(ProblemError, match="umfpack"):
        system.assemble(state, 1.0)


def test_a_state_with_an_inverted_element_is_told_not_solved() -> None:
    system, state = start(table_1("plane strain"))
    state.u *= -30
    assert not system.residual(state, state.chi, 1.0).finite
    with pytest.raises(LinearSolveError, match="finite"):
        system.assemble(state, 1.0)


@pytest.mark.parametrize(("eta", "nu"), [(0.0, 0.4), (1.0, 0.4), (1.0, 0.499)])
def test_quarter_and_full_domain_make_the_same_newton_step(
    kinematics: str, eta: float, nu: float
) -> None:
    updates, forces, residuals = [], [], []
    for domain in ("quarter", "full"):
        problem = table_1(kinematics, domain, nu=nu)
        first, second = problem.control_points
        problem = problem.replace(
            control_points=(first, ControlPoint(second.d, second.q, second.weight, eta))
        )
        design = Design(problem, 0.7 * rough_coefficients(problem))
        system = CoupledSystem(problem)
        state = initial_state(system, design)
        residual = system.residual(state, state.chi, 1e4)
        system.assemble(state, 1e4)
        update = system.solve(residual)
        updates.append(update.chi)
        forces.append((state.forces(problem), update.lam[:, -1]))
        residuals.append(residual.chi)
    np.testing.assert_allclose(*(f[0] for f in forces), rtol=1e-9)
    np.testing.assert_allclose(*(f[1] for f in forces), rtol=1e-9)
    for pair in (residuals, updates):
        size = np.abs(pair[0]).max()
        np.testing.assert_allclose(pair[1], pair[0], rtol=0, atol=1e-9 * size)


def test_q_is_the_target_plus_the_scaled_multiplier(flat: Flat) -> None:
    state = flat.state(flat.x)
    points = flat.problem.control_points
    expected = [p.q + lam[-1] / p.weight for p, lam in zip(points, state.lam, strict=True)]
    np.testing.assert_allclose(state.forces(flat.problem), expected, rtol=1e-14)


def test_initial_state_solves_equilibrium_and_adjoint_equations(kinematics: str) -> None:
    system, state = start(table_1(kinematics))
    residual = system.residual(state, state.chi, np.inf)
    forces = state.forces(system.problem)
    assert np.abs(residual.lam).max() < 1e-9 * np.abs(forces).max()
    assert np.abs(residual.u).max() < 1e-9 * np.abs(state.lam).max() * np.abs(forces).max()


def test_other_targets_have_the_same_equilibria_and_their_own_adjoint_states(
    kinematics: str,
) -> None:
    system, state = start(table_1(kinematics))
    points = [dataclasses.replace(p, aim=1.1 * p.q) for p in system.problem.control_points]
    system.retarget(points)
    near = state_near(system, state)
    whole = initial_state(system, Design.column(system.problem))
    np.testing.assert_allclose(near.u, whole.u, atol=1e-9 * np.abs(whole.u).max())
    np.testing.assert_allclose(near.lam, whole.lam, atol=1e-8 * np.abs(whole.lam).max())
    assert np.abs(near.lam - state.lam).max() > 0.01 * np.abs(state.lam).max()


BLOCKTIME = """
import ctypes, sys
import numpy as np, scipy.sparse as sp
from ngspring.fem.linear import make_factorization
make_factorization(sp.csr_matrix(np.eye(3)), "pardiso", 2).factorize()
names = {line.split()[-1] for line in open("/proc/self/maps") if "libiomp5" in line}
print([ctypes.CDLL(name).kmp_get_blocktime() for name in names])
"""


@needs_pardiso
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize(("given", "blocktime"), [(None, 0), ("7", 7)])
def test_idle_threads_of_pardiso_do_not_spin_unless_asked_to(
    given: str | None, blocktime: int
) -> None:
    environment = {key: value for key, value in os.environ.items() if key != "KMP_BLOCKTIME"}
    if given is not None:
        environment["KMP_BLOCKTIME"] = given
    done = subprocess.run(
        [sys.executable, "-c", BLOCKTIME],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(ngspring.__file__).parents[1],
    )
    assert done.stdout == f"[{blocktime}]\n"


@needs_pardiso
def test_pardiso_is_not_searched_for_in_the_whole_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def walk(*args: object, **options: object) -> list[str]:
        raise AssertionError("the environment is searched")

    monkeypatch.delenv("PYPARDISO_MKL_RT", raising=False)
    monkeypatch.setattr("glob.glob", walk)
    make_factorization(sp.csr_matrix(np.eye(3)), "pardiso").factorize()
