"""Law and kinematics meet as NGSolve expressions; what is written by hand is the derivative."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest

from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.physics.elasticity import (
    Gradient,
    automatic_virtual_work,
    gradient,
    measure,
    strain_energy,
    virtual_work,
)
from ngspring.physics.void import dx
from ngspring.problem.laws.base import Stretches
from ngspring.problem.spring import SpringProblem


@pytest.mark.parametrize("of", [virtual_work, automatic_virtual_work])
def test_virtual_work_is_the_derivative_of_the_energy(
    of: object, coarse: SpringProblem, random: np.random.Generator
) -> None:
    scalar = ScalarSpace(Grid(coarse))
    space = ng.VectorH1(scalar.grid.mesh, order=2)
    u, v = ng.GridFunction(space), ng.GridFunction(space)
    for field in (u, v):
        field.vec.FV().NumPy()[:] = random.uniform(-0.1, 0.1, space.ndof)
    per_area = measure(coarse)

    def energy(t: float) -> float:
        moved, slope = u + t * v, ng.Grad(u) + t * ng.Grad(v)
        density = per_area * strain_energy(moved, slope, coarse)
        return float(ng.Integrate(density * dx(), scalar.grid.mesh))

    assert callable(of)
    work = per_area * of(u, ng.Grad(u), v, ng.Grad(v), coarse)
    h = 3e-3
    expected = (8 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12 * h)
    assert ng.Integrate(work * dx(), scalar.grid.mesh) == pytest.approx(expected, rel=1e-8)


def test_the_derivatives_by_hand_are_the_automatic_ones_in_the_newton_matrix(
    coarse: SpringProblem, random: np.random.Generator
) -> None:
    mesh = Grid(coarse).mesh
    vector = ng.VectorH1(mesh, order=2)
    space = ng.FESpace([vector, vector])
    u, lam = space.TrialFunction()
    state = ng.GridFunction(space)
    state.vec.FV().NumPy()[:] = random.uniform(-0.3, 0.3, space.ndof)
    results = []
    for work in (virtual_work, automatic_virtual_work):
        form = ng.BilinearForm(space, symmetric=True)
        density = measure(coarse) * work(u, ng.Grad(u), lam, ng.Grad(lam), coarse)
        form += ng.Variation(density.Compile() * dx())
        form.AssembleLinearization(state.vec)
        first = state.vec.CreateVector()
        form.Apply(state.vec, first)
        results.append((np.array(first.FV().NumPy()), np.array(form.mat.AsVector().FV().NumPy())))
    for by_hand, automatic in zip(*results, strict=True):
        np.testing.assert_allclose(by_hand, automatic, rtol=0, atol=1e-12 * np.abs(automatic).max())


def test_numbers_and_expressions_have_the_same_invariants(coarse: SpringProblem) -> None:
    mesh = Grid(coarse).mesh
    place = mesh(20.0, 15.0)
    a, b, c = 1.3, 0.6, 1.1
    F = Gradient(ng.CF((a, 0, 0, b), dims=(2, 2)), ng.CF(c))
    stretches = Stretches(a, b, c)
    for name in ("J", "log_J", "I_1", "I_2"):
        assert getattr(F, name)(place) == pytest.approx(getattr(stretches, name), rel=1e-14)
    law = coarse.law
    assert law.energy(F)(place) == pytest.approx(float(law.energy(stretches)), rel=1e-13)


def test_the_matrix_of_a_gradient_is_the_deformation_gradient(coarse: SpringProblem) -> None:
    mesh = Grid(coarse).mesh
    place = mesh(20.0, 15.0)
    slope = ng.CF((0.1, 0.2, -0.3, 0.4), dims=(2, 2))
    F = gradient(ng.CF((0.5, 0.0)), slope, coarse)
    hoop = 1 - 0.5 / (coarse.L / 2 - 20.0) if coarse.motion.axis else 1.0
    expected = [1.1, 0.2, 0, -0.3, 1.4, 0, 0, 0, hoop]
    assert F.matrix(place) == pytest.approx(expected)
    assert ng.Det(F.matrix)(place) == pytest.approx(F.J(place), rel=1e-14)
