"""The rubber foot: from a test of the rubber to a part that is stored beside its problem."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ngspring
from ngspring.design.corrections import without_aims
from ngspring.problem.material import young_and_poisson
from ngspring.solid.imperfection import STABLE

FOLDER = Path(__file__).parents[2] / "examples" / "materials"
RESULTS = FOLDER / "results"
pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="the examples are not installed")


@pytest.fixture(scope="module")
def problem() -> ngspring.SpringProblem:
    return ngspring.SpringProblem.from_toml(FOLDER / "rubber-foot.toml")


@pytest.fixture(scope="module")
def part() -> ngspring.Design:
    return ngspring.Design.load(RESULTS / "rubber-foot.npz")


@pytest.fixture(scope="module")
def known() -> dict[str, Any]:
    return json.loads((RESULTS / "rubber-foot.json").read_text(encoding="utf-8"))


def test_its_law_is_fitted_to_treloars_tests(problem: ngspring.SpringProblem) -> None:
    planar = ngspring.read_material_test(FOLDER / "treloar-planar.csv", "planar")
    tests = [FOLDER / "treloar-uniaxial.csv", planar]
    found = ngspring.fit(tests, "ogden-1", stretches=(1.1, 2.5), nu=0.49)
    for parameter in ("K", "mu1", "alpha1"):
        stored = getattr(problem.law, parameter)
        assert stored == pytest.approx(getattr(found.law, parameter), rel=1e-5)
    assert found.mean_error < 0.04


def test_it_hardly_changes_its_volume(problem: ngspring.SpringProblem) -> None:
    assert young_and_poisson(problem.K, problem.G)[1] == pytest.approx(0.49, abs=1e-6)


def test_its_targets_are_the_wanted_curve(problem: ngspring.SpringProblem) -> None:
    curve = ngspring.read_curve(FOLDER / "rubber-foot.csv", height=40.0, area=600.0)
    own = [point for point in problem.control_points if point.own]
    assert {(p.d, p.q) for p in own} == set(zip(curve.d.tolist(), curve.q.tolist(), strict=True))
    assert any(point.eta_odd for point in problem.control_points)


def test_the_stored_part_is_one_for_this_problem(
    problem: ngspring.SpringProblem, part: ngspring.Design
) -> None:
    assert without_aims(part.problem).equals_but_for_name(without_aims(problem))
    assert part.info["converged"]


def test_its_solid_goes_through_the_targets(known: dict[str, Any]) -> None:
    assert np.array(known["solid"]) == pytest.approx(np.array(known["target"]), rel=0.005)


def test_its_strain_stays_within_its_limit(
    problem: ngspring.SpringProblem, known: dict[str, Any]
) -> None:
    assert 1.0 < known["stretch_measure"] < 1.05 * problem.stretch_limit


def test_an_imperfect_one_stays_on_the_curve(known: dict[str, Any]) -> None:
    moved = known["imperfection"]
    assert moved["size"] == 0.15
    assert moved["stable"]
    assert abs(moved["largest_deviation"]["relative"]) < STABLE
    assert known["lowest_eigenvalue"] > 0.0


@pytest.mark.long
def test_the_force_in_tension_is_that_of_its_solid_computed_anew(
    part: ngspring.Design, known: dict[str, Any]
) -> None:
    d = max(known["d"])
    stored = known["solid"][known["d"].index(d)]
    curve = ngspring.contact_load_displacement(ngspring.mesh_body(part), [d], threads=1)
    assert curve.q[0] == pytest.approx(stored, rel=1e-3)


def test_its_step_file_is_the_part(part: ngspring.Design, tmp_path: Path) -> None:
    exported = ngspring.export_body(part, tmp_path / "again.step")
    stored = (RESULTS / "rubber-foot.step").read_text(encoding="utf-8")
    again = exported.path.read_text(encoding="utf-8")
    points = [text.count("CARTESIAN_POINT") for text in (stored, again)]
    assert points[0] == points[1] > 0
