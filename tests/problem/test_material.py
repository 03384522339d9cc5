"""Elastic constants, hardness, and the table of elastomers."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ngspring.basics.errors import ProblemError
from ngspring.problem.kinematics import KINEMATICS
from ngspring.problem.laws import NeoHooke
from ngspring.problem.material import (
    ELASTOMERS,
    bulk_and_shear_modulus,
    find_elastomer,
    moduli_from,
    nu_advice,
    split_bulk_modulus,
    young_and_poisson,
    young_from_shore_A,
)
from ngspring.problem.spring import SpringProblem
from ngspring.problem.targets.full_block import uniaxial_stress

MODULI = st.floats(1e-6, 1e9)


def test_the_paper_s_solid_has_one_megapascal_and_two_fifths() -> None:
    assert young_and_poisson(SpringProblem.K, SpringProblem.G) == pytest.approx((1.0, 0.4))
    assert bulk_and_shear_modulus(1.0, 0.4) == pytest.approx((5 / 3, 5 / 14))


@given(E=MODULI, nu=st.floats(-0.99, 0.4999))
def test_conversion_there_and_back(E: float, nu: float) -> None:
    back = young_and_poisson(*bulk_and_shear_modulus(E, nu))
    assert back[0] == pytest.approx(E, rel=1e-9)
    assert back[1] == pytest.approx(nu, rel=1e-9, abs=1e-12)


@given(E=st.floats(0.1, 10.0), nu=st.floats(0.0, 0.49))
def test_a_bar_of_the_neo_hookean_solid_begins_with_slope_E(E: float, nu: float) -> None:
    K, G = bulk_and_shear_modulus(E, nu)
    t = 1e-5

    def slope(kinematics: str) -> float:
        forth, back = (
            uniaxial_stress(1 + s * t, NeoHooke(K, G), KINEMATICS[kinematics]) for s in (1, -1)
        )
        return (forth - back) / (2 * t)

    assert slope("axisymmetric") == pytest.approx(E, rel=1e-6)
    assert slope("plane strain") == pytest.approx(E / (1 - nu**2), rel=1e-6)


@pytest.mark.parametrize("nu", [0.5, 0.6, -1.0, float("nan"), "0.4", True, None])
def test_nu_has_its_bounds(nu: Any) -> None:
    with pytest.raises(ProblemError, match=r"^nu = "):
        bulk_and_shear_modulus(1.0, nu)


@pytest.mark.parametrize("E", [0.0, -1.0, float("inf"), "1"])
def test_E_is_positive(E: Any) -> None:
    with pytest.raises(ProblemError, match=r"^E = "):
        bulk_and_shear_modulus(E, 0.4)


@pytest.mark.parametrize(("K", "G"), [(0.0, 1.0), (1.0, -1.0)])
def test_moduli_are_positive(K: float, G: float) -> None:
    with pytest.raises(ProblemError, match="must be positive"):
        young_and_poisson(K, G)


def test_gent_s_relation_at_known_hardnesses() -> None:
    # Worked by hand from the formula.
    assert young_from_shore_A(50) == pytest.approx(0.0981 * 437.168 / (0.137505 * 127.0))
    assert young_from_shore_A(50) == pytest.approx(2.456, abs=1e-3)
    assert young_from_shore_A(30) == pytest.approx(1.142, abs=1e-3)


@given(a=st.floats(1, 98), step=st.floats(0.1, 1.0))
def test_harder_is_stiffer(a: float, step: float) -> None:
    assert young_from_shore_A(a + step) > young_from_shore_A(a)


@pytest.mark.parametrize("value", [0, 100, 120, -5, "50"])
def test_hardness_has_its_bounds(value: Any) -> None:
    with pytest.raises(ProblemError, match=r"^shore_A = "):
        young_from_shore_A(value)


@pytest.mark.parametrize("elastomer", ELASTOMERS, ids=lambda e: e.name)
def test_the_table_is_consistent(elastomer: Any) -> None:
    low, high = elastomer.shore_A
    assert 0 < low < elastomer.typical < high < 100
    assert find_elastomer(elastomer.name.upper()) is elastomer
    if elastomer.symbol:
        assert find_elastomer(f" {elastomer.symbol.lower()}") is elastomer


def test_a_slip_in_a_name_names_what_was_meant() -> None:
    with pytest.raises(ProblemError, match=r"did you mean 'silicone'\?"):
        find_elastomer("silicon")


@pytest.mark.parametrize(
    ("name", "hardness"),
    [
        ("silicone rubber", 30.0),
        ("Dragon Skin 30", 30.0),
        ("dragon-skin 10A", 10.0),
        ("TPU 95A", 95.0),
        ("TPU-85A", 85.0),
        ("NBR 70", 70.0),
        ("EPDM 60 Shore A", 60.0),
        ("Silicone Shore A 40", 40.0),
    ],
)
def test_elastomers_are_found_by_the_names_people_use(name: str, hardness: float) -> None:
    assert find_elastomer(name).typical == hardness
    expected = bulk_and_shear_modulus(young_from_shore_A(hardness), 0.4)
    assert moduli_from({"material": name}) == expected


def test_pdms_is_as_stiff_as_was_measured() -> None:
    # Johnston et al. 2014: 1.32 to 2.97 MPa, cured at 25 to 200 °C.
    assert find_elastomer("pdms") is find_elastomer("Sylgard 184")
    assert 1.32 < young_from_shore_A(find_elastomer("PDMS").typical) < 2.97


@pytest.mark.parametrize(
    "name", ["nylon", "PA12", "PLA", "Ecoflex 00-30", "TPU 64D", "TPE", "x" * 99]
)
def test_what_has_no_shore_A_hardness_is_refused_without_another_name(name: str) -> None:
    with pytest.raises(ProblemError, match="give its Young's modulus E in MPa and nu") as error:
        find_elastomer(name)
    assert "did you mean" not in str(error.value)
    assert len(str(error.value)) <= 300


def test_a_material_is_described_in_one_way() -> None:
    assert moduli_from({"K": 1.0, "L": 3.0}) is None
    assert moduli_from({"E": 2.0}) == pytest.approx(bulk_and_shear_modulus(2.0, 0.4))
    assert moduli_from({"E": 2, "nu": 0.3}) == pytest.approx(bulk_and_shear_modulus(2.0, 0.3))
    of_hardness = bulk_and_shear_modulus(young_from_shore_A(40), 0.45)
    assert moduli_from({"shore_A": 40, "nu": 0.45}) == pytest.approx(of_hardness)
    assert moduli_from({"material": "NR", "shore_A": 40, "nu": 0.45}) == of_hardness
    typical = bulk_and_shear_modulus(young_from_shore_A(50), 0.4)
    assert moduli_from({"material": "natural rubber"}) == typical


@pytest.mark.parametrize(
    ("described", "part"),
    [
        ({"E": 1, "K": 1}, "described twice, by E and by K"),
        ({"nu": 0.4, "G": 1}, "described twice, by nu and by G"),
        ({"nu": 0.4}, "nu is given without"),
        ({"E": 1, "shore_A": 50}, "described twice, by E and by shore_A"),
        ({"E": 1, "material": "NR"}, "described twice, by E and by material"),
        ({"material": 3}, "there is no material"),
        ({"shore_A": "soft"}, "shore_A = 'soft'"),
        ({"E": "1 MPa"}, "E = '1 MPa'"),
    ],
)
def test_contradictory_materials_are_refused(described: dict[str, Any], part: str) -> None:
    with pytest.raises(ProblemError, match=part):
        moduli_from(described)


def test_only_solids_closer_to_incompressible_than_has_been_tried_get_advice() -> None:
    for nu in (0.45, 0.49, 0.4999):
        assert nu_advice(young_and_poisson(*bulk_and_shear_modulus(1.7, nu))[1]) == ""
    assert "0.49999" in nu_advice(0.49999)


@pytest.mark.parametrize("nu", [-0.2, 0.4, 0.45])
def test_all_of_k_is_carried_point_by_point_up_to_a_poissons_ratio_of_0_45(nu: float) -> None:
    K, G = bulk_and_shear_modulus(1.7, nu)
    assert split_bulk_modulus(K, G) == (K, 0.0)


def test_of_a_larger_k_no_more_than_that_is_carried_point_by_point() -> None:
    largest, G = bulk_and_shear_modulus(1.7, 0.45)
    for ratio in (1 + 1e-6, 1.5, 500.0):
        carried, excess = split_bulk_modulus(ratio * largest, G)
        assert carried == pytest.approx(largest, rel=1e-12)
        assert carried + excess == pytest.approx(ratio * largest, rel=1e-15)
        assert excess > 0.0
