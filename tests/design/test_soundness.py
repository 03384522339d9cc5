"""A design is a part if black material joins its ends and carries the load."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest

from ngspring.analysis.forward import load_displacement
from ngspring.design.design import Design
from ngspring.design.gallery import gallery
from ngspring.design.soundness import LARGEST_SHARE, flaw, neck_density
from ngspring.kkt.stationarity import optimality
from ngspring.physics.grey import grey_share
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import scaled
from ngspring.problem.spring import SpringProblem

PROBLEM = SpringProblem((ControlPoint(-1.0, -1.0),), elements=32)


def column(density: float, problem: SpringProblem = PROBLEM) -> Design:
    """A black column in the void, whose middle quarter has this density."""
    middle = np.log(density / (1 - density))

    def chi(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        black = np.where(abs(y / problem.H - 0.5) < 0.125, middle, 9.0)
        return np.where(abs(x / problem.L - 0.5) < 0.25, black, -9.0)

    return Design.from_function(problem, chi)


@pytest.mark.parametrize("density", [0.2, 0.5, 0.7, 0.95])
@pytest.mark.parametrize("length", [1e-5, 1.0, 1e4])
def test_the_neck_is_as_dense_as_the_material_all_ways_lead_through(
    density: float, length: float
) -> None:
    design = column(density, scaled(PROBLEM, length=length))
    assert neck_density(design) == pytest.approx(density, abs=2e-4)


def test_a_black_column_is_a_part_and_one_with_a_gap_is_not_connected() -> None:
    assert flaw(column(0.999)) == ""
    assert "not connected" in flaw(column(0.001))
    assert "a density of 0.70 or less" in flaw(column(0.7))


def test_what_joins_corner_to_corner_only_does_not_hold() -> None:
    def chi(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        x, y = np.minimum(x, 100.0 - x), np.minimum(y, 100.0 - y)
        return np.where((x > 25.0) == (y > 25.0), 9.0, -9.0)

    assert neck_density(Design.from_function(PROBLEM, chi)) == pytest.approx(0.5, abs=0.01)


def test_a_part_whose_energy_is_in_grey_carries_its_load_through_grey() -> None:
    points = (ControlPoint(-1.0, -1.0), ControlPoint(2.0, 1.0), ControlPoint(2.0, 1.0, eta=1.0))
    design = column(0.999, PROBLEM.replace(control_points=points))
    assert flaw(design, (0.1, LARGEST_SHARE)) == ""
    assert "45% of the strain energy at d = 2 mm" in flaw(design, (0.1, 0.45))


def test_the_share_of_grey_in_a_uniform_stretch_is_that_of_its_energy() -> None:
    """Half of the area with density 1/2, whose stiffness is 1/(2 + p), half solid."""
    p = PROBLEM.p
    mesh = ng.Mesh(ng.unit_square.GenerateMesh(maxh=0.25))
    u = ng.GridFunction(ng.VectorH1(mesh, order=2))
    u.Set(ng.CF((0.0, 0.1 * ng.y)))
    # Piecewise constant by element: two materials in exactly known areas.
    pieces = ng.GridFunction(ng.L2(mesh, order=0))
    grey = np.arange(mesh.ne) % 2 == 0
    pieces.vec.FV().NumPy()[:] = np.where(grey, 0.0, 50.0)
    areas = ng.Integrate(ng.CF(1.0), mesh, element_wise=True).NumPy()
    soft, solid = areas[grey].sum() / (2 + p), areas[~grey].sum()
    found = grey_share(pieces, u, mesh, PROBLEM)
    assert found == pytest.approx(soft / (soft + solid), rel=1e-4)


def test_shares_are_the_same_by_both_ways_to_them() -> None:
    points = (ControlPoint(8.0, 1.0), ControlPoint(-8.0, -1.0))
    design = Design.column(PROBLEM.replace(control_points=points, elements=16, l_i=5.0))
    check = optimality(design, threads=1)
    assert 0.1 < min(check.grey) < max(check.grey) < 1.0
    response = load_displacement(design, [8.0, -8.0], threads=1)
    assert response.grey == pytest.approx(check.grey, rel=1e-6)


def test_the_grey_neck_of_t1_without_its_dilated_point_is_seen() -> None:
    assert "through grey" in flaw(gallery["T1-not-robust"])
    assert flaw(gallery["T1"]) == ""
