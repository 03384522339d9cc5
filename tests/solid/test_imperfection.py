"""Solids with surfaces moved in an odd pattern: what is moved, how they buckle, and the verdict."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from click.testing import CliRunner
from scipy.sparse.linalg import eigsh

from ngspring.analysis.path import Jump
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import OutlineError, ProblemError
from ngspring.cli.main import cli
from ngspring.design.design import Design
from ngspring.problem.imperfection import odd_pattern
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem
from ngspring.solid.contact.mechanics import ContactPoint
from ngspring.solid.contact.response import (
    ContactResponse,
    ContactSettings,
    contact_load_displacement,
    contact_mechanics,
)
from ngspring.solid.imperfection import Imperfection, imperfect_body, imperfection
from ngspring.solid.mesh.body import Body
from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.solid.mesh.moved import moved_body, whole_body
from ngspring.solid.mesh.triangles import NAMES
from ngspring.solid.sides import SURFACE
from ngspring.view.figure import save_figure
from ngspring.view.imperfection import imperfection_figure

WIDTH, HEIGHT = 4.0, 100.0


@pytest.fixture(scope="module")
def slender() -> Body:
    """A straight column, 4 mm wide and 100 mm high, in a domain of 16 mm."""
    problem = SpringProblem((ControlPoint(-1.0, -1.0),), L=16.0, H=HEIGHT)
    return mesh_body(
        lambda x, y: WIDTH / 2 - np.abs(x - 8.0) + 0 * y,
        problem,
        elements_across=2,
        min_size=1.0,
        max_size=2.0,
    )


@pytest.fixture(scope="module")
def block() -> Body:
    """A block with a flat elliptic hole in the middle, which closes under compression."""
    return mesh_body(
        lambda x, y: ((x - 50) / 30) ** 2 + ((y - 50) / 5) ** 2 - 1,
        SpringProblem((ControlPoint(-20.0, -5.0),)),
        elements_across=1,
        angle=0.4,
        max_size=12.0,
    )


def forces(body: Body, displacements: FloatArray) -> ContactResponse:
    response = contact_load_displacement(body, displacements, threads=1)
    assert response.complete, response.message
    return response


def sway(response: ContactResponse) -> FloatArray:
    """How far the column bends into an S in mm: its share of sin(2 pi y / H)."""
    points = np.array([v.point for v in response.body.mesh.vertices])
    wave = np.sin(2 * np.pi * points[:, 1] / HEIGHT)
    return np.asarray(response.u[:, : len(points)] @ wave / (wave @ wave))


def buckling_load(body: Body) -> float:
    """Force in N at which the straight column becomes unstable to an S, by linear buckling.

    Its tangent changes in proportion to the force; the first mode is symmetric about y = H/2.
    """
    mechanics, _ = contact_mechanics(whole_body(body), ContactSettings())
    rest = mechanics.at_rest()
    point, _ = mechanics.advanced(rest, -1.0, 1e-3)
    n = mechanics.solid.free
    before, after = (
        sp.csc_matrix(mechanics.solid.tangent(mechanics.full_field(p.d, p.u))[:n, :n])
        for p in (rest, point)
    )
    hold = sp.csc_matrix((n, n)).tolil()
    hold[mechanics.solid.floating, mechanics.solid.floating] = 1.0
    modes = eigsh(
        before - after, k=2, M=sp.csc_matrix(before + hold), which="LA", return_eigenvectors=False
    )
    return float(-point.q / modes.min())


def test_nothing_moved_is_the_perfect_solid_to_rounding(slender: Body) -> None:
    d = np.array([-0.5, 0.5])
    moved = forces(imperfect_body(slender, 1e-9), d)
    np.testing.assert_allclose(moved.q, forces(slender, d).q, rtol=1e-10)


def test_an_imperfect_column_bends_as_southwell_says(slender: Body) -> None:
    """w = w_0 P / (P_cr - P): w / P over w is a line of slope 1 / P_cr, up to half of P_cr."""
    critical = buckling_load(slender)
    stiffness = -float(forces(slender, np.array([-1e-3])).q[0]) / 1e-3
    d = -critical / stiffness * np.array([0.15, 0.25, 0.35, 0.45])
    size = 0.02
    response = forces(imperfect_body(slender, size), d)
    bent, load = -sway(response), -response.q
    slope, _ = np.polyfit(bent, bent / load, 1)
    assert 1 / slope == pytest.approx(critical, rel=0.04)
    # How much the first and the last are bent differs by the classical factor.
    grown = load / (critical - load)
    assert bent[-1] / bent[0] == pytest.approx(grown[-1] / grown[0], rel=0.04)
    # Both faces move by as much, to the same side: the column's middle line is this far off. Its
    # share of the clamped column's mode is a little less.
    crooked = size * np.sin(np.pi * WIDTH / 16)
    assert 0.75 * crooked < (bent / grown)[0] < crooked


def test_half_the_imperfection_changes_a_stable_force_by_a_quarter(slender: Body) -> None:
    d = np.array([-0.2])
    q = forces(slender, d).q[0]
    once, twice = (forces(imperfect_body(slender, size), d).q[0] - q for size in (0.1, 0.2))
    assert abs(twice) > 1e-6 * abs(q)
    assert twice / once == pytest.approx(4.0, rel=0.01)


def test_the_surface_is_moved_by_the_pattern_and_the_sides_stay(block: Body) -> None:
    size = 0.5
    whole, moved = whole_body(block), imperfect_body(block, size, "xy")
    assert whole.triangles is not None
    assert moved.triangles is not None
    here, there = whole.triangles.points, moved.triangles.points
    surface = np.unique(whole.triangles.segments[whole.triangles.names == NAMES.index(SURFACE)])
    hole = surface[np.hypot(here[surface, 0] - 50, here[surface, 1] - 50) < 40]
    moves = np.linalg.norm(there[hole] - here[hole], axis=1)
    expected = size * np.abs(odd_pattern(here[hole, 0], here[hole, 1], 100.0, 100.0, "xy"))
    np.testing.assert_allclose(moves, expected, atol=1e-12)
    on_sides = ((here == 0.0) | (here == 100.0)).any(axis=1)
    np.testing.assert_array_equal(there[on_sides], here[on_sides])


@pytest.mark.parametrize("odd_in", ["xy", "x", "y"])
def test_opposite_sides_keep_nodes_that_face_each_other(odd_in: str) -> None:
    """Or they could not be tied to each other, and the spring would sway freely."""
    body = mesh_body(
        lambda x, y: 20 - np.abs(x - 50) - 5 * np.cos(np.pi * y / 50),
        SpringProblem((ControlPoint(-1.0, -1.0),)),
        elements_across=1,
        angle=0.3,
    )
    moved = imperfect_body(body, 1.0, odd_in)
    places = np.array([v.point for v in moved.mesh.vertices])
    bottom, top = (np.sort(places[places[:, 1] == y, 0]) for y in (0.0, 100.0))
    assert len(bottom) > 4
    np.testing.assert_allclose(bottom, top, atol=1e-9)


@pytest.mark.long
def test_a_closing_hole_with_an_imperfection_is_followed_through_contact(block: Body) -> None:
    d = np.array([-2.0, -11.0])
    perfect, moved = forces(block, d), forces(imperfect_body(block, 0.3), d)
    assert perfect.contact_starts
    assert moved.contact_starts
    assert -11.0 < moved.contact_starts[0] < -2.0
    np.testing.assert_allclose(moved.q, perfect.q, rtol=0.02)
    assert np.abs(moved.q - perfect.q).max() > 1e-8
    np.testing.assert_allclose(moved.q_bottom, moved.q, rtol=1e-7)


def test_a_body_of_revolution_can_be_odd_in_y_only() -> None:
    problem = SpringProblem((ControlPoint(-5.0, -5.0),), kinematics="axisymmetric")
    design = Design.from_function(
        problem.replace(elements=20, l_i=8.0), lambda x, y: 20 - np.abs(x - 50) + 0 * y
    )
    outcome = imperfection(design, 0.2, [-2.0], elements_across=1, threads=1)
    assert outcome.odd_in == "y"
    assert outcome.stable
    assert 0.0 < abs(outcome.largest_deviation[1]) < 1e-3
    with pytest.raises(ProblemError, match="'y' in a body of revolution"):
        imperfection(design, 0.2, [-2.0], odd_in="xy")


@pytest.mark.parametrize(
    ("size", "odd_in", "message"),
    [(0.0, None, "imperfection"), (-1.0, None, "imperfection"), (0.2, "yx", "odd_in")],
)
def test_what_is_no_imperfection_is_refused(size: float, odd_in: str | None, message: str) -> None:
    design = Design.column(SpringProblem((ControlPoint(-5.0, -5.0),), elements=20))
    with pytest.raises(ProblemError, match=message):
        imperfection(design, size, odd_in=odd_in)


def test_surfaces_moved_further_than_they_are_curved_are_refused(block: Body) -> None:
    with pytest.raises(OutlineError, match="inside out"):
        moved_body(block, lambda places: np.full(len(places), -60.0))


@pytest.fixture(scope="module")
def column() -> Design:
    problem = SpringProblem((ControlPoint(-2.0, -1.0),), name="column", elements=20, l_i=8.0)
    return Design.from_function(problem, lambda x, y: 12 - np.abs(x - 50) + 0 * y)


@pytest.fixture(scope="module")
def outcome(column: Design) -> Imperfection:
    return imperfection(column, 0.2, points=3, elements_across=1, threads=1)


def test_a_stocky_column_is_stable(outcome: Imperfection) -> None:
    assert outcome.stable
    assert outcome.leaves == ()
    assert "stable" in outcome.verdict
    assert abs(outcome.largest_deviation[1]) < 0.02


def changed(outcome: Imperfection, factor: float) -> Imperfection:
    """The outcome with the imperfect solid's last force changed by a factor."""
    curve = outcome.imperfect
    q = np.where(curve.d == curve.d.min(), factor, 1.0) * curve.q
    return dataclasses.replace(outcome, imperfect=dataclasses.replace(curve, q=q))


def test_a_force_off_by_more_than_two_percent_is_not_stable(outcome: Imperfection) -> None:
    off = changed(outcome, 0.9)
    assert off.leaves == (-2.0,)
    assert not off.stable
    assert off.largest_deviation == (-2.0, pytest.approx(-0.1, abs=1e-3))
    assert "off by more than 2 % from d = -2 mm on" in off.verdict
    assert changed(outcome, 1.01).stable


def test_a_snap_is_named(outcome: Imperfection) -> None:
    snapped = dataclasses.replace(outcome.imperfect, jumps=(Jump(-1.5, -1.0, -0.8),))
    snaps = dataclasses.replace(outcome, imperfect=snapped)
    assert not snaps.stable
    assert "snaps at d = -1.500 mm" in snaps.verdict


def test_the_outcome_is_json_and_a_picture(outcome: Imperfection, tmp_path: Path) -> None:
    for case in (outcome, changed(outcome, 0.5)):
        said = json.loads(json.dumps(case.to_dict(), allow_nan=False))
        assert said["stable"] == case.stable
        assert said["curve"]["d"] == sorted(said["curve"]["d"])
        save_figure(imperfection_figure(case), tmp_path / "imperfection.png", dpi=40)
        assert (tmp_path / "imperfection.png").stat().st_size > 1000


@pytest.mark.long
def test_verify_writes_what_an_imperfection_does(column: Design, tmp_path: Path) -> None:
    column.save(tmp_path / "column.npz")
    arguments = ["verify", str(tmp_path / "column.npz"), "--points", "2", "--elements-across", "1"]
    result = CliRunner().invoke(cli, [*arguments, "--imperfect", "0.2", "--odd-in", "xy"])
    assert result.exit_code == 0, result.output
    assert "surfaces moved by up to 0.2 mm, odd in x and y" in result.output
    (written,) = tmp_path.rglob("imperfection.json")
    assert json.loads(written.read_text(encoding="utf-8"))["odd_in"] == "xy"
    assert written.with_suffix(".png").exists()


@pytest.mark.parametrize(
    "options", [("--odd-in", "x"), ("--imperfect", "0"), ("--imperfect", "nan")]
)
def test_options_that_make_no_imperfection_are_refused(
    column: Design, tmp_path: Path, options: tuple[str, str]
) -> None:
    column.save(tmp_path / "column.npz")
    result = CliRunner().invoke(cli, ["verify", str(tmp_path / "column.npz"), *options])
    assert result.exit_code == 2


def test_a_wild_prediction_is_not_followed(slender: Body, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor are walls looked for further away than the body is large."""
    mechanics, _ = contact_mechanics(whole_body(slender), ContactSettings())
    rest = mechanics.at_rest()
    plain, _ = mechanics.advanced(rest, -0.1, 0.1)
    predicted, largest_step = mechanics.predicted, mechanics.skeleton.largest_step
    ways = []

    def wild(here: ContactPoint, d: float) -> FloatArray:
        return predicted(here, d) + 1e6 * HEIGHT

    def watched(begin: FloatArray, end: FloatArray) -> float:
        ways.append(float(np.abs(end - begin).max()))
        return largest_step(begin, end)

    monkeypatch.setattr(mechanics, "predicted", wild)
    monkeypatch.setattr(mechanics.skeleton, "largest_step", watched)
    point, _ = mechanics.advanced(rest, -0.1, 0.1)
    assert point.d == plain.d == -0.1
    assert point.q == pytest.approx(plain.q, rel=1e-8)
    assert 0.0 < max(ways) <= 1.01 * mechanics.size
