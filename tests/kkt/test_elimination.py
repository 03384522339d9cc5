"""Equilibrium inside the coupled iteration, and where a spring settles after a snap-through."""

import numpy as np
import pytest

from ngspring.analysis.mechanics import Mechanics
from ngspring.basics.errors import ConvergenceError
from ngspring.design.design import Design
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.kkt.elimination import Elimination
from ngspring.kkt.newton import NewtonSettings, solve_update
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.problem.cases import cases


class Accurate(Elimination):
    ACCURACY = 1e-8


@pytest.fixture(scope="module")
def problem():
    return cases["C4"].replace(elements=12, l_i=7.0)


@pytest.fixture(scope="module")
def system(problem):
    return CoupledSystem(problem, "sparsecholesky", 1)


@pytest.fixture(scope="module")
def state(system, problem):
    return initial_state(system, Design.column(problem))


def out_of_balance(system, state):
    residual = system.residual(state, state.chi, np.inf)
    return np.linalg.norm(residual.lam[:, :-1], axis=1)


def test_a_state_in_equilibrium_is_left_as_it_is(system, state):
    relaxed = Elimination(system).relax(state, state)
    np.testing.assert_array_equal(relaxed.u, state.u)
    np.testing.assert_array_equal(relaxed.lam, state.lam)


def test_displacements_come_back_into_equilibrium_with_a_changed_design(system, state):
    changed = State(state.chi + 0.5 * np.sin(np.arange(len(state.chi))), state.u, state.lam)
    assert out_of_balance(system, changed).min() > 1e-2
    relaxed = Accurate(system).relax(state, changed)
    assert out_of_balance(system, relaxed).max() < 1e-7
    np.testing.assert_array_equal(relaxed.chi, changed.chi)
    # The multiplier of the reaction force is the coupled step's; its field follows the new state.
    np.testing.assert_array_equal(relaxed.lam[:, -1], changed.lam[:, -1])
    adjoint = system.residual(relaxed, relaxed.chi, np.inf).u
    assert np.linalg.norm(adjoint) < 1e-5 * np.linalg.norm(relaxed.lam)


def test_a_step_that_inverts_elements_is_cut_back_and_balanced(system, state):
    wild = State(state.chi, state.u + 40.0 * np.cos(np.arange(state.u.shape[1])), state.lam)
    assert not system.residual(wild, wild.chi, np.inf).finite
    relaxed = Accurate(system).relax(state, wild)
    assert out_of_balance(system, relaxed).max() < 1e-7


def test_elimination_does_not_change_the_solution_of_an_update(system, state):
    settings = NewtonSettings(chi_tolerance=1e-7, u_tolerance=1e-10, residual_tolerance=1e-9)
    plain = solve_update(system, state, state.chi, 50.0, settings)
    helped = solve_update(system, state, state.chi, 50.0, settings, Elimination(system))
    assert plain.converged
    assert helped.converged
    np.testing.assert_allclose(helped.state.chi, plain.state.chi, atol=1e-8)
    np.testing.assert_allclose(helped.state.u, plain.state.u, atol=1e-8)


@pytest.fixture(scope="module")
def mechanics(problem):
    scalar = ScalarSpace(Grid(problem))
    chi = spline_extraction(scalar) @ Design.column(problem).coefficients.ravel()
    return Mechanics(scalar, chi, 0.0, "sparsecholesky", 1)


def test_a_spring_settles_in_the_equilibrium_that_newton_finds(mechanics):
    target = mechanics.equilibrium(5.0, mechanics.uniform_stretch(5.0))
    generator = np.random.default_rng(0)
    start = mechanics.uniform_stretch(5.0) + generator.uniform(-0.3, 0.3, mechanics.free)
    u, tangent = mechanics.settle(5.0, start, 1e-9)
    np.testing.assert_allclose(u, target.u, atol=1e-6)
    np.testing.assert_allclose(tangent, target.tangent, atol=1e-6)
    assert mechanics.energy(5.0, u) <= mechanics.energy(5.0, start)


def test_settling_from_an_inverted_state_is_refused(mechanics):
    start = 60.0 * np.cos(np.arange(mechanics.free))
    with pytest.raises(ConvergenceError, match="inverts"):
        mechanics.settle(5.0, start, 1e-9)
