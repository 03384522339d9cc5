"""A term of the objective may depend on displacements: the adjoint equation gets its derivative."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from support.coupled import Flat

from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.kkt.elimination import Elimination
from ngspring.kkt.newton import NewtonSettings, solve_update
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.physics.chi import CF, rho
from ngspring.physics.elasticity import gradient
from ngspring.physics.terms import TERMS
from ngspring.physics.terms.base import Fields, Term
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem


class Straining(Term):
    """(I_1 - 3)^2 in the solid: something that depends on chi and on displacements."""

    name: ClassVar[str] = "straining"
    weight: ClassVar[str] = "k_i"
    of_u: ClassVar[bool] = True

    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        excess = gradient(fields.u, fields.grad_u, problem).I_1 - 3
        return problem.k_i * rho(fields.chi) * excess * excess


WITH_STRAINING = (*TERMS, Straining())


@pytest.fixture
def spring(kinematics: str) -> SpringProblem:
    """As strong as the other terms: with Table 1's weight it would drown."""
    unit = 1.0 if kinematics == "plane strain" else 50.0
    points = (
        ControlPoint(5.0, 2.0 * unit, weight=1 / unit**2),
        ControlPoint(-5.0, -2.0 * unit, weight=1 / unit**2, eta=0.5),
    )
    return SpringProblem(points, elements=8, kinematics=kinematics, l_i=10.0, k_i=0.3 / unit)


def system_of(spring: SpringProblem) -> CoupledSystem:
    return CoupledSystem(spring, "sparsecholesky", terms=WITH_STRAINING)


def test_its_value_is_part_of_the_objective(spring: SpringProblem) -> None:
    design = Design.column(spring)
    system, plain = system_of(spring), CoupledSystem(spring, "sparsecholesky")
    values = system.terms(initial_state(system, design))
    without = plain.terms(initial_state(plain, design))
    assert values["straining"] > 0.1 * without["C"]
    assert values["C"] == pytest.approx(without["C"] + values["straining"], rel=1e-9)


def test_eq_8_is_the_derivative_of_the_objective_along_equilibria(
    spring: SpringProblem, random: np.random.Generator
) -> None:
    system = system_of(spring)
    chi = Design.column(spring).coefficients
    direction = random.uniform(-1, 1, chi.shape)

    def objective(t: float) -> float:
        return system.terms(initial_state(system, Design(spring, chi + t * direction)))["C"]

    state = initial_state(system, Design(spring, chi))
    residual = system.residual(state, state.chi, np.inf)
    assert np.abs(residual.u).max() < 1e-8 * np.abs(state.lam).max()
    h = 1e-3
    difference = (8 * (objective(h) - objective(-h)) - (objective(2 * h) - objective(-2 * h))) / (
        12 * h
    )
    assert residual.chi @ direction.ravel() == pytest.approx(difference, rel=1e-6)


def test_the_newton_matrix_is_the_derivative_of_the_residual(
    spring: SpringProblem, random: np.random.Generator
) -> None:
    system = system_of(spring)
    state = initial_state(system, Design.column(spring))
    residual = system.residual(state, state.chi, 1e3)
    system.assemble(state, 1e3)
    update = system.solve(residual)
    h = 1e-4 / np.abs(update.chi).max()

    def at(t: float) -> FloatArray:
        moved = State(
            *(a + t * b for a, b in zip(vars(state).values(), vars(update).values(), strict=True))
        )
        return Flat.vector(system.residual(moved, state.chi, 1e3))

    product = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)
    expected = -Flat.vector(residual)
    assert np.abs(product - expected).max() < 1e-6 * np.abs(expected).max()


def test_a_design_update_converges_with_it(spring: SpringProblem) -> None:
    system = system_of(spring)
    state = initial_state(system, Design.column(spring))
    outcome = solve_update(system, state, state.chi, 10.0, NewtonSettings(), Elimination(system))
    assert outcome.converged
    assert outcome.iterations <= 5


def test_a_term_without_weight_is_left_out(spring: SpringProblem) -> None:
    assert not Straining().active(spring.replace(k_i=0.0))
    system = CoupledSystem(spring.replace(k_i=0.0), terms=WITH_STRAINING)
    assert system.control_point.terms == ()
