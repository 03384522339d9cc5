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
from ngspring.problem.kinematics import KINEMATICS
from ngspring.problem.kinematics.base import Value
from ngspring.problem.laws import (
    LAWS,
    ArrudaBoyce,
    Gent,
    MooneyRivlin,
    NeoHooke,
    Ogden,
    Yeoh,
    law_from,
)
from ngspring.problem.laws.base import Deformation, Law, Stretches, principal_stresses
from ngspring.problem.laws.modes import MODES, tangent
from ngspring.problem.laws.stability import instability, stable_range
from ngspring.problem.targets.full_block import block_force, uniaxial_stress
from ngspring.problem.targets.plausibility import check_targets

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


# -- the laws --------------------------------------------------------------------------------------

#: One of each, with none of its parameters negligible.
EXAMPLES: tuple[Law, ...] = (
    NeoHooke(K=2.0, G=0.7),
    MooneyRivlin(K=2.0, C10=0.2, C01=0.1),
    Yeoh(K=2.0, C10=0.17, C20=-0.003, C30=0.0001),
    Ogden(K=2.0, mu1=0.63, alpha1=1.3, mu2=0.0012, alpha2=5.0, mu3=-0.01, alpha3=-2.0),
    Gent(K=2.0, mu=0.4, J_m=90.0),
    ArrudaBoyce(K=2.0, mu=0.3, lambda_m=2.8),
)
each_law = pytest.mark.parametrize("law", EXAMPLES, ids=[law.name for law in EXAMPLES])
LOADED = np.array([0.4, 0.7, 0.999, 1.001, 1.3, 2.5])


def slopes(law: Law, I_1: np.ndarray, I_2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """dW/dI_1 and dW/dI_2, from the textbook."""
    one, x = np.ones_like(I_1), I_1 - 3
    if isinstance(law, NeoHooke):
        return law.G / 2 * one, 0 * one
    if isinstance(law, MooneyRivlin):
        return law.C10 * one, law.C01 * one
    if isinstance(law, Yeoh):
        return law.C10 + 2 * law.C20 * x + 3 * law.C30 * x**2, 0 * one
    if isinstance(law, Gent):
        return law.mu / 2 * law.J_m / (law.J_m - x), 0 * one
    assert isinstance(law, ArrudaBoyce)
    a, n = law.mu, law.lambda_m
    series = 1 / 2 + I_1 / (10 * n**2) + 33 * I_1**2 / (1050 * n**4) + 76 * I_1**3 / (7000 * n**6)
    return a * (series + 2595 * I_1**4 / (673750 * n**8)), 0 * one


def textbook_stress(law: Law, mode: str, x: np.ndarray) -> np.ndarray:
    """Nominal stress of an incompressible solid, Treloar's formulas."""
    if isinstance(law, Ogden):
        side = {"uniaxial": -1 / 2, "planar": -1.0, "equibiaxial": -2.0}[mode]
        return np.asarray(
            sum(mu * (x ** (alpha - 1) - x ** (side * alpha - 1)) for mu, alpha in law.terms)
        )
    if mode == "uniaxial":
        W_1, W_2 = slopes(law, x**2 + 2 / x, 2 * x + 1 / x**2)
        return 2 * (x - x**-2.0) * (W_1 + W_2 / x)
    if mode == "planar":
        W_1, W_2 = slopes(law, x**2 + 1 + x**-2.0, x**2 + 1 + x**-2.0)
        return 2 * (x - x**-3.0) * (W_1 + W_2)
    W_1, W_2 = slopes(law, 2 * x**2 + x**-4.0, x**4 + 2 * x**-2.0)
    return 2 * (x - x**-5.0) * (W_1 + x**2 * W_2)


@each_law
@pytest.mark.parametrize("mode", MODES)
def test_stresses_are_those_of_the_textbook(law: Law, mode: str) -> None:
    found = MODES[mode].nominal_stress(law, LOADED)
    np.testing.assert_allclose(found, textbook_stress(law, mode, LOADED), rtol=1e-10)
    # And so are those of all three directions, when the force along the third one is taken off.
    stretches = [LOADED**exponent for exponent in MODES[mode].exponents]
    along, _, free = principal_stresses(law, *stretches)
    np.testing.assert_allclose(along - free * stretches[2] / stretches[0], found, rtol=1e-10)


@each_law
def test_a_change_of_volume_alone_is_that_of_eq_14(law: Law) -> None:
    x = np.array([0.6, 0.9, 1.2, 2.0])
    np.testing.assert_allclose(
        principal_stresses(law, x, x, x)[0], law.K * 3 * np.log(x) / x, rtol=1e-10
    )
    np.testing.assert_allclose(law.isochoric_energy(Stretches(x, x, x)), 0.0, rtol=0, atol=1e-14)


@each_law
def test_at_small_strains_every_law_is_hookes(law: Law) -> None:
    K, G = law.initial_moduli
    e = 1e-6
    assert principal_stresses(law, 1 + e, 1 + e, 1 + e)[0] / (3 * e) == pytest.approx(K, rel=1e-5)
    shear = principal_stresses(law, 1 + e, 1 / (1 + e), 1.0)[0]
    assert shear / (2 * e) == pytest.approx(G, rel=1e-5)
    assert law.energy(Stretches(1.0, 1.0, 1.0)) == pytest.approx(0.0, abs=1e-15)
    assert law.scaled(3.0).initial_moduli == pytest.approx((3 * K, 3 * G))


@given(a=STRETCHES, b=STRETCHES, c=STRETCHES)
def test_two_laws_with_special_parameters_are_others(a: float, b: float, c: float) -> None:
    """Powers of 2 are I_1, of -2 are I_2; no limit of the chains is neo-Hooke."""
    pairs = [
        (Ogden(2.0, 0.7, 2.0), NeoHooke(2.0, 0.7)),
        (Ogden(2.0, 0.4, 2.0, -0.3, -2.0), MooneyRivlin(2.0, 0.2, 0.15)),
        (Yeoh(2.0, 0.35, 0.0, 0.0), NeoHooke(2.0, 0.7)),
        (Gent(2.0, 0.7, 1e9), NeoHooke(2.0, 0.7)),
        (ArrudaBoyce(2.0, 0.7, 1e5), NeoHooke(2.0, 0.7)),
    ]
    for one, other in pairs:
        found, expected = principal_stresses(one, a, b, c), principal_stresses(other, a, b, c)
        size = max(np.abs(expected))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * size + 1e-12)


@pytest.mark.parametrize("law", [EXAMPLES[1], EXAMPLES[2], EXAMPLES[3]], ids=lambda law: law.name)
def test_another_library_has_the_same_stresses(law: Law) -> None:
    """Of the change of shape, for any deformation gradient turned to its principal axes."""
    hyperelastic = pytest.importorskip("hyperelastic")
    models = hyperelastic.models
    if isinstance(law, Ogden):
        mu = [m * alpha / 2 for m, alpha in law.terms]
        framework = hyperelastic.StretchesFramework(
            models.stretches.Ogden(mu=mu, alpha=[alpha for _, alpha in law.terms])
        )
    else:
        coefficients = {k: v for k, v in law.parameters.items() if k != "K"}
        framework = hyperelastic.InvariantsFramework(
            models.invariants.ThirdOrderDeformation(**coefficients)
        )
    space = hyperelastic.DistortionalSpace(framework)
    stretches = np.array([1.7, 0.9, 0.8])
    F = np.diag(stretches).reshape(3, 3, 1, 1)
    P = np.asarray(space.gradient([F, None])[0]).reshape(3, 3)
    volumetric = law.K * np.log(stretches.prod()) / stretches
    found = np.array(principal_stresses(law, *stretches)) - volumetric
    np.testing.assert_allclose(found, np.diag(P), rtol=1e-10, atol=1e-12)


# -- where they are stable -------------------------------------------------------------------------


def test_the_tangent_is_that_of_neo_hooke() -> None:
    """W = G/2 sum exp(2 e_i): second derivatives by logarithmic strains of a free third axis."""
    G, first, second = 0.7, np.array([1.0, 1.5, 0.6]), np.array([1.0, 1.2, 1.1])
    a, b, c = first**2, second**2, (first * second) ** -2
    least = [
        np.linalg.eigvalsh(2 * G * np.array([[i + k, k], [k, j + k]]))[0]
        for i, j, k in zip(a, b, c, strict=True)
    ]
    np.testing.assert_allclose(tangent(NeoHooke(2.0, G), first, second), least, rtol=1e-8)


def test_convex_laws_are_stable_wherever_they_are_examined() -> None:
    for law in (*EXAMPLES[:2], EXAMPLES[3], EXAMPLES[5]):
        assert set(stable_range(law).ranges.values()) == {(0.1, 10.0)}
        assert stable_range(law).first_limit() == (float("inf"), "")


def test_a_polynomial_that_turns_down_is_stable_up_to_its_steepest_place() -> None:
    law = Yeoh(K=2.0, C10=0.17, C20=-0.02, C30=0.0)
    low, high = stable_range(law).ranges["planar"]
    assert low == pytest.approx(1 / high, rel=1e-6)
    # Along the path the Kirchhoff stress 2 (x^2 - x^-2) W_1 still grows there ...
    x = np.linspace(1.0, high, 200)
    stress = x * MODES["planar"].nominal_stress(law, x)
    assert (np.diff(stress) > 0).all()
    # ... and with a little more, in some direction of the plane it does not.
    assert tangent(law, np.array([1.01 * high]), np.array([1.0]))[0] < 0.0


def test_gents_law_ends_where_its_chains_lock() -> None:
    law = Gent(K=2.0, mu=0.4, J_m=30.0)
    ranges = stable_range(law).ranges
    x = ranges["uniaxial"][1]
    assert x**2 + 2 / x - 3 == pytest.approx(30.0, rel=1e-3)
    x = ranges["planar"][1]
    assert x**2 + 1 / x**2 - 2 == pytest.approx(30.0, rel=1e-3)


def test_a_solid_that_leaves_the_stable_range_is_told_so() -> None:
    law = Yeoh(K=2.0, C10=0.17, C20=-0.02, C30=0.0)
    plane, turned = KINEMATICS["plane strain"], KINEMATICS["axisymmetric"]
    limit = stable_range(law).ranges["planar"][1]
    assert instability(law, 0.99 * limit, plane) == ""
    assert f"{limit:.3g} (planar" in instability(law, 1.01 * limit, plane)
    # A body of revolution may be stretched in both directions: that limit comes first.
    assert "(equibiaxial" in instability(law, 0.99 * limit, turned)
    assert instability(EXAMPLES[0], 50.0, turned) == ""


def test_targets_beyond_what_a_law_is_good_for_are_warned_of() -> None:
    table = '[material]\nlaw = "yeoh"\nK = 2.0\nC10 = 0.17\nC20 = -0.02\nC30 = 0.0\n'
    far = SpringProblem.from_toml(f"{table}[[control_points]]\nd = 95\nq = 1\n")
    near = SpringProblem.from_toml(table + POINT)
    said = [f.message for f in check_targets(far) if f.level == "warning"]
    assert any("a factor of 1.95" in message and "stable" in message for message in said)
    assert any(f.level == "note" and "stable only" in f.message for f in check_targets(near))


def test_a_block_beyond_the_limit_of_its_chains_carries_whatever_one_likes() -> None:
    law = Gent(K=2.0, mu=0.4, J_m=3.0)
    plane = KINEMATICS["plane strain"]
    assert uniaxial_stress(1.5, law, plane) == pytest.approx(
        uniaxial_stress(1.5, law.scaled(2.0), plane) / 2
    )
    assert uniaxial_stress(6.0, law, plane) == np.inf
    assert uniaxial_stress(0.1, law, plane) == -np.inf


# -- in a problem and its file ---------------------------------------------------------------------


def test_a_table_names_the_law_of_a_problem() -> None:
    text = f'[material]\nlaw = "neo-hooke"\nK = 2.0\nG = 0.5\n{POINT}'
    problem = SpringProblem.from_toml(text)
    assert problem.law == NeoHooke(2.0, 0.5)
    assert problem == SpringProblem(problem.control_points, K=2.0, G=0.5)
    assert SpringProblem.from_toml(problem.to_toml()) == problem


@each_law
def test_every_law_goes_through_a_file_and_back(law: Law) -> None:
    problem = SpringProblem.from_toml(POINT).replace(material=law)
    again = SpringProblem.from_toml(problem.to_toml())
    assert again == problem
    assert again.law == law
    assert pytest.approx(law.initial_moduli) == (again.K, again.G)
    text = "\n".join(f"{key} = {value}" for key, value in law.parameters.items())
    assert SpringProblem.from_toml(f'[material]\nlaw = "{law.name}"\n{text}\n{POINT}') == problem


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
        ('law = "mooney-rivlin"\nK = 1.0\nC10 = 0.1\nC01 = -0.1', "C10 \\+ C01 = 0.0"),
        ('law = "yeoh"\nK = 1.0\nC10 = 0.0\nC20 = 0.1\nC30 = 0.1', "C10 = 0.0"),
        ('law = "yeoh"\nK = 1.0\nC10 = 0.1\nC20 = nan\nC30 = 0.1', "C20 = nan"),
        ('law = "gent"\nK = 1.0\nmu = 0.1\nJ_m = -3', "J_m = -3.0"),
        ('law = "gent"\nK = 1.0\nmu = 1e99\nJ_m = 3', "mu = 1e\\+99"),
        ('law = "arruda-boyce"\nK = 1.0\nmu = 0.1\nlambda_m = 0.9', "lambda_m = 0.9"),
        ('law = "ogden"\nK = 1.0\nmu1 = 0.1\nalpha1 = 0', "alpha1 = 0.0"),
        ('law = "ogden"\nK = 1.0\nmu1 = 0.1\nalpha1 = -2', "G = -0.1 MPa"),
        ('law = "ogden"\nK = 1.0\nmu1 = 0.1\nalpha1 = 99', "alpha1 = 99.0"),
        ('law = "ogden"\nK = 1.0\nmu1 = 0.1\nalpha1 = 2\nmu2 = 0.1', "mu2 = 0.1 and alpha2"),
        ('law = "ogden"\nK = 1.0\nmu1 = 0.1', "missing key 'alpha1'"),
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
