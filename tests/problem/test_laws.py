"""A law is an energy of a deformation gradient; its stresses and moduli follow from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ngspring import (
    Design,
    SpringProblem,
    load_displacement,
    problem_from_curve,
    read_curve,
    scaled,
)
from ngspring.basics.errors import ProblemError
from ngspring.problem.annotated import annotated_toml
from ngspring.problem.kinematics.base import Value
from ngspring.problem.laws import LAWS, NeoHooke, law_from
from ngspring.problem.laws.base import Deformation, Law, Stretches, principal_stresses
from ngspring.problem.targets.full_block import block_force

STRETCHES = st.floats(0.2, 5.0)
LAW = NeoHooke(K=5 / 3, G=5 / 14)
POINT = "[[control_points]]\nd = 10\nq = 2\n"


@given(a=STRETCHES, b=STRETCHES, c=STRETCHES)
def test_neo_hooke_has_the_stresses_of_eq_17(a: float, b: float, c: float) -> None:
    J, mean = a * b * c, (a**2 + b**2 + c**2) / 3
    for stretch, stress in zip((a, b, c), principal_stresses(LAW, a, b, c), strict=True):
        kirchhoff = LAW.K * np.log(J) + LAW.G * J ** (-2 / 3) * (stretch**2 - mean)
        assert stress * stretch == pytest.approx(kirchhoff, rel=1e-10, abs=1e-12)


def test_the_initial_moduli_are_those_of_the_energy() -> None:
    law = LAWS["neo-hooke"](K=2.0, G=0.7)  # type: ignore[call-arg]
    K, G = law.initial_moduli
    e = 1e-6
    volumetric = principal_stresses(law, 1 + e, 1 + e, 1 + e)[0]
    assert volumetric / (3 * e) == pytest.approx(K, rel=1e-5)
    shear = principal_stresses(law, 1 + e, 1 / (1 + e), 1.0)[0]
    assert shear / (2 * e) == pytest.approx(G, rel=1e-5)
    assert law.energy(Stretches(1.0, 1.0, 1.0)) == pytest.approx(0.0, abs=1e-15)
    assert law.scaled(3.0).initial_moduli == pytest.approx((3 * K, 3 * G))


def test_stresses_of_many_stretches_come_in_their_order() -> None:
    a = np.array([2.0, 0.5, 1.0])
    together = principal_stresses(LAW, a, 1.0, 1.0)[0]
    alone = [float(principal_stresses(LAW, x, 1.0, 1.0)[0]) for x in a]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-14)


@dataclass(frozen=True)
class Cubic(Law):
    """A law that the package does not know, without derivatives by hand."""

    A: float
    K: float

    name: ClassVar[str] = "cubic"
    stresses: ClassVar[tuple[str, ...]] = ("A", "K")

    @property
    def initial_moduli(self) -> tuple[float, float]:
        return self.K, 2 * self.A

    def isochoric_energy(self, F: Deformation) -> Value:
        excess = F.exp(-2 / 3 * F.log_J) * F.I_1 - 3
        return self.A * (excess + excess * excess * excess)


def test_another_law_needs_nothing_but_its_place_in_the_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ngspring.problem.laws.LAWS", {"cubic": Cubic})
    text = f'elements = 8\nl_i = 10.0\n[material]\nlaw = "cubic"\nA = 0.2\nK = 1.6\n{POINT}'
    problem = SpringProblem.from_toml(text)
    assert problem.law == Cubic(0.2, 1.6)
    assert (problem.K, problem.G) == (1.6, 0.4)
    assert SpringProblem.from_toml(problem.to_toml()) == problem
    assert SpringProblem.from_toml(annotated_toml(problem, "a test")).law == problem.law
    assert scaled(problem, length=3.0, stress=2.0).law == Cubic(0.4, 3.2)
    with pytest.raises(ProblemError, match="K belongs to the cubic law"):
        problem.replace(K=2.0)
    # At small strains all laws of the same moduli are one.
    small = [0.01, -0.01]
    force = load_displacement(Design.column(problem), small, threads=1).q
    plain = problem.replace(material=NeoHooke(1.6, 0.4))
    expected = load_displacement(Design.column(plain), small, threads=1).q
    np.testing.assert_allclose(force, expected, rtol=1e-5)
    assert block_force(problem, 0.01) == pytest.approx(block_force(plain, 0.01), rel=1e-5)
    # At large ones the cubic term shows.
    assert block_force(problem, 60.0) > 1.1 * block_force(plain, 60.0)


# -- in a problem and its file ---------------------------------------------------------------------


def test_a_table_names_the_law_of_a_problem() -> None:
    text = f'[material]\nlaw = "neo-hooke"\nK = 2.0\nG = 0.5\n{POINT}'
    problem = SpringProblem.from_toml(text)
    assert problem.law == NeoHooke(2.0, 0.5)
    assert problem == SpringProblem(problem.control_points, K=2.0, G=0.5)
    assert SpringProblem.from_toml(problem.to_toml()) == problem


def test_the_law_of_a_similar_problem_is_similar() -> None:
    problem = SpringProblem.from_toml(POINT)
    assert scaled(problem, stress=7.0).law == problem.law.scaled(7.0)


@pytest.mark.parametrize(
    ("table", "part"),
    [
        ('law = "neohooke"\nK = 1.0\nG = 1.0', "did you mean 'neo-hooke'"),
        ("K = 1.0\nG = 1.0", "material.law = None"),
        ('law = "neo-hooke"\nK = 1.0', "missing key 'G'"),
        ('law = "neo-hooke"\nK = 1.0\nG = 1.0\nnu = 0.4', "unknown key 'nu' in material"),
        ('law = "neo-hooke"\nK = 1.0\nG = -1.0', "G = -1.0"),
        ('law = "neo-hooke"\nK = "1"\nG = 1.0', "K = '1'"),
    ],
)
def test_a_table_that_is_no_law_is_refused(table: str, part: str) -> None:
    with pytest.raises(ProblemError, match=part):
        SpringProblem.from_toml(f"[material]\n{table}\n{POINT}")


@pytest.mark.parametrize("key", ["K = 1.0", "G = 1.0", "E = 1.0", "nu = 0.4", "shore_A = 40"])
def test_a_law_and_moduli_describe_the_material_twice(key: str) -> None:
    table = '[material]\nlaw = "neo-hooke"\nK = 1.0\nG = 1.0'
    with pytest.raises(ProblemError, match="described twice"):
        SpringProblem.from_toml(f"{key}\n{table}\n{POINT}")


def test_what_is_no_law_is_refused() -> None:
    with pytest.raises(ProblemError, match="material"):
        SpringProblem.from_toml(POINT).replace(material="rubber")
    with pytest.raises(ProblemError, match="law"):
        law_from({"law": 3})


def test_a_problem_from_a_curve_may_have_a_law(tmp_path: Path) -> None:
    file = tmp_path / "curve.csv"
    file.write_text("d [mm],q [N]\n5,1\n10,2\n")
    curve = read_curve(file, 100.0, 100.0)
    law = NeoHooke(K=2.0, G=0.3)
    problem = problem_from_curve(curve, 2, material=law)
    assert problem.law == law
    assert (problem.K, problem.G) == (2.0, 0.3)
    with pytest.raises(ProblemError, match=r"described twice, by a law \(material\) and by nu"):
        problem_from_curve(curve, 2, material=law, nu=0.4)
