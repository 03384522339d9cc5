"""The same spring in other units, in another size, in another material."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ngspring.analysis.forward import load_displacement
from ngspring.analysis.states import curve_displacements, index_of
from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.evolution.optimize import optimize
from ngspring.evolution.updates import Result
from ngspring.problem.cases import cases
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import (
    force_unit,
    length_unit,
    scaled,
    target_stiffness,
    time_unit,
    with_similar_weights,
)
from ngspring.problem.spring import SpringProblem

UPDATES = 10

#: Plane strain and axisymmetric; a dilated point, so that eta takes part. With the weights of the
#: first one every term of C counts: with Table 1's, a wrong one would hide behind the mechanics.
SPRINGS = {
    "plane strain": SpringProblem(
        (ControlPoint(10, 2), ControlPoint(-20, -5), ControlPoint(10, 2, weight=1e-2, eta=0.5)),
        elements=12,
        l_i=45.0,
        k_rho=1e-4,
        k_i=20.0,
        k_H=0.1,
    ),
    "axisymmetric": SpringProblem(
        (ControlPoint(10, 100, 4e-4), ControlPoint(-20, -150, 4e-4)),
        kinematics="axisymmetric",
        elements=12,
        l_i=7.0,
        H=80.0,
    ),
}

#: Changes of length, thickness and stress, and what they are.
CHANGES: dict[str, dict[str, float]] = {
    "m and Pa": {"length": 1e-3, "stress": 1e6},
    "half the size, ten times as stiff": {"length": 0.5, "stress": 10.0},
    "a micrometre of 1 Pa": {"length": 1e-5, "stress": 1e-6},
    "a kilometre of 1 TPa": {"length": 1e4, "stress": 1e6},
    "a micromechanism of silicone": {"length": 1e-4, "stress": 3.0, "thickness": 2e-3},
}


@pytest.fixture(scope="module")
def in_millimetres() -> dict[str, Result]:
    return {
        name: optimize(problem, max_updates=UPDATES, threads=1) for name, problem in SPRINGS.items()
    }


@pytest.mark.long
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", SPRINGS)
def test_a_similar_problem_has_the_same_design_update_by_update(
    name: str, change: str, in_millimetres: dict[str, Result]
) -> None:
    problem = scaled(SPRINGS[name], **CHANGES[change])
    reference, result = (
        in_millimetres[name],
        optimize(problem, max_updates=UPDATES, threads=1),
    )
    chi, chi_reference = result.design.coefficients, reference.design.coefficients
    assert np.abs(chi - chi_reference).max() < 1e-8
    # Ten updates have changed the design a lot: agreement is not that of the common start.
    assert np.abs(chi_reference - Design.column(SPRINGS[name]).coefficients).max() > 1.0
    force = force_unit(problem) / force_unit(SPRINGS[name])
    assert result.q == pytest.approx(force * reference.q, rel=1e-8)
    for column in ("newton_iterations", "rejected"):
        assert np.array_equal(result.history[column], reference.history[column])
    assert result.history["C"] == pytest.approx(reference.history["C"], rel=1e-7)
    unit = time_unit(problem) / time_unit(SPRINGS[name])
    assert result.history["dt"] == pytest.approx(unit * reference.history["dt"], rel=1e-12)


@pytest.mark.parametrize("field", ["k_rho", "k_i", "k_H", "l_i", "l_t"])
def test_every_weight_and_length_scale_must_change_with_the_size(
    field: str, in_millimetres: dict[str, Result]
) -> None:
    problem = SPRINGS["plane strain"]
    wrong = scaled(problem, length=0.5, stress=10.0).replace(**{field: getattr(problem, field)})
    result = optimize(wrong, max_updates=UPDATES, threads=1)
    difference = result.design.coefficients - in_millimetres["plane strain"].design.coefficients
    assert np.abs(difference).max() > 1e-3


def test_from_millimetres_to_metres_forces_stay_in_newtons(kinematics: str) -> None:
    problem = SPRINGS[kinematics]
    in_metres = scaled(problem, length=1e-3, stress=1e6)
    for field, factor in {"L": 1e-3, "H": 1e-3, "T": 1e-3, "K": 1e6, "G": 1e6}.items():
        assert getattr(in_metres, field) == pytest.approx(factor * getattr(problem, field))
    for before, after in zip(problem.control_points, in_metres.control_points, strict=True):
        assert (after.q, after.weight) == pytest.approx((before.q, before.weight))
        assert (after.d, after.eta) == pytest.approx((before.d / 1000, before.eta))
    assert in_metres.k_rho == pytest.approx(1e9 * problem.k_rho)
    assert in_metres.k_i == pytest.approx(1e-9 * problem.k_i)
    assert in_metres.k_H == pytest.approx(1e-3 * problem.k_H)


@pytest.mark.parametrize("name", ["C7", "T1", "A4"])
def test_scaling_there_and_back_is_no_change(name: str) -> None:
    problem = cases[name]
    there = scaled(problem, length=0.3, stress=7.0, thickness=11.0)
    back = scaled(there, length=1 / 0.3, stress=1 / 7.0, thickness=1 / 11.0)
    for field in ("L", "H", "T", "K", "G", "l_i", "l_t", "k_rho", "k_i", "k_H"):
        assert getattr(back, field) == pytest.approx(getattr(problem, field), rel=1e-13)
    for one, other in zip(back.control_points, problem.control_points, strict=True):
        assert (one.d, one.q, one.weight) == pytest.approx((other.d, other.q, other.weight))


def test_the_units_are_those_of_the_paper() -> None:
    assert length_unit(cases["C4"]) == pytest.approx(1.0)
    assert force_unit(cases["C4"]) == pytest.approx(1.0)
    # E times a hundredth of the disc's area
    assert force_unit(cases["A1"]) == pytest.approx(np.pi / 4 * 100)


@pytest.mark.parametrize("name", cases)
def test_similar_weights_of_the_paper_s_springs_are_their_own(name: str) -> None:
    problem, similar = cases[name], with_similar_weights(cases[name])
    for field in ("k_rho", "k_i", "k_H", "l_t"):
        assert getattr(similar, field) == pytest.approx(getattr(problem, field), rel=1e-12)
    if problem.elements == 80:
        assert similar.l_i == pytest.approx(1.0)
    # As large against the terms of the volume, which is 25 pi times that of a plane spring.
    bulk = 25 * np.pi if problem.kinematics == "axisymmetric" else 1.0
    for one, other in zip(similar.control_points, problem.control_points, strict=True):
        assert 0.7 < one.weight / (bulk * other.weight) < 1.32


@pytest.mark.parametrize("name", ["C4", "A2"])
def test_similar_weights_follow_the_similarity_rule(name: str) -> None:
    problem = with_similar_weights(cases[name])
    small = scaled(problem, length=0.2, stress=5.0, thickness=8.0)
    again = with_similar_weights(small.replace(k_rho=1e-8, k_i=1e-2, k_H=1e-9, l_i=1.0, l_t=8.0))
    for field in ("k_rho", "k_i", "k_H", "l_i", "l_t"):
        assert getattr(again, field) == pytest.approx(getattr(small, field), rel=1e-12)
    for one, other in zip(again.control_points, small.control_points, strict=True):
        assert one.weight == pytest.approx(other.weight, rel=1e-12)


def test_target_stiffness_is_that_of_the_blueprint() -> None:
    points = ControlPoint(10, 2), ControlPoint(-10, -4), ControlPoint(-5, -100, eta=2.0)
    assert target_stiffness(SpringProblem(points)) == pytest.approx(30.0)
    assert target_stiffness(SpringProblem((ControlPoint(10, 0),))) == 1.0


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), "2"])
def test_factors_are_positive_numbers(value: Any) -> None:
    for name in ("length", "stress", "thickness"):
        with pytest.raises(ProblemError, match=f"{name} = "):
            scaled(cases["C4"], **{name: value})


def test_curves_of_a_micrometre_spring_are_sampled_and_found_at_their_points() -> None:
    tiny = scaled(cases["C4"].replace(elements=8, l_i=10.0), length=1e-6)
    design = Design.column(tiny)
    displacements = curve_displacements(design, points=7)
    assert np.diff(displacements) == pytest.approx(5e-6, rel=1e-6)
    response = load_displacement(design, displacements, threads=1)
    assert index_of(response, 0.0) == 4
    assert index_of(response, -2e-5) == 0
    assert index_of(response, -1.9e-5) is None
    large = load_displacement(
        Design.column(cases["C4"].replace(elements=8, l_i=10.0)), displacements * 1e6, threads=1
    )
    assert response.q == pytest.approx(1e-12 * large.q, rel=1e-9, abs=1e-26)
