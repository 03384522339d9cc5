"""A design as NGSolve grid functions is the same design."""

from __future__ import annotations

import numpy as np
import pytest

from ngspring import Design, NgspringError, cases, load_displacement
from ngspring.view.fields import design_fields

PROBLEM = cases["C4"].replace(elements=8, l_i=10.0)
PLACES = [(3.0, 4.0), (21.0, 33.0), (47.0, 49.0)]


def test_chi_is_the_spline_at_every_point() -> None:
    design = Design.random(PROBLEM, seed=2)
    mesh, chi, _ = design_fields(design)
    for x, y in PLACES:
        assert chi(mesh(x, y)) == pytest.approx(float(design.chi(x, y)), abs=1e-12)


@pytest.mark.parametrize("kinematics", ["plane strain", "axisymmetric"])
@pytest.mark.parametrize("domain", ["quarter", "full"])
def test_u_is_the_response_at_its_nodes(kinematics: str, domain: str) -> None:
    design = Design.column(PROBLEM.replace(kinematics=kinematics))
    response = load_displacement(design, [-5.0, 5.0], domain, threads=1)
    for k, d in enumerate(response.d):
        mesh, _, u = design_fields(design, response, d)
        x, y = response.nodes_x
        for i, j in ((1, 1), (4, 7), (8, 8)):
            reached = response.nodes_u[k, :, i, j]
            assert np.array(u(mesh(x[i], y[j]))) == pytest.approx(reached, abs=1e-12)
            assert np.abs(reached).max() > 1e-3


def test_undeformed_without_a_response_and_at_zero() -> None:
    design = Design.column(PROBLEM)
    response = load_displacement(design, [5.0], threads=1)
    for fields in (design_fields(design), design_fields(design, response)):
        assert fields[2].vec.Norm() == 0.0


def test_a_state_that_is_not_there_is_named() -> None:
    design = Design.column(PROBLEM)
    response = load_displacement(design, [5.0], threads=1)
    with pytest.raises(NgspringError, match="no state at d = -3 mm"):
        design_fields(design, response, -3.0)
    with pytest.raises(NgspringError, match="no state at d = 5 mm"):
        design_fields(design, d=5.0)
    with pytest.raises(NgspringError, match="8 x 8 elements, the design on 12 x 12"):
        design_fields(design.with_problem(PROBLEM.replace(elements=12)), response, 5.0)
