"""Springs with holes and slits that close: the whole analysis, `contact_load_displacement`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import ngsolve as ng
import numpy as np
import pytest
from numpy.typing import NDArray
from support.contact_bodies import (
    block_with_hole,
    body_of,
    ellipse,
    rectangle,
    spring,
)

from ngspring.analysis.forward import load_displacement
from ngspring.fem.process import parallel
from ngspring.solid.contact.response import (
    ContactResponse,
    ContactSettings,
    contact_load_displacement,
    contact_mechanics,
)
from ngspring.solid.mesh.mesh_body import mesh_body


@pytest.fixture(scope="module")
def closing() -> ContactResponse:
    """A block whose flat elliptic hole closes on itself."""
    return contact_load_displacement(
        block_with_hole(6.0), [-20.0, -12.02, -12.0, -11.98, -4.0, 0.0], threads=1
    )


def test_a_hole_closes_and_the_force_rises_like_a_blocks(closing: ContactResponse) -> None:
    assert closing.complete, closing.message
    (start,) = closing.contact_starts
    assert -12.0 < start < -4.0
    assert (closing.contact_area[closing.d < start] > 0).all()
    assert (closing.contact_area[closing.d > start] == 0).all()
    assert closing.stiffness[0] > 2 * closing.stiffness[-1]


def test_where_contact_starts_may_be_left_at_the_step_and_no_force_changes(
    closing: ContactResponse,
) -> None:
    quick = contact_load_displacement(closing.body, [-12.0, -4.0], onset=math.inf, threads=1)
    (start,), (exact,) = quick.contact_starts, closing.contact_starts
    assert -12.0 < start < -4.0
    assert start != exact
    assert start == pytest.approx(exact, abs=4.0)
    np.testing.assert_allclose(quick.q, closing.q[np.isin(closing.d, quick.d)], rtol=1e-6)


def test_nothing_overlaps_by_more_than_micrometres(closing: ContactResponse) -> None:
    assert closing.smallest_gap.min() > -0.005


def test_forces_are_in_balance_and_agree_with_energy_and_stress(
    closing: ContactResponse,
) -> None:
    np.testing.assert_allclose(closing.q_bottom, closing.q, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(closing.q_stress, closing.q, rtol=1e-6, atol=1e-12)
    k = int(np.flatnonzero(closing.d == -12.0)[0])
    slope = (closing.energy[k + 1] - closing.energy[k - 1]) / 0.04
    assert slope == pytest.approx(closing.q[k], rel=1e-5)


@pytest.mark.long
def test_the_stress_on_the_loaded_side_converges_to_the_force_with_the_mesh() -> None:
    """Sections' averages agree on any mesh; the stress at a boundary is as good as the mesh."""
    errors = []
    for maxh in (12.0, 6.0, 3.0):
        response = contact_load_displacement(block_with_hole(maxh), [-4.0, -16.0], threads=1)
        np.testing.assert_allclose(response.q_stress, response.q, rtol=1e-10)
        errors.append(abs(response.q_side / response.q - 1).max())
    assert errors[2] < errors[1] / 4 < errors[0] / 16
    assert errors[2] < 1e-4


@pytest.mark.parametrize("changes", [{"stiffness": 1e4}, {"stiffness": 2.5e5}, {"points": 9}])
def test_the_force_does_not_depend_on_numerical_parameters(
    closing: ContactResponse, changes: dict[str, float]
) -> None:
    settings = dataclasses.replace(ContactSettings(), **changes)  # type: ignore[arg-type]
    other = contact_load_displacement(closing.body, [-20.0, -12.0], settings=settings, threads=1)
    assert other.complete, other.message
    reference = closing.q[np.isin(closing.d, other.d)]
    np.testing.assert_allclose(other.q, reference, rtol=2e-3)


def bowed_columns(place: float) -> Callable[..., NDArray[np.float64]]:
    """Two columns 12 mm thick that bow apart, mirror images at x = 50."""

    def chi(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        centre = place - 6.0 * np.sin(np.pi * y / 100.0)
        return np.asarray(2.0 * (6.0 - np.abs(np.minimum(x, 100.0 - x) - centre)))

    return chi


@pytest.mark.long
def test_columns_that_slide_go_on_where_their_corners_meet() -> None:
    """Nothing holds them sideways: contact moves them apart without force, and q is that of one
    column alone, from the touch at about -3 mm for columns that begin 2 mm nearer on.
    """
    problem = spring().replace(elements=20, l_i=4.0)
    d = [-3.0, -4.0, -12.0, -20.0]
    near, far = (
        contact_load_displacement(mesh_body(bowed_columns(x), problem), d, threads=1)
        for x in (40.0, 20.0)
    )
    assert near.complete, near.message
    assert len(near.contact_starts) == 1
    assert -4.0 < near.contact_starts[0] < -3.0
    assert far.contact_starts == ()
    touching = near.d < -3.5
    assert (np.abs(near.smallest_gap[touching]) < 1e-5).all()
    # On the mirror line, which nothing passes.
    assert near.surface[touching][:, :, 0].max() == pytest.approx(50.0, abs=1e-5)
    assert (near.pressure * near.contact_area[:, None]).max() < 1e-6
    np.testing.assert_allclose(near.q, far.q, rtol=1e-8)


def hole(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """A full square with a flat elliptic hole in its middle."""
    return ((x - 50) / 30) ** 2 + ((y - 50) / 4) ** 2 - 1


@pytest.mark.slow
@pytest.mark.parametrize("max_size", [8.0, 12.0])
def test_mirror_planes_of_the_quarter_are_self_contact_of_the_full_body(max_size: float) -> None:
    """From onset to a stretch of 3/4, the full body's contact of free surfaces with each other.

    Soon after onset the fold at each tip of the hole, symmetric on the quarter, leans to one side
    on the full body, which has less energy: there q differs by a little less than 1e-4.
    """
    d = [-4.0, -6.0, -10.0, -14.0, -25.0]
    responses = [
        contact_load_displacement(
            mesh_body(hole, spring(), domain=domain, elements_across=2, max_size=max_size),
            d,
            threads=1,
        )
        for domain in ("quarter", "full")
    ]
    quarter, full = responses
    assert quarter.complete, quarter.message
    assert full.complete, full.message
    closed = full.d <= -10.0
    assert (quarter.contact_area[closed] > 60.0).all()
    np.testing.assert_allclose(full.q, quarter.q, rtol=1e-4)
    np.testing.assert_allclose(full.q[closed], quarter.q[closed], rtol=1e-6)
    np.testing.assert_allclose(full.q[-1], quarter.q[-1], rtol=1e-12)
    np.testing.assert_allclose(full.contact_area[closed], quarter.contact_area[closed], rtol=1e-3)
    assert (full.energy < quarter.energy * (1 + 1e-12)).all()
    np.testing.assert_allclose(full.q_bottom, full.q, rtol=1e-8)
    np.testing.assert_allclose(full.q_stress, full.q, rtol=1e-6)


def test_a_closed_slit_is_as_stiff_as_a_block() -> None:
    """A slit 1 mm high across the middle: after 1 mm its faces carry the load of a full block."""
    problem = spring()
    slit = rectangle(10, 49.5, 40, 0.5)
    response = contact_load_displacement(
        body_of(rectangle(0, 0, 50, 50) - slit, 6.0, problem), [-6.0], threads=1
    )
    # The block is analysed with the other code of this package, all solid.
    block = load_displacement(ng.CF(20.0), [-6.0], problem=problem.replace(elements=8), threads=1)
    assert response.complete, response.message
    assert response.contact_area[0] == pytest.approx(80.0, rel=0.1)
    assert response.stiffness[0] == pytest.approx(block.stiffness[0], rel=0.1)
    assert abs(response.q[0]) < abs(block.q[0])


def test_an_axisymmetric_cavity_closes() -> None:
    response = contact_load_displacement(
        block_with_hole(6.0, kinematics="axisymmetric"), [-16.0, -4.0], threads=1
    )
    assert response.complete, response.message
    assert response.contact_area[0] > 100.0
    np.testing.assert_allclose(response.q_bottom, response.q, rtol=1e-8)
    np.testing.assert_allclose(response.q_stress, response.q, rtol=1e-6)
    assert response.smallest_gap.min() > -0.02


def test_a_surface_that_meets_the_axis_grows_there_as_beside_it() -> None:
    """On the axis r / R is 0 / 0, or rounding over rounding."""
    body = block_with_hole(6.0, kinematics="axisymmetric")
    with parallel(1) as threads:
        mechanics, _ = contact_mechanics(body, ContactSettings(), threads)
    contact = mechanics.contact
    centre = np.array([body.problem.L / 2, body.problem.H / 2])
    slopes = contact.surface.slopes_at(contact.surface.rest, contact.s).reshape(-1, 2)
    radius = body.problem.L / 2 - contact.rest[:, 0]
    assert np.abs(radius).min() < 1e-9
    growth = contact.growth(
        1.5 * slopes, slopes, centre + 1.5 * (contact.rest - centre), contact.rest
    )
    np.testing.assert_allclose(growth, 1.5**2, rtol=1e-9)


def test_a_notch_in_the_left_side_closes_on_the_moving_mirror_line() -> None:
    """Half a hole at the side: u_Lx is free, and the plane x = u_Lx goes with it."""
    shape = rectangle(0, 0, 50, 50) - ellipse(0, 50, 25, 4)
    response = contact_load_displacement(body_of(shape, 6.0, spring()), [-14.0], threads=1)
    assert response.complete, response.message
    assert response.contact_area[0] > 10.0
    np.testing.assert_allclose(response.q_stress, response.q, rtol=1e-6)


def test_in_tension_a_hole_opens_without_contact() -> None:
    response = contact_load_displacement(block_with_hole(8.0), [20.0], threads=1)
    assert response.complete, response.message
    assert response.contact_starts == ()
    assert response.pressure.max() == 0.0
    assert response.largest_stretch[0] > 1.2
