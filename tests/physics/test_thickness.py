"""Walls and gaps that can be made: the terms that see the middle lines of those too thin."""

from __future__ import annotations

import numpy as np
import pytest

import ngspring
from ngspring import ControlPoint, Design, Ladder, ProblemError, SpringProblem
from ngspring.fem.constraints import spline_extraction
from ngspring.fem.grid import Grid, ScalarSpace
from ngspring.physics.lagrangian import DesignForm
from ngspring.problem.scaling import on_mesh

SPRING = SpringProblem((ControlPoint(10, 2), ControlPoint(-10, -2)), elements=20, l_i=4.0)


def thickness_terms(problem: SpringProblem, design: Design) -> tuple[float, float]:
    """The terms of walls and of gaps."""
    scalar = ScalarSpace(Grid(problem))
    values = DesignForm(scalar).values(spline_extraction(scalar) @ design.coefficients.ravel())
    return values.get("walls", 0.0), values.get("gaps", 0.0)


def bar(width: float, sign: float = 1.0) -> Design:
    """A wall (or with sign = -1 a gap) of this width, from side to side of the domain.

    chi falls with its largest slope from the middle line, whose kink is rounded.
    """
    steepest = 8 / SPRING.l_i

    def chi(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        away = np.sqrt((y - SPRING.H / 2) ** 2 + 4.0)
        return sign * steepest * (width / 2 + 2.0 - away) + 0 * x

    return Design.from_function(SPRING, chi)


# -- what they see ---------------------------------------------------------------------------------


def test_only_a_wall_that_is_thinner_costs() -> None:
    asked = SPRING.replace(wall=10.0)
    thick, enough, thin = (thickness_terms(asked, bar(width))[0] for width in (20, 15, 6))
    assert thick == enough == 0.0
    # Of 100 mm along the domain, most of the 2 mm around its middle line.
    assert 0.2 < thin / (asked.k_w * 100 * 2) < 1.0


def test_a_gap_is_a_wall_of_void() -> None:
    asked = SPRING.replace(wall=10.0, gap=10.0)
    for width in (20, 15, 12, 6):
        wall, no_gap = thickness_terms(asked, bar(width))
        no_wall, gap = thickness_terms(asked, bar(width, -1.0))
        assert (gap, no_wall) == pytest.approx((wall, no_gap), rel=1e-12)
        assert no_wall == 0.0


def test_what_is_not_asked_for_is_no_term() -> None:
    scalar = ScalarSpace(Grid(SPRING.replace(gap=3.0)))
    assert "gaps" in DesignForm(scalar).terms
    assert "walls" not in DesignForm(scalar).terms


def test_corners_are_no_walls() -> None:
    def wedge(opening: float) -> Design:
        """Solid around the middle, whose four tips have this opening in degrees."""
        c, s = np.cos(np.radians(opening / 2)), np.sin(np.radians(opening / 2))

        def chi(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            x, y = np.abs(x - 50), np.abs(y - 50)
            return (8 / SPRING.l_i) * (30 * s - x * s - y * c)

        return Design.from_function(SPRING, chi)

    asked = SPRING.replace(wall=10.0)
    sharp, right = (thickness_terms(asked, wedge(opening))[0] for opening in (25, 90))
    assert right < 1e-2 * sharp


# -- what they do ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plain() -> Design:
    result = ngspring.optimize(on_mesh(ngspring.cases["T3"], 20)[0], threads=1)
    assert result.converged
    return result.design


@pytest.mark.long
def test_a_gap_that_is_asked_for_is_there(plain: Design) -> None:
    before = ngspring.mesh_body(plain).quality
    gap = 1.5 * before.narrowest_gap
    problem = plain.problem.replace(gap=gap)
    result = ngspring.optimize(problem, plain, dt_initial=1e5, threads=1)
    assert result.converged
    assert result.q == pytest.approx([2.0, 4.0], rel=1e-3)
    assert ngspring.mesh_body(result.design).quality.narrowest_gap > gap


@pytest.mark.long
def test_walls_and_gaps_that_are_there_cost_nothing(plain: Design) -> None:
    problem = plain.problem.replace(wall=1.0, gap=1.0)
    result = ngspring.optimize(problem, plain, dt_initial=1e5, threads=1)
    assert result.design.relative_width == pytest.approx(plain.relative_width, rel=1e-3)


def test_coarse_meshes_look_for_the_shape_without_them() -> None:
    problem = ngspring.cases["C4"].replace(wall=2.0, gap=0.8)
    *coarse, last = Ladder().rungs(problem)
    assert [(rung.wall, rung.gap, rung.elements) for rung in coarse] == [(0, 0, 20), (0, 0, 40)]
    assert last == problem


# -- as a user gives them --------------------------------------------------------------------------


def test_one_line_of_a_file_asks_for_them() -> None:
    text = SPRING.to_toml()
    read = SpringProblem.from_toml(text.replace("wall = 0.0", "wall = 2"))
    assert (read.wall, read.gap, read.k_w) == (2.0, 0.0, pytest.approx(1e3 * SPRING.k_rho))
    assert SpringProblem.from_toml(read.to_toml()) == read
    assert SPRING.k_w == 0.0


def test_a_similar_spring_has_similar_walls() -> None:
    problem = SPRING.replace(wall=2.0, gap=0.8)
    similar = ngspring.scaled(problem, length=2.0, stress=3.0)
    assert (similar.wall, similar.gap) == pytest.approx((4.0, 1.6))
    assert similar.k_w == pytest.approx(problem.k_w / 8)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wall": -1.0}, "wall = -1.0"),
        ({"gap": float("nan")}, "gap"),
        ({"gap": 100.0}, "gap = 100.0 is not valid: it must be positive and smaller than L and H"),
        ({"wall": "thick"}, "wall"),
        ({"wall": 2.0, "k_w": -1.0}, "k_w = -1.0"),
        ({"wall": 2.0, "k_rho": 0.0}, "k_w is needed"),
    ],
)
def test_a_wall_that_cannot_be_is_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        SPRING.replace(**changes)
