"""The cases are those of Tables 2 to 4, and four axisymmetric springs of our own."""

from __future__ import annotations

from typing import Any

import pytest

from ngspring.basics.errors import ProblemError
from ngspring.problem.cases import cases, get_case
from ngspring.problem.point import ControlPoint
from ngspring.problem.spring import SpringProblem

TABLE_2 = {"C1": -2.5, "C2": -3, "C3": -3.5, "C4": -4, "C5": -4.5, "C6": -5, "C7": -5.5}
TABLE_3 = {"T1": 3, "T2": 3.5, "T3": 4, "T4": 4.5, "T5": 5, "T6": 5.5}
TABLE_4 = {
    "CT1": (4, -3.2),
    "CT2": (4, -4),
    "CT3": (4, -4.8),
    "CT4": (4.8, -3.2),
    "CT5": (4.8, -4),
    "CT6": (4.8, -4.8),
}
AXISYMMETRIC = {"A1": ("C1", -125), "A2": ("C3", -175), "A3": ("C5", -225), "A4": ("C7", -275)}


def load_path(problem: SpringProblem) -> list[tuple[float, float]]:
    return [(point.d, point.q) for point in problem.control_points]


def test_cases_come_in_the_order_of_the_paper() -> None:
    assert list(cases) == [*TABLE_2, *TABLE_3, *TABLE_4, *AXISYMMETRIC]


@pytest.mark.parametrize(("name", "q_3"), TABLE_2.items())
def test_compression_springs_are_those_of_table_2(name: str, q_3: float) -> None:
    assert load_path(cases[name]) == [(10, 2), (-10, -2), (-20, q_3)]


@pytest.mark.parametrize(("name", "q_2"), TABLE_3.items())
def test_tension_springs_are_those_of_table_3(name: str, q_2: float) -> None:
    assert load_path(cases[name])[:2] == [(10, 2), (20, q_2)]


@pytest.mark.parametrize(("name", "targets"), TABLE_4.items())
def test_compression_tension_springs_are_those_of_table_4(
    name: str, targets: tuple[float, float]
) -> None:
    q_2, q_4 = targets
    assert load_path(cases[name]) == [(10, 2), (20, q_2), (-10, -2), (-20, q_4)]


@pytest.mark.parametrize("name", ["T1", "T2"])
def test_softening_tension_springs_are_robust_and_finer(name: str) -> None:
    problem = cases[name]
    assert problem.elements == 160
    assert len(problem.control_points) == 3
    blueprint, dilated = problem.control_points[1:]
    assert dilated == ControlPoint(20, TABLE_3[name], weight=1e-4, eta=2.0)
    assert (dilated.d, dilated.q) == (blueprint.d, blueprint.q)
    assert dilated.eta * problem.l_i / 8 == 0.25


@pytest.mark.parametrize("name", [*TABLE_2, *list(TABLE_3)[2:], *TABLE_4])
def test_other_plane_strain_cases_have_the_defaults_of_table_1(name: str) -> None:
    problem = cases[name]
    assert problem == SpringProblem(
        tuple(ControlPoint(d, q) for d, q in load_path(problem)), name=name
    )
    assert len(problem.control_points) == {"C": 3, "T": 2, "CT": 4}[name.rstrip("1234567")]


@pytest.mark.parametrize("name", AXISYMMETRIC)
def test_axisymmetric_springs_have_the_ratios_of_their_plane_counterparts(name: str) -> None:
    counterpart, q_3 = AXISYMMETRIC[name]
    problem = cases[name]
    assert problem.motion.axis
    assert load_path(problem) == [(10, 100), (-10, -100), (-20, q_3)]
    for point, plane in zip(problem.control_points, cases[counterpart].control_points, strict=True):
        assert point.q / plane.q == 50
        assert point.weight == 4e-4
        assert point.weight * point.q**2 == pytest.approx(plane.weight * plane.q**2, rel=1e-14)


@pytest.mark.parametrize("name", cases)
def test_case_carries_its_name_and_survives_toml(name: str) -> None:
    assert cases[name].name == name
    assert SpringProblem.from_toml(cases[name].to_toml()) == cases[name]


def test_cases_cannot_be_changed() -> None:
    with pytest.raises(TypeError):
        cases["C1"] = cases["C2"]  # type: ignore[index]


@pytest.mark.parametrize("name", ["CT3", "ct3", "Ct3", " ct3 "])
def test_case_is_found_in_upper_or_lower_case(name: str) -> None:
    assert get_case(name) is cases["CT3"]


@pytest.mark.parametrize(("name", "nearest"), [("CT33", "CT3"), ("tc4", "T4"), ("C-7", "C7")])
def test_unknown_case_names_the_nearest_one(name: str, nearest: str) -> None:
    with pytest.raises(ProblemError) as caught:
        get_case(name)
    message = str(caught.value)
    assert repr(name) in message
    assert f"did you mean {nearest!r}?" in message
    assert len(message.splitlines()) == 1


@pytest.mark.parametrize("name", [None, 4, ["C4"]])
def test_name_of_a_case_is_a_string(name: Any) -> None:
    with pytest.raises(ProblemError, match="must be a string"):
        get_case(name)
