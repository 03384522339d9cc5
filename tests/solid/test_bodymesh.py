"""Body-fitted meshes: the solid's area, its symmetry, its boundary's names, and good elements."""

from __future__ import annotations

import time

import ngsolve as ng
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, label

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import OutlineError, ProblemError
from ngspring.design.design import Design
from ngspring.design.gallery import gallery
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.solid.mesh.body import Body
from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.solid.mesh.quality import MeshQuality
from ngspring.solid.mesh.triangles import NAMES, TriangleMesh
from ngspring.solid.outline.levelset import ChiFunction
from ngspring.solid.sides import SURFACE

PLANE = SpringProblem((ControlPoint(-10, -2),), elements=40)
ROUND = PLANE.replace(kinematics="axisymmetric")
DESIGNS = ("C4", "C7", "C7-random")


def wave(y: FloatArray) -> FloatArray:
    return np.cos(2 * np.pi * y / 100)


def column(x: FloatArray, y: FloatArray) -> FloatArray:
    return 10 - np.abs(x - 50) + 0 * y


def slotted(x: FloatArray, y: FloatArray) -> FloatArray:
    """A column with an elliptic slit of 20 mm x 0.2 mm."""
    return np.minimum(column(x, y), np.hypot((x - 50) / 5, (y - 50) / 0.1) - 1)


def necked(x: FloatArray, y: FloatArray) -> FloatArray:
    """A column with a neck of 1 mm."""
    return 10 - 9.5 * np.exp(-(((y - 50) / 8) ** 2)) - np.abs(x - 50)


def half_columns(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.abs(x - 50) - 40 + 2 * wave(y)


def tube(x: FloatArray, y: FloatArray) -> FloatArray:
    return 6 - np.abs(np.abs(x - 50) - 30 - 5 * wave(y))


def ring(x: FloatArray, y: FloatArray) -> FloatArray:
    return 6 - np.abs(np.hypot(x - 50, y - 50) - 46)


def curved_slits(x: FloatArray, y: FloatArray) -> FloatArray:
    """A column with two slits of 0.05 mm along arcs of radius 10 mm."""
    arc = np.abs(np.hypot(x - 50, y - 50) - 10) - 0.025
    return np.minimum(25 - np.abs(x - 50), np.maximum(arc, 6 - np.abs(x - 50)))


def leaning(x: FloatArray, y: FloatArray) -> FloatArray:
    return 10 - np.abs(x - 40 - 0.1 * y)


def stepped(x: FloatArray, y: FloatArray) -> FloatArray:
    """A block on a narrower column: corners inwards and outwards."""
    return np.maximum(np.minimum(20 - abs(x - 50), 30 - abs(y - 50)), 5 - abs(x - 50))


def quality(body: Body) -> MeshQuality:
    assert body.quality is not None
    return body.quality


def arrays(body: Body) -> TriangleMesh:
    assert body.triangles is not None
    return body.triangles


@pytest.fixture(scope="module")
def quarters() -> dict[str, Body]:
    return {name: mesh_body(gallery[name]) for name in DESIGNS}


@pytest.fixture(scope="module")
def wholes() -> dict[str, Body]:
    return {name: mesh_body(gallery[name], domain="full") for name in DESIGNS}


# -- stored designs --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DESIGNS)
@pytest.mark.parametrize("whole", [False, True])
def test_mesh_of_a_design(
    quarters: dict[str, Body], wholes: dict[str, Body], name: str, whole: bool
) -> None:
    body = (wholes if whole else quarters)[name]
    measured = quality(body)
    assert abs(measured.area_error) < 2e-5
    assert measured.elements_across >= 4
    assert measured.smallest_angle > 20
    assert measured.smallest_jacobian > 0.5
    assert ng.Integrate(1, body.mesh) == pytest.approx(measured.area, rel=1e-12)
    assert body.problem.domain == ("full" if whole else "quarter")
    # The design's own smeared volume is within the width of its interfaces.
    volume = gallery[name].volume / gallery[name].problem.T / (1 if whole else 4)
    assert measured.area == pytest.approx(volume, rel=0.01)


def test_names_of_the_boundary(quarters: dict[str, Body], wholes: dict[str, Body]) -> None:
    assert set(quarters["C7"].mesh.GetBoundaries()) == {"bottom", "right", "top", SURFACE}
    assert set(wholes["C7"].mesh.GetBoundaries()) == {"bottom", "top", SURFACE}
    # Solid at the left and right sides, void in the middle.
    assert set(quarters["C7-random"].mesh.GetBoundaries()) == {"bottom", "left", "top", SURFACE}
    sides = {"bottom", "left", "right", "top", SURFACE}
    assert set(wholes["C7-random"].mesh.GetBoundaries()) == sides


@pytest.mark.parametrize("name", DESIGNS)
def test_boundary_pieces_lie_where_their_names_say(wholes: dict[str, Body], name: str) -> None:
    body, design = wholes[name], gallery[name]
    mesh = arrays(body)
    for k, place in enumerate(NAMES):
        points = mesh.points[np.unique(mesh.segments[mesh.names == k])]
        if place == SURFACE:
            x, y = points.T
            slope = np.hypot(design.chi(x, y, (1, 0)), design.chi(x, y, (0, 1)))
            assert np.abs(design.chi(x, y) / slope).max() < 1e-10
        elif points.size:
            axis, value = {"left": (0, 0), "right": (0, 100), "bottom": (1, 0), "top": (1, 100)}[
                place
            ]
            assert (points[:, axis] == value).all()


@pytest.mark.parametrize("name", DESIGNS)
def test_the_full_mesh_is_exactly_symmetric(wholes: dict[str, Body], name: str) -> None:
    mesh = arrays(wholes[name])
    own = {tuple(point): k for k, point in enumerate(mesh.points.tolist())}
    elements = {tuple(sorted(t)) for t in mesh.triangles.tolist()}
    edges = {(*sorted(s[:2]), s[2]) for s in mesh.segments.tolist()}
    lower_left = (mesh.points <= 50).all(axis=1)
    for axis in (0, 1):
        image = mesh.points[lower_left].copy()
        image[:, axis] = 100 - image[:, axis]
        number = dict(
            zip(np.flatnonzero(lower_left), [own[tuple(p)] for p in image.tolist()], strict=True)
        )
        inside = [t for t in mesh.triangles.tolist() if all(k in number for k in t)]
        assert 4 * len(inside) == len(mesh.triangles)
        assert all(tuple(sorted(number[k] for k in t)) in elements for t in inside)
        rim = [s for s in mesh.segments.tolist() if all(k in number for k in s)]
        assert all((*sorted((number[a], number[b])), number[m]) in edges for a, b, m in rim)


def test_the_normal_points_out_of_the_solid(wholes: dict[str, Body]) -> None:
    """Gauss's theorem holds on the curved mesh: its boundary is curved like its elements."""
    mesh = wholes["C7"].mesh
    flux = ng.Integrate(ng.specialcf.normal(2) * ng.CF((ng.x, ng.y)) / 2, mesh, ng.BND, order=6)
    assert flux == pytest.approx(ng.Integrate(1, mesh), rel=1e-12)


def test_nodes_of_the_arrays_are_those_of_the_mesh(quarters: dict[str, Body]) -> None:
    body = quarters["C7"]
    mesh = arrays(body)
    assert body.mesh.nv == mesh.vertices
    assert body.mesh.ne == len(mesh.triangles)
    assert np.allclose([v.point for v in body.mesh.vertices], mesh.points[: mesh.vertices], atol=0)
    length = ng.Integrate(1, body.mesh, ng.BND, definedon=body.mesh.Boundaries(SURFACE), order=10)
    a, b, m = (
        mesh.points[mesh.segments[mesh.names == NAMES.index(SURFACE)][:, k]] for k in range(3)
    )
    t = np.linspace(0, 1, 41)[:, None, None]
    arcs = a * (1 - t) * (1 - 2 * t) + 4 * m * t * (1 - t) + b * t * (2 * t - 1)
    polygon = np.linalg.norm(np.diff(arcs, axis=0), axis=2).sum()
    assert length == pytest.approx(polygon, rel=1e-4)


def test_offset_surfaces_follow_the_level() -> None:
    """Moved by 0.25 mm, the surface lies about 0.25 mm away where chi has its steepest slope."""
    design = gallery["C7"]
    areas = [quality(mesh_body(design, level=level)).area for level in (2.0, 0.0, -2.0)]
    assert areas[0] < areas[1] < areas[2]
    body = mesh_body(design, level=-2.0)
    assert body.level == -2.0
    mesh = arrays(body)
    x, y = mesh.points[np.unique(mesh.segments[mesh.names == NAMES.index(SURFACE)])].T
    assert np.abs(design.chi(x, y) + 2.0).max() < 1e-8


def test_meshing_is_quick() -> None:
    design = gallery["C7"]
    start = time.process_time()
    mesh_body(design, domain="full")
    assert time.process_time() - start < 4.0


def test_smaller_elements_on_request() -> None:
    design = gallery["C7"]
    coarse, fine = mesh_body(design), mesh_body(design, max_size=0.5, angle=0.1)
    assert quality(fine).elements > 4 * quality(coarse).elements
    # Netgen keeps to the size on the average: a few edges in ten thousand are half as long again,
    # and which ones changes with the tenth digit of the design.
    triangles = arrays(fine)
    corners = triangles.points[triangles.triangles[:, :3]]
    edges = np.linalg.norm(corners[:, [1, 2, 0]] - corners, axis=2)
    assert np.median(edges) < 0.51
    assert np.quantile(edges, 0.999) < 0.75
    assert quality(fine).largest_edge == pytest.approx(edges.max())
    assert quality(fine).largest_edge < 1.0
    assert abs(quality(fine).area_error) < 1e-7
    assert quality(mesh_body(design, elements_across=8)).elements_across >= 8


# -- known shapes ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("chi", "problem", "area", "rel"),
    [
        (column, PLANE, 2000.0, 1e-9),
        (stepped, PLANE, 2800.0, 1e-6),
        (slotted, PLANE, 2000.0 - 0.5 * np.pi, 1e-6),
        (necked, PLANE, 2000 - 2 * 9.5 * 8 * np.sqrt(np.pi), 1e-6),
        (half_columns, PLANE, 2000.0, 1e-6),
        (tube, ROUND, 1200.0, 1e-6),
        (leaning, PLANE, 2000.0, 1e-6),
        # Four arcs of a ring beyond |x - 50| = 6 take 0.05 mm times their length.
        (curved_slits, PLANE, 5000 - 4 * 0.05 * 10 * np.arccos(0.6), 1e-6),
    ],
)
def test_area_and_walls_of_known_shapes(
    chi: ChiFunction, problem: SpringProblem, area: float, rel: float
) -> None:
    body = mesh_body(chi, problem, domain="full")
    measured = quality(body)
    assert ng.Integrate(1, body.mesh) == pytest.approx(area, rel=rel)
    assert abs(measured.area_error) < 1e-6
    assert measured.elements_across >= 4
    assert measured.smallest_angle > 20
    assert measured.smallest_jacobian > 0.5


def test_the_thinnest_wall_is_measured() -> None:
    assert quality(mesh_body(necked, PLANE)).thinnest_wall == pytest.approx(1.0, rel=1e-3)
    assert quality(mesh_body(column, PLANE)).thinnest_wall == pytest.approx(20.0, rel=1e-6)
    assert quality(mesh_body(ring, PLANE)).thinnest_wall <= 12.0


def test_the_narrowest_gap_is_measured() -> None:
    def two_columns(x: FloatArray, y: FloatArray) -> FloatArray:
        """Walls of 15 mm, 7 mm apart, joined at both ends."""
        between = 3.5 - np.abs(x - 50.0)
        ends = np.abs(y - 50.0) - 30.0
        outside = np.abs(x - 50.0) - 18.5
        return np.minimum(np.maximum(-between, ends), -outside)

    assert quality(mesh_body(two_columns, PLANE)).narrowest_gap == pytest.approx(7.0, rel=1e-3)
    assert np.isinf(quality(mesh_body(column, PLANE)).narrowest_gap)


def test_the_hollow_beside_a_shallow_neck_is_no_gap() -> None:
    """The disc that would touch both shoulders is metres wide."""

    def neck(x: FloatArray, y: FloatArray) -> FloatArray:
        return 10 + 15 * (1 - np.cos((y - 50) / 50 * np.pi)) - np.abs(x - 50)

    assert np.isinf(quality(mesh_body(neck, PLANE)).narrowest_gap)


def test_an_asymmetric_function_is_meshed_in_the_full_domain() -> None:
    body = mesh_body(leaning, PLANE)
    assert body.problem.domain == "full"
    assert set(body.mesh.GetBoundaries()) == {"bottom", "top", SURFACE}


def test_an_axisymmetric_tube_has_no_axis() -> None:
    quarter, whole = mesh_body(tube, ROUND), mesh_body(tube, ROUND, domain="full")
    assert set(quarter.mesh.GetBoundaries()) == {"bottom", "top", SURFACE}
    assert arrays(whole).points[:, 0].max() < 50
    assert arrays(whole).points[:, 1].max() == 100
    solid = mesh_body(column, ROUND, domain="full")
    assert set(solid.mesh.GetBoundaries()) == {"bottom", "right", "top", SURFACE}
    assert arrays(solid).points[:, 0].max() == 50
    volume = ng.Integrate(2 * np.pi * (50 - ng.x), solid.mesh)
    assert volume == pytest.approx(np.pi * 100 * 100, rel=1e-9)


def test_a_solid_in_the_corners_of_the_domain_has_sharp_corners() -> None:
    body = mesh_body(half_columns, PLANE)
    points = {tuple(p) for p in arrays(body).points.tolist()}
    assert {(0.0, 0.0), (0.0, 50.0)} <= points
    ringed = mesh_body(ring, PLANE, domain="full")
    assert set(ringed.mesh.GetBoundaries()) == {"bottom", "left", "right", "top", SURFACE}


def test_a_slit_of_a_fifth_of_a_millimetre_stays_open() -> None:
    mesh = arrays(mesh_body(slotted, PLANE, domain="full"))
    on_surface = mesh.points[np.unique(mesh.segments[mesh.names == NAMES.index(SURFACE)])]
    inside = on_surface[np.abs(on_surface - 50).max(axis=1) < 5.1]
    assert np.ptp(inside[:, 1]) == pytest.approx(0.2, rel=1e-6)
    assert np.ptp(inside[:, 0]) == pytest.approx(10, rel=1e-6)


@pytest.mark.long
@settings(max_examples=8, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10**6),
    domain=st.sampled_from(["quarter", "full"]),
    problem=st.sampled_from([PLANE, ROUND]),
)
def test_random_solids(seed: int, domain: str, problem: SpringProblem) -> None:
    """Whatever the shape: the area is right, no element is turned inside out."""
    random = np.random.default_rng(seed)
    problem = problem.replace(elements=12, l_i=3.0, L=80.0)
    noise = gaussian_filter(random.normal(size=problem.coefficient_shape), 1.0)
    design = Design(problem, 60 * noise + 10)
    body = meshed_if_connected(design, domain)
    if body is None:
        return
    assert abs(quality(body).area_error) < 1e-4
    assert quality(body).smallest_jacobian > 0
    assert ng.Integrate(1, body.mesh) == pytest.approx(quality(body).area, rel=1e-10)


def meshed_if_connected(design: Design, domain: str) -> Body | None:
    """None for a solid that pixels, too, show to be full or not joined to bottom and top."""
    try:
        return mesh_body(design, domain=domain)
    except OutlineError:
        x = np.linspace(0, design.problem.L / 2, 401)[:, None]
        parts, _ = label(design.chi(x, np.linspace(0, design.problem.H / 2, 401)[None, :]) > 0)
        joined = set(parts[:, 0]) & set(parts[:, -1]) - {0}
        if joined and not (parts > 0).all():
            raise
        return None


# -- wrong input -----------------------------------------------------------------------------------


def test_wrong_arguments() -> None:
    design = gallery["C4"]
    with pytest.raises(ProblemError, match=r"elements_across = 2\.5"):
        mesh_body(design, elements_across=2.5)  # type: ignore[arg-type]
    with pytest.raises(ProblemError, match="elements_across = 0"):
        mesh_body(design, elements_across=0)
    with pytest.raises(ProblemError, match="max_size = -1"):
        mesh_body(design, max_size=-1)
    with pytest.raises(ProblemError, match="must not exceed"):
        mesh_body(design, min_size=3.0, max_size=2.0)
    with pytest.raises(ProblemError, match="neither a Design nor a function"):
        mesh_body(3.0, PLANE)  # type: ignore[arg-type]
    with pytest.raises(OutlineError, match="grey"):
        mesh_body(Design.column(PLANE))
    with pytest.raises(OutlineError, match="not symmetric"):
        mesh_body(leaning, PLANE, domain="quarter")
