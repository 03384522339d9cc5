"""Displacements satisfy the boundary conditions of 2.5 whatever the unknowns are."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest

from ngspring.analysis.forward import nodal_values
from ngspring.basics.arrays import FloatArray
from ngspring.fem.constraints import DisplacementExtraction, displacement_extraction, stretched
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem


@pytest.fixture
def scalar(coarse: SpringProblem) -> ScalarSpace:
    return ScalarSpace(Grid(coarse))


@pytest.fixture
def extraction(scalar: ScalarSpace) -> DisplacementExtraction:
    return displacement_extraction(scalar)


@pytest.fixture
def v(extraction: DisplacementExtraction, random: np.random.Generator) -> FloatArray:
    """Independent displacements, u_Ty last."""
    return random.uniform(-1, 1, extraction.free + 1)


class Sides:
    """u_x and u_y along the sides of the mesh, read from the NGSolve field."""

    def __init__(self, scalar: ScalarSpace, dofs: FloatArray) -> None:
        self.mesh = scalar.grid.mesh
        self.u = ng.GridFunction(ng.VectorH1(self.mesh, order=2))
        self.u.vec.FV().NumPy()[:] = dofs
        self.width, self.height = scalar.grid.size
        self.along = np.linspace(0, 1, 41)

    def at(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        values = np.asarray(self.u(self.mesh(x, y)))
        return values[:, 0], values[:, 1]

    def vertical(self, x: float) -> tuple[FloatArray, FloatArray]:
        return self.at(np.full(41, x), self.height * self.along)

    def horizontal(self, y: float) -> tuple[FloatArray, FloatArray]:
        return self.at(self.width * self.along, np.full(41, y))


def close(value: FloatArray, expected: FloatArray | float) -> None:
    np.testing.assert_allclose(value, np.broadcast_to(expected, value.shape), rtol=0, atol=1e-13)


def test_the_mesh_is_the_analysed_part_of_the_domain(coarse: SpringProblem) -> None:
    grid = Grid(coarse)
    half_width = coarse.sector.half_height or coarse.motion.axis
    assert grid.size == (45.0 if half_width else 90.0, 55.0 if coarse.sector.half_height else 110.0)
    assert grid.mesh.ne == grid.cells[0] * grid.cells[1]
    area = float(ng.Integrate(ng.CF(1.0), grid.mesh))
    assert area == pytest.approx(grid.size[0] * grid.size[1], rel=1e-13)
    copies = {
        ("plane strain", "quarter"): 4,
        ("plane strain", "full"): 1,
        ("axisymmetric", "quarter"): 2,
        ("axisymmetric", "full"): 1,
    }
    assert grid.sector.copies == copies[coarse.kinematics, coarse.domain]


def test_boundary_conditions_hold_on_all_sides(
    coarse: SpringProblem, scalar: ScalarSpace, extraction: DisplacementExtraction, v: FloatArray
) -> None:
    sides = Sides(scalar, extraction.matrix @ v)
    u_ty = v[-1]
    left_x, left_y = sides.vertical(0.0)
    right_x, right_y = sides.vertical(sides.width)
    bottom_x, bottom_y = sides.horizontal(0.0)
    top_x, top_y = sides.horizontal(sides.height)
    u_lx = left_x[0]
    assert u_lx != 0.0
    close(left_x, u_lx)
    close(bottom_y, 0.0)
    close(top_y, u_ty / 2 if coarse.sector.half_height else u_ty)
    if coarse.sector.half_height or coarse.motion.axis:
        close(right_x, 0.0)
    else:
        close(right_x, -u_lx)
        close(right_y, left_y)
    if not coarse.sector.half_height:
        close(top_x, bottom_x)
    # Nothing else is tied: u_y on the sides and u_x on bottom and top vary.
    for free in (left_y, right_y, bottom_x, top_x):
        assert np.abs(free - free.mean()).max() > 0.1


def test_no_more_displacements_are_tied_than_the_paper_says(
    coarse: SpringProblem, extraction: DisplacementExtraction
) -> None:
    nx, ny = Grid(coarse).cells
    m_x, m_y = 2 * nx + 1, 2 * ny + 1
    # u_x: the inner columns (top like bottom in the full domain) and u_Lx.
    u_x = (m_x - 2) * (m_y if coarse.sector.half_height else m_y - 1) + 1
    # u_y: the inner rows, right like left in the full plane strain domain.
    tied = not coarse.sector.half_height and not coarse.motion.axis
    u_y = (m_y - 2) * (m_x - 1 if tied else m_x)
    assert extraction.free == u_x + u_y


def test_restriction_is_the_inverse(extraction: DisplacementExtraction, v: FloatArray) -> None:
    np.testing.assert_array_equal(extraction.restrict(extraction.matrix @ v), v)


def test_a_symmetric_field_of_the_full_domain_is_a_field_of_the_quarter(
    kinematics: str, random: np.random.Generator
) -> None:
    problem = SpringProblem((ControlPoint(9.0, 1.5),), kinematics=kinematics, elements=6)
    quarter = ScalarSpace(Grid(problem))
    full = ScalarSpace(Grid(problem.replace(domain="full")))
    part = displacement_extraction(quarter)
    whole = displacement_extraction(full)
    v = random.uniform(-1, 1, part.free + 1)
    small = np.stack([nodal_values(quarter, c) for c in (part.matrix @ v).reshape(2, -1)])
    # Mirror about y = H/2: u_x is even, u_y - u_Ty / 2 is odd; about x = L/2: u_x odd, u_y even.
    upper = small[:, :, -2::-1] * np.array([1, -1])[:, None, None]
    upper[1] += v[-1]
    nodal = np.concatenate([small, upper], axis=2)
    if kinematics == "plane strain":
        right = nodal[:, -2::-1] * np.array([-1, 1])[:, None, None]
        nodal = np.concatenate([nodal, right], axis=1)
    mirrored = np.concatenate([hierarchical(full, c) for c in nodal])
    back = whole.matrix @ whole.restrict(mirrored)
    np.testing.assert_allclose(back, mirrored, rtol=0, atol=1e-12)


def hierarchical(scalar: ScalarSpace, nodal: FloatArray) -> FloatArray:
    """Dofs of the H1 space with given values at vertices, edge middles and cell centres."""
    bubble = nodal.copy()
    bubble[1::2, ::2] -= (nodal[:-1:2, ::2] + nodal[2::2, ::2]) / 2
    bubble[::2, 1::2] -= (nodal[::2, :-1:2] + nodal[::2, 2::2]) / 2
    in_x = nodal[:-1:2, 1::2] + nodal[2::2, 1::2]
    in_y = nodal[1::2, :-1:2] + nodal[1::2, 2::2]
    corners = nodal[:-1:2, :-1:2] + nodal[2::2, :-1:2] + nodal[:-1:2, 2::2] + nodal[2::2, 2::2]
    bubble[1::2, 1::2] -= in_x / 2 + in_y / 2 - corners / 4
    return bubble[scalar.node[:, 0], scalar.node[:, 1]] / scalar.bubble_value


def test_nodal_values_are_the_values_of_the_field(
    scalar: ScalarSpace, random: np.random.Generator
) -> None:
    u = ng.GridFunction(scalar.space)
    dofs = random.uniform(-1, 1, scalar.ndof)
    u.vec.FV().NumPy()[:] = dofs
    nx, ny = scalar.grid.cells
    width, height = scalar.grid.size
    x, y = np.meshgrid(
        np.linspace(0, width, 2 * nx + 1), np.linspace(0, height, 2 * ny + 1), indexing="ij"
    )
    expected = np.asarray(u(scalar.grid.mesh(x.ravel(), y.ravel()))).reshape(x.shape)
    nodal = nodal_values(scalar, dofs)
    np.testing.assert_allclose(nodal, expected, rtol=0, atol=1e-13)
    np.testing.assert_allclose(hierarchical(scalar, nodal), dofs, rtol=0, atol=1e-12)


def test_every_bubble_has_the_stated_height(scalar: ScalarSpace) -> None:
    u = ng.GridFunction(scalar.space)
    width, height = scalar.grid.size
    nx, ny = scalar.grid.cells
    for dof in range(0, scalar.ndof, 7):
        u.vec[:] = 0.0
        u.vec[dof] = 1.0
        i, j = scalar.node[dof]
        value = u(scalar.grid.mesh(width * i / (2 * nx), height * j / (2 * ny)))
        assert value == pytest.approx(scalar.bubble_value[dof], rel=1e-13)


def test_uniform_stretch_is_u_y_equal_to_y_over_H(
    coarse: SpringProblem, scalar: ScalarSpace, extraction: DisplacementExtraction
) -> None:
    dofs = stretched(scalar)
    sides = Sides(scalar, dofs)
    x, y = np.linspace(0, sides.width, 41), np.linspace(0, sides.height, 41)[::-1]
    u_x, u_y = sides.at(x, y)
    close(u_x, 0.0)
    close(u_y, y / coarse.H)
    unknowns = extraction.restrict(dofs)
    assert unknowns[-1] == pytest.approx(1.0)
    np.testing.assert_allclose(extraction.matrix @ unknowns, dofs, rtol=0, atol=1e-15)
