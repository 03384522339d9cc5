"""The compound GridFunction holds the state of Eq. 5, and its functional is the solver's."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest
from support.coupled import Flat

from ngspring import compound_state
from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.kkt.system import CoupledSystem
from ngspring.physics.chi import rho
from ngspring.physics.elasticity import measure
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem


@pytest.fixture
def flat(rough: Design) -> Flat:
    return Flat(rough)


def test_its_lagrangian_has_the_first_variation_of_the_coupled_system(
    rough: Design, flat: Flat
) -> None:
    system, state = flat.system, flat.state(flat.x)
    fields = compound_state(rough, state=state)
    gradient = fields.state.vec.CreateVector()
    fields.lagrangian().Apply(fields.state.vec, gradient)
    values = gradient.FV().NumPy()
    n = system.scalar.ndof
    expected = system.residual(state, state.chi, np.inf)
    of_chi = system.extraction_chi.T @ values[:n]
    np.testing.assert_allclose(
        of_chi, expected.chi, rtol=0, atol=1e-9 * max(expected.chi_terms.values())
    )
    blocks = values[n:].reshape(len(system.points), 2, 2 * n)
    for j, (of_u, of_lam) in enumerate(blocks):
        transposed = system.images[0].copies[0].matrix.T
        of_u, of_lam = transposed @ of_u, transposed @ of_lam
        for given, solved in ((of_u[:-1], expected.u[j]), (of_lam, expected.lam[j])):
            np.testing.assert_allclose(given, solved, rtol=0, atol=1e-9 * np.abs(solved).max())


def test_a_design_comes_with_its_equilibria_and_adjoints(kinematics: str) -> None:
    spring = SpringProblem(
        (ControlPoint(5.0, 2.0), ControlPoint(-5.0, -2.0)), elements=8, kinematics=kinematics
    )
    design = Design.column(spring)
    fields = compound_state(design)
    volume = float(ng.Integrate(measure(spring) * rho(fields.chi), fields.mesh, order=5))
    assert volume == pytest.approx(design.volume, rel=1e-12)
    middle = fields.mesh(0.0, 50.0)
    assert [fields.u(j)(middle)[1] for j in (0, 1)] == pytest.approx([2.5, -2.5])
    gradient = fields.state.vec.CreateVector()
    fields.lagrangian().Apply(fields.state.vec, gradient)
    # Stationary in u and lam, not in chi.
    system = CoupledSystem(spring)
    n = system.scalar.ndof
    blocks = gradient.FV().NumPy()[n:].reshape(4, 2 * n)
    reduced = np.array([system.images[0].copies[0].matrix.T @ block for block in blocks])
    assert np.abs(reduced[::2, :-1]).max() < 1e-9 * np.abs(reduced[::2]).max()
    assert np.abs(reduced[1::2]).max() < 1e-6


def test_the_lagrangian_as_one_form_has_no_pressure_field(rough: Design, flat: Flat) -> None:
    design = Design(rough.problem.replace(K=100 * rough.problem.G), rough.coefficients)
    fields = compound_state(design, state=flat.state(flat.x))
    with pytest.raises(ProblemError, match="nearly incompressible"):
        fields.lagrangian()
