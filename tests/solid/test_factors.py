"""Factors of the tangent of a solid in contact."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
import scipy.sparse as sp
from support.contact_bodies import block_with_hole

from ngspring.analysis.path import follow
from ngspring.basics.arrays import FloatArray
from ngspring.fem.process import parallel
from ngspring.solid.contact.elasticity import Solid
from ngspring.solid.contact.factors import Factors, Tangent
from ngspring.solid.contact.response import ContactSettings, contact_mechanics

SOLVERS = ["sparsecholesky"] + ["pardiso"] * (importlib.util.find_spec("pypardiso") is not None)


def spring_between(size: int, i: int, j: int, stiffness: float) -> sp.csr_matrix:
    """A spring between two unknowns, as contact that couples what the mesh does not."""
    values = stiffness * np.array([1.0, 1.0, -1.0, -1.0])
    return sp.csr_matrix((values, ([i, j, i, j], [i, j, j, i])), shape=(size, size))


@pytest.fixture(scope="module")
def solid() -> Solid:
    return contact_mechanics(block_with_hole(12.0), ContactSettings())[0].solid


@pytest.mark.parametrize("solver", SOLVERS)
def test_they_solve_whatever_touches(solver: str, solid: Solid) -> None:
    """First nothing, then here, then there, then nothing again."""
    n = solid.free
    full = np.zeros(2 * solid.ndof)
    values, stiff = solid.tangent_values(full), float(solid.diagonal_at_rest.max())
    factors = Factors(solid, solver)
    load: FloatArray = np.random.default_rng(1).standard_normal(n)
    nothing = spring_between(n + 1, 0, 1, 0.0)
    for contact in (
        nothing,
        spring_between(n + 1, 0, n - 1, stiff),
        spring_between(n + 1, 2, n - 3, stiff),
        nothing,
    ):
        assert factors.factorize(Tangent(values, contact)) == 0
        expected = (solid.tangent(full) + contact)[:n, :n] @ factors.solve(load)
        np.testing.assert_allclose(expected, load, atol=1e-9)
    assert factors.factorize(Tangent(values, spring_between(n + 1, 0, n - 1, -stiff))) == 1


def test_the_column_of_the_displacement_is_that_of_the_whole(solid: Solid) -> None:
    n = solid.free
    values = solid.tangent_values(np.zeros(2 * solid.ndof))
    contact = spring_between(n + 1, 3, n, 7.0)
    column, corner = Tangent(values, contact).of_d(solid.pattern)
    whole = (solid.pattern.matrix(values) + contact).toarray()
    np.testing.assert_allclose(column, whole[:n, n], rtol=0, atol=1e-14 * abs(whole).max())
    assert corner == pytest.approx(whole[n, n], rel=1e-14)


def test_a_smooth_path_takes_a_tangent_a_point() -> None:
    """One for du/dd, which the next point is found with; without contact two do for the first."""
    made: list[int] = []
    with parallel(1) as threads:
        mechanics, _ = contact_mechanics(block_with_hole(12.0), ContactSettings(), threads)
        follow(
            mechanics,
            np.array([0.2, 0.4, 0.6, 0.8, 1.0]),
            mechanics.at_rest(),
            on_point=lambda point: made.append(point.iterations),
        )
    assert len(made) == 5
    assert made[1:] == [0, 0, 0, 0]
