"""Contours of the spline: where they are, how many there are, and what bounds the solid."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from matplotlib.path import Path
from scipy.ndimage import gaussian_filter

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import OutlineError, ProblemError
from ngspring.design.design import Design
from ngspring.design.gallery import gallery
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.solid.outline.contour import solid_area, trace
from ngspring.solid.outline.curve import Curve
from ngspring.solid.outline.levelset import ChiFunction, LevelSet, is_symmetric, level_set
from ngspring.solid.outline.outline import Loop, Outline, Piece, _parts, area_inside, outline
from ngspring.solid.sides import SURFACE

PLANE = SpringProblem((ControlPoint(-10, -2),), elements=40)
ROUND = PLANE.replace(kinematics="axisymmetric")


def disc(x: FloatArray, y: FloatArray) -> FloatArray:
    return 20 - np.hypot(x - 50, y - 50)


def column(x: FloatArray, y: FloatArray) -> FloatArray:
    return 10 - np.abs(x - 50) + 0 * y


def lengths(curves: list[Curve]) -> list[float]:
    return sorted(curve.length for curve in curves)


# -- where the curves are --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["C4", "C7", "C7-random"])
@pytest.mark.parametrize("domain", ["quarter", "full"])
def test_points_of_a_design_lie_on_the_contour(name: str, domain: str) -> None:
    design = gallery[name]
    for curve in trace(level_set(design, domain=domain)):
        x, y = curve.points.T
        slope = np.hypot(design.chi(x, y, (1, 0)), design.chi(x, y, (0, 1)))
        assert np.abs(design.chi(x, y) / slope).max() < 1e-10
        assert curve.corners.size == 0


def test_an_open_curve_ends_on_the_sides() -> None:
    design = gallery["C7-random"]
    outer, slit = sorted(trace(level_set(design)), key=lambda curve: -curve.length)
    assert not outer.closed
    assert not slit.closed
    ends = {tuple(point) for curve in (outer, slit) for point in curve.points[[0, -1]].tolist()}
    on_side = [(x in (0.0, 50.0)) or (y in (0.0, 50.0)) for x, y in ends]
    assert all(on_side)
    # The column's outer face runs from the bottom to the mirror line, and meets it squarely.
    assert sorted(outer.points[[0, -1], 1].tolist()) == [0.0, 50.0]
    top = outer.points[np.argmax(outer.points[:, 1])]
    assert abs(design.chi(*top, (0, 1)) / design.chi(*top, (1, 0))) < 1e-12


@pytest.mark.parametrize("radius", [0.4, 3.0, 20.0, 40.0])
def test_a_circle_has_the_length_of_a_circle(radius: float) -> None:
    curves = trace(level_set(lambda x, y: radius - np.hypot(x - 41, y - 55.3), PLANE))
    (curve,) = curves
    assert curve.closed
    assert curve.length == pytest.approx(2 * np.pi * radius, rel=1e-3)
    assert np.allclose(np.hypot(*(curve.points - [41, 55.3]).T), radius, atol=1e-10, rtol=0)


def test_the_solid_lies_on_the_left() -> None:
    (outward,) = trace(level_set(lambda x, y: 20 - np.hypot(x - 41, y - 55.3), PLANE))
    (inward,) = trace(level_set(lambda x, y: np.hypot(x - 41, y - 55.3) - 20, PLANE))
    for curve, sign in ((outward, 1), (inward, -1)):
        x, y = curve.points.T
        area = 0.5 * (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()
        assert area == pytest.approx(sign * 400 * np.pi, rel=1e-2)


@pytest.mark.parametrize("width", [0.05, 0.2, 1.0])
def test_a_slit_much_thinner_than_an_element_is_found(width: float) -> None:
    # One spline coefficient apart, so that the spline's own dip below zero is that narrow.
    problem = PLANE.replace(elements=20)
    h = problem.h_x
    wide = Design.from_function(problem, lambda x, y: np.where(np.abs(x - 8.5 * h) < h, 0.0, 1.0))
    deepest = float(wide.chi(8.5 * h, 50))
    # A parabola of curvature chi'' around its minimum: its roots are `width` apart.
    bend = float(wide.chi(8.5 * h, 50, (2, 0)))
    level = deepest + bend * (width / 2) ** 2 / 2
    ls = level_set(wide, level=level)
    xs = sorted(curve.points[:, 0].mean() for curve in trace(ls))
    assert len(xs) == 2
    assert xs[1] - xs[0] == pytest.approx(width, rel=1e-9)
    assert solid_area(ls) == pytest.approx(2500 - 50 * width, rel=1e-9)


def test_a_neck_and_a_gap_at_a_saddle_are_told_apart() -> None:
    def near_saddle(offset: float) -> ChiFunction:
        return lambda x, y: ((x - 30.03) ** 2 - (y - 40.7) ** 2) / 10 + offset

    joined = trace(level_set(near_saddle(1e-4), PLANE))
    split = trace(level_set(near_saddle(-1e-4), PLANE))
    # chi > 0 at the saddle: the solid passes from left to right, each contour stays above or below.
    assert len(joined) == len(split) == 2
    for curves, axis in ((joined, 1), (split, 0)):
        centre = [30.03, 40.7][axis]
        sides = [np.sign(curve.points[:, axis] - centre) for curve in curves]
        assert all((side == side[0]).all() for side in sides)


def test_corners_of_a_function_are_kept() -> None:
    (curve,) = trace(
        level_set(lambda x, y: np.minimum(13.3 - abs(x - 41), 21.7 - abs(y - 55)), PLANE)
    )
    found = curve.points[curve.corners]
    wanted = np.array([[41 + a * 13.3, 55 + b * 21.7] for a in (-1, 1) for b in (-1, 1)])
    assert len(found) == 4
    assert max(np.hypot(*(found - corner).T).min() for corner in wanted) < 1e-3


@settings(max_examples=20, suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 10**6), level=st.floats(-3, 3))
def test_contours_of_random_splines_enclose_the_solid(seed: int, level: float) -> None:
    """They enclose the area found by quadrature, and exactly the points where chi is larger."""
    random = np.random.default_rng(seed)
    problem = PLANE.replace(elements=12)
    noise = gaussian_filter(random.normal(size=problem.coefficient_shape), 0.8)
    design = Design(problem, 20 * noise + 2)
    ls = level_set(design, level=level)
    loops = all_loops(ls)
    area = sum(area_inside(ls, loop) for loop in loops)
    assert area == pytest.approx(solid_area(ls), abs=2e-3)
    points = random.uniform(0, 50, (400, 2))
    clear = np.abs(ls.distance(points)) > 0.02
    crossings = sum(
        Path(np.vstack([loop.polygon, loop.polygon[:1]])).contains_points(points).astype(int)
        for loop in loops
    )
    solid = design.chi(*points.T) > level
    assert (crossings % 2 == solid)[clear].all()


def all_loops(ls: LevelSet) -> list[Loop]:
    try:
        parts, filled = _parts(ls, trace(ls, angle=0.05), 0.0)
    except OutlineError as error:
        assert trace(ls) == []
        square = np.array([[0, 0], [50, 0], [50, 50], [0, 50], [0, 0]], float)
        return [Loop((Piece(square),))] if "full" in str(error) else []
    assert filled == []
    return [loop for part in parts for loop in part.loops]


# -- the area of the solid -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("chi", "area"),
    [
        (disc, 100 * np.pi),
        (column, 500.0),
        (lambda x, y: 1 - np.hypot((x - 50) / 40, (y - 50) / 0.1), np.pi),
        (lambda x, y: 0.1 - np.abs(x - 50) + 0 * y, 5.0),
        (lambda x, y: np.minimum(20 - abs(x - 50), 30 - abs(y - 50)), 600.0),
    ],
)
def test_area_of_known_shapes(chi: ChiFunction, area: float) -> None:
    assert solid_area(level_set(chi, PLANE)) == pytest.approx(area, rel=1e-6)


def test_moving_the_level_moves_the_surface() -> None:
    """d(area)/d(offset) is the length of the contour, for offsets o = -level l_i / 8 of (2.6)."""
    design = gallery["C7"]
    eta = 1e-3
    wider = solid_area(level_set(design, level=-eta))
    thinner = solid_area(level_set(design, level=eta))
    rate = (wider - thinner) / (2 * eta)
    expected = 0.0
    for curve in trace(level_set(design), angle=0.02):
        x, y = ((curve.points[1:] + curve.points[:-1]) / 2).T
        slope = np.hypot(design.chi(x, y, (1, 0)), design.chi(x, y, (0, 1)))
        gap = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
        expected += float((gap / slope).sum())
    assert rate == pytest.approx(expected, rel=1e-3)


# -- loops and parts -------------------------------------------------------------------------------


def names(result: Outline) -> list[list[str]]:
    return [sorted(piece.name for piece in loop.pieces) for loop in result.loops]


def test_the_outline_of_a_column_with_a_hole() -> None:
    assert names(outline(gallery["C7"])) == [["bottom", "right", SURFACE, SURFACE, "top"]]
    full = outline(gallery["C7"], domain="full")
    assert names(full) == [["bottom", SURFACE, SURFACE, "top"], [SURFACE]]
    assert full.area == pytest.approx(4 * outline(gallery["C7"]).area, rel=1e-9)


def test_two_half_columns_are_two_parts_in_the_full_domain() -> None:
    assert len(outline(gallery["C7-random"]).parts) == 1
    assert len(outline(gallery["C7-random"], domain="full").parts) == 2


def test_solid_around_the_corners_of_the_domain() -> None:
    def holes(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.minimum(np.hypot(x - 50, y) - 20, np.hypot(x - 50, y - 100) - 20)

    result = outline(holes, PLANE)
    assert names(result) == [["bottom", "left", "right", SURFACE, "top"]]
    assert result.parts[0].area == pytest.approx(2500 - 100 * np.pi, rel=1e-4)


def test_pieces_of_a_loop_join_without_gaps() -> None:
    for name in ("C4", "C7", "C7-random"):
        for loop in outline(gallery[name], domain="full").loops:
            ends = [piece.points[-1] for piece in loop.pieces]
            starts = [piece.points[0] for piece in loop.pieces]
            assert all((a == b).all() for a, b in zip(ends, starts[1:] + starts[:1], strict=True))


def test_small_islands_are_dropped_with_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    def with_island(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.maximum(column(x, y), 0.5 - np.hypot(x - 20, y - 30))

    with caplog.at_level(logging.WARNING):
        result = outline(with_island, PLANE, domain="full")
    assert [round(part.area, 1) for part in result.dropped] == [0.8]
    assert len(result.parts) == 1
    assert "dropped a solid part of 0.78" in caplog.text
    assert result.area == pytest.approx(2000, rel=1e-6)


def test_small_voids_are_filled_below_the_given_area(caplog: pytest.LogCaptureFixture) -> None:
    def with_bubble(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.minimum(column(x, y), np.hypot(x - 48, y - 30) - 0.5)

    kept = outline(with_bubble, PLANE, domain="full")
    assert [len(part.voids) for part in kept.parts] == [1]
    with caplog.at_level(logging.WARNING):
        filled = outline(with_bubble, PLANE, domain="full", smallest_void=1.0)
    assert [len(part.voids) for part in filled.parts] == [0]
    assert "filled a void" in caplog.text
    assert filled.area == pytest.approx(2000, rel=1e-6)


def test_a_void_cut_by_a_mirror_line_counts_with_its_image() -> None:
    def with_slit(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.minimum(column(x, y), np.hypot(x - 50, y - 50) - 0.5)

    assert len(outline(with_slit, PLANE, smallest_void=0.78).loops[0].pieces) == 5
    assert len(outline(with_slit, PLANE, smallest_void=0.79).loops[0].pieces) == 4


def test_a_stub_is_reported_and_a_floating_part_dropped(caplog: pytest.LogCaptureFixture) -> None:
    def chi(x: FloatArray, y: FloatArray) -> FloatArray:
        stub = np.minimum(3 - np.abs(x - 20), 10 - y)
        return np.maximum(np.maximum(column(x, y), stub), 4 - np.hypot(x - 80, y - 60))

    with caplog.at_level(logging.WARNING):
        result = outline(chi, PLANE)
    assert len(result.parts) == 2
    (loose,) = result.loose
    assert loose.area == pytest.approx(60, rel=1e-3)
    (dropped,) = result.dropped
    assert dropped.area == pytest.approx(16 * np.pi, rel=1e-2)
    assert "touches only the bottom" in caplog.text


# -- what has no outline ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("chi", "message"),
    [
        (lambda x, y: -1.0, "empty: chi > 0 nowhere"),
        (lambda x, y: 1.0, "full: chi > 0 in the whole domain"),
        (disc, "not connected"),
        (lambda x, y: 10 - abs(x - 50) - 11 * np.exp(-((y - 50) ** 2)), "not connected"),
        (lambda x, y: np.where(x > 50, np.nan, 1.0), "not finite"),
    ],
)
def test_no_outline(chi: ChiFunction, message: str) -> None:
    with pytest.raises(OutlineError, match=message):
        outline(chi, PLANE)


@pytest.mark.parametrize("start", [Design.column(PLANE), Design.random(PLANE)])
def test_a_grey_design_is_refused(start: Design) -> None:
    with pytest.raises(OutlineError, match="the design is grey"):
        outline(start)


@pytest.mark.parametrize("level", [-4.0, 0.0, 4.0])
def test_a_finished_design_is_clear_at_every_offset(level: float) -> None:
    assert outline(gallery["C7"], level=level).parts


@pytest.mark.long
def test_details_too_fine_for_the_samples_of_a_function_are_refused() -> None:
    def speckled(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.sin(4000 * x) * np.sin(3700 * y) + 0.2

    with pytest.raises(OutlineError, match="more elements"):
        outline(speckled, PLANE.replace(elements=4), domain="full")


def test_wrong_arguments() -> None:
    design = gallery["C4"]
    with pytest.raises(ProblemError, match="needs a problem"):
        outline(disc)
    with pytest.raises(ProblemError, match="level = nan"):
        outline(design, level=float("nan"))
    with pytest.raises(ProblemError, match="'half'"):
        outline(design, domain="half")
    with pytest.raises(ProblemError, match="smallest_island = -1"):
        outline(design, smallest_island=-1)
    with pytest.raises(ProblemError, match="another size or mesh"):
        outline(design, PLANE.replace(L=90.0))
    with pytest.raises(OutlineError, match="not symmetric"):
        outline(lambda x, y: 10 - abs(x - 40), PLANE, domain="quarter")


def test_symmetry_of_functions() -> None:
    assert is_symmetric(disc, PLANE)
    assert not is_symmetric(lambda x, y: 10 - abs(x - 40), PLANE)
    assert is_symmetric(lambda x, y: 10 - abs(x - 20), ROUND)
    assert not is_symmetric(lambda x, y: 10 - abs(x - 20) + 0.1 * y, ROUND)
    assert level_set(lambda x, y: 10 - abs(x - 40), PLANE).problem.domain == "full"
    assert level_set(disc, PLANE).problem.domain == "quarter"


def test_a_contour_there_and_back_along_a_side_encloses_nothing() -> None:
    there, back = np.array([[10.0, 0.0], [20.0, 0.0]]), np.array([[20.0, 0.0], [10.0, 0.0]])
    assert Loop((Piece(there), Piece(back, "bottom"))).area == 0
