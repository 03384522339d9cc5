"""What is said about targets before they are tried, and the full block that bounds them."""

from __future__ import annotations

import ngsolve as ng
import numpy as np
import pytest

from ngspring.analysis.forward import load_displacement
from ngspring.basics.errors import ProblemError
from ngspring.problem.cases import cases
from ngspring.problem.kinematics import KINEMATICS
from ngspring.problem.laws import NeoHooke
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import scaled, with_similar_weights
from ngspring.problem.spring import SpringProblem
from ngspring.problem.targets.full_block import block_force, uniaxial_stress
from ngspring.problem.targets.plausibility import Finding, check_targets, strut_forces, volume_shift

PLANE_STRAIN = KINEMATICS["plane strain"]


def spring(*targets: tuple[float, float], **fields: object) -> SpringProblem:
    return SpringProblem(tuple(ControlPoint(d, q) for d, q in targets)).replace(**fields)


def found(problem: SpringProblem, part: str) -> Finding:
    """The one finding that contains a text."""
    matching = [f for f in check_targets(problem) if part in f.message]
    assert len(matching) == 1, check_targets(problem)
    return matching[0]


# -- the full block --------------------------------------------------------------------------------


@pytest.mark.parametrize("d", [-40.0, -10.0, 10.0, 60.0])
def test_the_block_is_the_finite_element_solution_with_solid_everywhere(
    coarse: SpringProblem, d: float
) -> None:
    problem = coarse.replace(elements=4)
    response = load_displacement(ng.CF(60.0), [d], problem=problem, threads=1)
    assert block_force(problem, d) == pytest.approx(response.q[0], rel=1e-9)


def test_no_spring_stores_more_energy_than_the_block(coarse: SpringProblem) -> None:
    x, y = ng.x / coarse.L, ng.y / coarse.H
    chi = 4 * ng.cos(2 * np.pi * x) * ng.cos(4 * np.pi * y) + 2
    response = load_displacement(chi, [-20.0, 20.0], problem=coarse, threads=1)
    for d, energy in zip(response.d, response.energy, strict=True):
        nodes, weights = np.polynomial.legendre.leggauss(8)
        forces = [block_force(coarse, d * (1 + s) / 2) for s in nodes]
        assert 0.0 < energy < d / 2 * (weights @ forces)


def test_the_block_at_rest_has_no_force_and_cannot_vanish() -> None:
    assert block_force(cases["C4"], 0.0) == 0.0
    with pytest.raises(ProblemError, match="impossible"):
        uniaxial_stress(0.0, NeoHooke(1.0, 1.0), PLANE_STRAIN)


@pytest.mark.parametrize("stretch", [0.02, 0.5, 3.0])
def test_the_block_scales_with_the_moduli_even_at_extreme_stretch(stretch: float) -> None:
    law = NeoHooke(5 / 3, 5 / 14)
    one = uniaxial_stress(stretch, law, PLANE_STRAIN)
    assert uniaxial_stress(stretch, law.scaled(1e6), PLANE_STRAIN) == pytest.approx(1e6 * one)
    assert one * (stretch - 1) > 0


# -- nothing to say about what is known to work ----------------------------------------------------


@pytest.mark.parametrize("name", cases)
def test_nothing_speaks_against_the_springs_of_the_paper(name: str) -> None:
    assert check_targets(cases[name]) == []


@pytest.mark.parametrize("name", ["C7", "T1", "CT4", "A4"])
def test_the_verdict_does_not_depend_on_units_and_size(name: str) -> None:
    assert check_targets(scaled(cases[name], length=1e-3, stress=1e6)) == []
    heavy = spring((10, 20), (-10, -2))
    levels = [f.level for f in check_targets(heavy)]
    assert levels == [f.level for f in check_targets(scaled(heavy, length=0.2, stress=5.0))]
    assert volume_shift(scaled(cases[name], length=0.3)) == pytest.approx(volume_shift(cases[name]))


# -- one thing wrong at a time ---------------------------------------------------------------------


def test_more_than_the_full_block_is_out_of_reach() -> None:
    bound = block_force(cases["C4"], 10.0)
    error = found(spring((10, 1.02 * bound), (-10, -2)), "out of reach")
    assert error.level == "error"
    assert f"{bound:.4g} N" in error.message
    assert "at least 1.02 times" in error.message
    assert found(spring((10, 0.98 * bound), (-10, -2)), "98 %").level == "warning"
    # A stiffer or a thicker spring can do it.
    for change in ({"K": 5.0, "G": 3 * 5 / 14}, {"T": 3.0}, {"L": 300.0}):
        problem = with_similar_weights(spring((10, 1.02 * bound), (-10, -2), **change))
        assert not [f for f in check_targets(problem) if f.level == "error"]


def test_a_compressed_block_bounds_compression() -> None:
    bound = block_force(cases["C4"], -20.0)
    assert found(spring((10, 2), (-20, 1.1 * bound)), "out of reach").level == "error"


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "mN"), (0.001, "kN")])
def test_forces_off_by_a_thousand_are_asked_for_their_unit(factor: float, unit: str) -> None:
    found(spring((10, 2 * factor), (-10, -2 * factor)), f"was it in {unit}?")


def test_displacements_in_metres_are_asked_for_their_unit() -> None:
    problem = spring((0.01, 2e-4), (-0.01, -2e-4))
    assert found(problem, "was it in m?").level == "error"
    # Where nothing else is wrong it is a doubt.
    assert found(with_similar_weights(problem), "was it in m?").level == "warning"


def test_a_mistaken_unit_comes_before_the_advice_that_follows_from_it() -> None:
    findings = check_targets(spring((0.01, 2.0), (-0.01, -2.0)))
    assert "was it in m?" in findings[0].message
    assert findings[0].level == "error"
    assert "stiffer material" in findings[1].message
    light = spring((0.01, 2e-4), (-0.01, -2e-4))
    later = [f.message for f in check_targets(light)]
    assert "was it in m?" in later[0]
    assert any("no spring at all is cheaper" in message for message in later[1:])
    # Displacements that would be too large in m are just small.
    small = found(spring((1e-4, 2e-5), (-1e-4, -2e-5)), "too little for contact")
    assert (small.level, "was it" in small.message) == ("warning", False)


def test_signs_that_are_all_wrong_are_a_convention() -> None:
    assert found(spring((10, -2), (-10, 2)), "change the sign of one column").level == "error"


def test_a_single_wrong_sign_is_a_bistable_spring() -> None:
    warning = found(spring((10, 2), (-10, -2), (-20, 1)), "bistable")
    assert warning.level == "warning"
    assert "d = -20 mm" in warning.message


def test_a_falling_force_is_a_snap_through() -> None:
    assert found(spring((10, 2), (20, 1.5)), "falls from 2 to 1.5 N").level == "warning"
    assert found(
        spring((10, 2), (-10, -2), (-20, -1.5)),
        "falls from -2 to -1.5 N between d = -10 and -20 mm",
    )
    assert not [f for f in check_targets(cases["C1"]) if "falls" in f.message]


def test_no_force_is_no_spring() -> None:
    assert found(spring((10, 2), (-10, 0)), "q = 0 at d = -10 mm").level == "warning"


def test_the_thinnest_straight_strut_marks_what_is_soft() -> None:
    problem = spring((10, 2), (-10, -2))
    straight, buckling = strut_forces(problem, 10.0)
    # Two elements of 1.25 mm, T = 1 mm, and the block's stress over 100 mm.
    assert straight == pytest.approx(2.5 / 100 * block_force(problem, 10.0))
    E_plane, width = 1 / (1 - 0.4**2), 2.5
    assert buckling == pytest.approx(4 * np.pi**2 * E_plane * width**3 / 12 / 100**2)
    assert found(spring((10, 0.9 * straight), (-10, -2)), "thinnest straight strut")
    assert not [f for f in check_targets(spring((10, 1.1 * straight))) if "thinnest" in f.message]
    # In compression even that strut buckles.
    assert not [
        f for f in check_targets(spring((10, 2), (-10, -1.1 * buckling))) if "thin" in f.message
    ]
    assert found(spring((10, 2), (-10, -0.9 * buckling)), "thinnest straight strut")


def test_a_thin_axisymmetric_strut_is_a_rod() -> None:
    straight, buckling = strut_forces(cases["A1"], 10.0)
    area = np.pi / 4 * 2.5**2
    assert straight == pytest.approx(area / (np.pi / 4 * 1e4) * block_force(cases["A1"], 10.0))
    assert buckling == pytest.approx(np.pi**3 * 2.5**4 / 16 / 100**2)


def test_targets_too_light_for_the_volume_term_mean_no_spring() -> None:
    # Forces of µN with the weights of N: what a small or soft spring gets without scaled weights.
    soft = scaled(spring((10, 2), (-10, -2)), length=0.1, stress=1e-3)
    wrong = soft.replace(
        control_points=[ControlPoint(p.d, p.q) for p in soft.control_points], k_rho=1e-8
    )
    error = found(wrong, "no spring at all is cheaper")
    assert error.level == "error"
    right = with_similar_weights(wrong)
    assert check_targets(right) == []
    assert f"k_rho = {right.k_rho:.2g}" in error.message


def test_the_volume_term_pulls_the_forces_down_by_the_shift_that_is_told() -> None:
    """A straight column, whose force and volume both grow with its width, minimises C."""
    problem = spring((10, 2), (20, 3.5), k_rho=3e-4)
    k_w = block_force(problem, 10.0), block_force(problem, 20.0)
    width = np.linspace(0, 0.5, 200001)
    C = sum(0.5 * (width * b - p.q) ** 2 for b, p in zip(k_w, problem.control_points, strict=True))
    free = width[C.argmin()]
    pulled = width[(C + problem.k_rho * 1e4 * width).argmin()]
    assert volume_shift(problem) == pytest.approx(1 - pulled / free, rel=0.1)
    assert found(problem, "below the targets").level == "warning"


def test_a_volume_that_does_not_count_is_told() -> None:
    assert found(spring((10, 2), (-10, -2), k_rho=1e-13), "hardly counts").level == "warning"
    assert not [f for f in check_targets(spring((10, 2), k_rho=0.0)) if "volume" in f.message]


def test_large_displacements_have_not_been_tried() -> None:
    assert found(spring((10, 2), (-60, -9)), "60 % of H").level == "warning"


def test_softening_in_tension_needs_the_robust_formulation() -> None:
    warning = found(spring((10, 2), (20, 3)), "needs a neck")
    assert "eta = 2 " in warning.message
    assert not [f for f in check_targets(cases["T1"]) if "neck" in f.message]
    assert not [f for f in check_targets(cases["C1"]) if "neck" in f.message]


def test_stronger_nonlinearity_than_in_the_paper_is_a_note() -> None:
    assert found(spring((10, 2), (-10, -2), (-20, -8)), "stiffens more than any").level == "note"
    assert found(spring((10, 2), (-10, -2), (-20, -2.2)), "softens more than any").level == "note"


def test_compression_alone_does_not_need_a_connected_spring() -> None:
    warning = found(spring((-10, -2), (-20, -4)), "no target in tension")
    assert "d = 10 mm, q = 2 N" in warning.message
    assert "add a row to the CSV, or a [[control_points]] to the TOML" in warning.message


def test_a_sign_error_is_not_advised_to_be_continued_into_tension() -> None:
    assert [f.message for f in check_targets(spring((-5, 1))) if "in tension" in f.message] == []
    # Only a point with the right sign is an example.
    warning = found(spring((-5, 1), (-10, -2)), "no target in tension")
    assert "d = 10 mm, q = 2 N" in warning.message


def test_mesh_material_and_shape_are_looked_at() -> None:
    assert found(spring((10, 2), elements=16), "thinner than the mesh resolves")
    assert found(spring((10, 2), K=5000.0), "closer to 0.5 than has been tried")
    assert found(spring((10, 2), H=300.0, l_i=4.0), "factor of 3").level == "note"


def test_errors_come_first() -> None:
    levels = [f.level for f in check_targets(spring((-10, -200), (-20, -1), l_i=0.1))]
    assert levels[0] == "error"
    assert levels == sorted(levels, key=("error", "warning", "note").index)
