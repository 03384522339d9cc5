"""A law is found from tests, says how sure it is, and goes into a problem as a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ngspring
from ngspring import MaterialTest, SpringProblem, fit, fit_all, read_material_test
from ngspring.basics.errors import NgspringError, ProblemError
from ngspring.problem.fit.candidates import CANDIDATES
from ngspring.problem.fit.data import parse_material_test
from ngspring.problem.fit.fitting import Fit
from ngspring.problem.laws import LAWS, ArrudaBoyce, Gent, MooneyRivlin, NeoHooke, Ogden, Yeoh
from ngspring.problem.laws.base import Law
from ngspring.problem.laws.modes import MODES
from ngspring.problem.laws.named import NAMED

DATA = Path(__file__).parent / "material-tests"
UNIAXIAL, PLANAR = DATA / "treloar-uniaxial.csv", DATA / "treloar-planar.csv"
SILICONE = DATA / "meunier-silicone.csv"
STRETCHES = np.array([0.6, 0.8, 0.9, 1.1, 1.3, 1.6, 2.0, 2.5, 3.0])
POINT = "[[control_points]]\nd = 10\nq = 0.5\n"

TRUE: dict[str, Law] = {
    "neo-hooke": NeoHooke(1.0, 0.4),
    "mooney-rivlin": MooneyRivlin(1.0, 0.2, 0.05),
    "yeoh": Yeoh(1.0, 0.2, -0.01, 0.002),
    "ogden-1": Ogden(1.0, 0.3, 2.6),
    "ogden-2": Ogden(1.0, 0.5, 1.4, 0.004, 5.5),
    "ogden-3": Ogden(1.0, 0.5, 1.4, 0.004, 5.5, -0.05, -2.0),
    "gent": Gent(1.0, 0.4, 25.0),
    "arruda-boyce": ArrudaBoyce(1.0, 0.35, 2.5),
}


def measured(law: Law, *tests: str, noise: float = 0.0, seed: int = 0) -> list[MaterialTest]:
    """Tests as they would be if the material had this law."""
    random = np.random.default_rng(seed)
    return [
        MaterialTest(
            test,
            STRETCHES,
            MODES[test].nominal_stress(law, STRETCHES)
            * (1 + noise * random.standard_normal(len(STRETCHES))),
        )
        for test in tests
    ]


def shape_parameters(found: Fit) -> list[float]:
    return [value for name, value in found.law.parameters.items() if name != "K"]


# -- least squares ---------------------------------------------------------------------------------


def test_every_law_can_be_fitted() -> None:
    assert {name.rstrip("-123") for name in CANDIDATES} == set(LAWS)
    assert set(TRUE) == set(CANDIDATES)


@pytest.mark.parametrize("name", [name for name in TRUE if name != "ogden-3"])
def test_parameters_that_made_the_data_are_found_again(name: str) -> None:
    found = fit(measured(TRUE[name], *MODES), name)
    assert found.largest_error < 1e-6
    expected = [value for key, value in TRUE[name].parameters.items() if key != "K"]
    if isinstance(TRUE[name], Ogden):  # terms in any order
        assert sorted(shape_parameters(found)) == pytest.approx(sorted(expected), rel=1e-4)
    else:
        assert shape_parameters(found) == pytest.approx(expected, rel=1e-4)


def test_three_terms_are_at_least_as_good_as_two() -> None:
    tests = measured(TRUE["ogden-3"], *MODES)
    two, three = fit(tests, "ogden-2"), fit(tests, "ogden-3")
    assert three.mean_error <= two.mean_error
    assert three.largest_error < 0.01


def test_the_uncertainty_is_how_far_repeated_tests_scatter() -> None:
    law = TRUE["mooney-rivlin"]
    fits = [
        fit(measured(law, "uniaxial", "planar", noise=0.01, seed=seed), "mooney-rivlin")
        for seed in range(60)
    ]
    for k, name in enumerate(("C10", "C01")):
        scatter = np.std([shape_parameters(each)[k] for each in fits])
        said = np.sqrt(np.mean([each.uncertainty[name] ** 2 for each in fits]))
        assert said == pytest.approx(scatter, rel=0.35)


def test_what_the_tests_cannot_tell_is_said() -> None:
    # In planar tension both invariants are equal: only C10 + C01 shows.
    found = fit(measured(TRUE["mooney-rivlin"], "planar"), "mooney-rivlin")
    assert set(found.uncertainty.values()) == {np.inf}
    assert sum(shape_parameters(found)) == pytest.approx(0.25)
    assert any("do not determine C10, C01" in text for text in found.remarks)
    # As many points as parameters leave nothing to judge errors by.
    few = MaterialTest("planar", STRETCHES[-3:], np.array([0.7, 0.9, 1.2]))
    assert np.isnan(list(fit(few, "yeoh").uncertainty.values())).all()


def test_a_planar_test_counts_twice() -> None:
    soft, stiff = NeoHooke(1.0, 0.3), NeoHooke(1.0, 0.4)
    tests = [*measured(soft, "uniaxial"), *measured(stiff, "planar")]
    # Errors G/0.3 - 1 and 1 - G/0.4, weighed 1 : 2.
    expected = (1 / 0.3 + 2 / 0.4) / (1 / 0.3**2 + 2 / 0.4**2)
    assert shape_parameters(fit(tests, "neo-hooke")) == pytest.approx([expected], rel=0.01)
    assert any("no planar test" in text for text in fit(tests[0], "neo-hooke").remarks)
    assert not any("no planar test" in text for text in fit(tests, "neo-hooke").remarks)


def test_the_unit_of_stress_does_not_decide() -> None:
    test = read_material_test(PLANAR)
    for name in ("yeoh", "gent", "ogden-1"):
        found = fit(test, name)
        softer = fit(MaterialTest("planar", test.stretch, 1e-6 * test.stress), name)
        assert softer.mean_error == pytest.approx(found.mean_error, rel=1e-4)
        G = found.law.initial_moduli[1]
        assert softer.law.initial_moduli[1] == pytest.approx(1e-6 * G, rel=1e-3)


# -- published data --------------------------------------------------------------------------------


def test_ogdens_law_of_three_terms_follows_treloars_rubber_to_rupture() -> None:
    found = fit(UNIAXIAL, "ogden-3")
    assert found.largest_error < 0.04
    assert found.stable.ranges["uniaxial"] == (0.1, 10.0)


def test_yeohs_law_follows_treloars_rubber_as_far_as_springs_go() -> None:
    found = fit([UNIAXIAL, PLANAR], "yeoh", stretches=(1.05, 3.0))
    assert found.mean_error < 0.05
    assert all(test.stretch.max() < 3.0 for test in found.tests)
    # Treloar's rubber: about 0.4 MPa.
    assert found.law.initial_moduli[1] == pytest.approx(0.4, rel=0.1)
    neo_hooke = fit([UNIAXIAL, PLANAR], "neo-hooke", stretches=(1.05, 3.0))
    assert neo_hooke.mean_error > 2 * found.mean_error


def test_compression_and_tension_of_a_silicone_are_fitted_together() -> None:
    found = fit(SILICONE, "ogden-2")
    assert found.largest_error < 0.025
    assert {float(np.sign(s)) for s in found.tests[0].stress} == {-1.0, 1.0}


def test_the_named_silicones_are_the_fits_to_their_measurements() -> None:
    for each in NAMED.values():
        test = MaterialTest("uniaxial", np.array([1.5, 2.0, 3.0]), np.array(each.stresses))
        found = fit(test, "ogden-1")
        assert [each.mu1, each.alpha1] == pytest.approx(shape_parameters(found), rel=2e-4)
        assert found.largest_error < 0.02
        assert found.stable.first_limit()[1] == ""


def test_a_comparison_puts_the_best_first_and_leaves_out_what_has_too_many_parameters() -> None:
    fits = fit_all(MaterialTest("uniaxial", np.array([1.5, 2.0, 3.0]), np.array([0.2, 0.4, 0.9])))
    errors = [each.mean_error for each in fits]
    assert errors == sorted(errors)
    assert {each.candidate for each in fits} == set(CANDIDATES) - {"ogden-2", "ogden-3"}
    unstable = next(each for each in fits if each.candidate == "mooney-rivlin")
    assert any("the law is stable in uniaxial tests only" in text for text in unstable.remarks)


# -- files of tests --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "strain [%];stress [kPa]\n10;20\n50;90\n",
        "stretch,nominal stress [MPa]\n1.1,0.02\n1.5,0.09\n",
        "# a sheet\n\nstress / MPa\tstrain / -\n0.02\t0.1\n0.09\t0.5\n",
        "strain [-];true stress [MPa]\n0,1;0,022\n0,5;0,135\n",
        "true strain [-];stress [MPa]\n0.0953101798;0.02\n0.4054651081;0.09\n",
        # Databases give both measures, and much else above them.
        "PARAMETER;INFO;;;\nSpecimen Width (mm);6;;;\n;;;;\n"
        "Time (s);True Strain;True Stress (MPa);Engineering Strain;Engineering Stress (MPa)\n"
        "0.1;0.0953;0.022;0.1;0.02\n0.2;0.405;0.135;0.5;0.09\n",
    ],
)
def test_stress_and_strain_are_read_however_they_are_written(text: str) -> None:
    test = parse_material_test(text, "planar")
    np.testing.assert_allclose(test.stretch, [1.1, 1.5], rtol=1e-8)
    np.testing.assert_allclose(test.stress, [0.02, 0.09], rtol=1e-8)


@pytest.mark.parametrize(
    ("name", "line", "expected"),
    [
        ("a.csv", "Pure shear, 23 °C", "planar"),
        ("planar.csv", "", "planar"),
        ("sheet-plane-strain.csv", "", "planar"),
        ("b.csv", "Equi-biaxial", "equibiaxial"),
        ("biaxial.csv", "", "equibiaxial"),
        ("tensile.csv", "", "uniaxial"),
        ("uniaxial.csv", "compared with pure shear", "uniaxial"),
        ("c.csv", "", "uniaxial"),
    ],
)
def test_a_word_tells_which_test_it_was(name: str, line: str, expected: str) -> None:
    text = f"# {line}\nstrain [-];stress [MPa]\n0.1;0.02\n0.5;0.09\n"
    test = parse_material_test(text, name=name)
    assert test.test == expected
    guessed = any("nothing says which test" in remark for remark in test.remarks)
    assert guessed == (name == "c.csv")
    assert parse_material_test(text, "equibiaxial", name=name).test == "equibiaxial"


def test_signs_of_a_compression_test_are_turned() -> None:
    text = "strain [%];stress [MPa]\n10;0.2\n30;0.9\n"
    test = parse_material_test(text, compression=True)
    np.testing.assert_allclose(test.stretch, [0.7, 0.9])
    np.testing.assert_allclose(test.stress, [-0.9, -0.2])
    named = parse_material_test(text.replace("strain", "compressive strain"))
    np.testing.assert_allclose(named.stretch, [0.7, 0.9])
    with pytest.raises(ProblemError, match="strains are negative"):
        parse_material_test("strain;stress\n-0.1;-0.2\n-0.3;-0.9\n", compression=True)


@pytest.mark.parametrize("branch", [None, "loading", "unloading", "mean"])
def test_one_branch_of_a_test_with_loops_is_taken(branch: str | None) -> None:
    up = np.linspace(0.0, 1.0, 26)
    law = TRUE["neo-hooke"]
    rows = [(x, float(MODES["planar"].nominal_stress(law, 1 + x))) for x in up]
    rows += [(x, 0.8 * stress) for x, stress in reversed(rows)]
    text = "strain;stress\n" + "".join(f"{x:.9f};{stress:.9f}\n" for x, stress in rows)
    test = parse_material_test(text, "planar", branch=branch)
    assert (np.diff(test.stretch) > 0).all()
    inside = test.between(1.1, 1.9)  # at the ends both branches meet
    share = inside.stress / MODES["planar"].nominal_stress(law, inside.stretch)
    expected = {"unloading": 0.8, "mean": 0.9}.get(branch or "", 1.0)
    np.testing.assert_allclose(share, expected, rtol=0.01)
    assert any(branch or "loading" in remark for remark in test.remarks)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "no rows of numbers"),
        ("strain;stress\n", "no rows of numbers"),
        ("0.1;0.2\n0.2;0.3\n", "no header says what the columns are"),
        ("strain;stress\n0.5;0.09\n", "1 points apart from rest"),
        ("strain;stress\n0;0\n0;0\n0.1;0.2\n", "1 points apart from rest"),
        ("strain;stress\n0.1;nan\n0.5;0.09\n", "line 2"),
        ("strain;stress\n0.1;soft\n0.5;0.09\n", "line 2"),
        ("d [mm];q [N]\n1;2\n2;3\n", "displacement and force"),
        ("strain;force\n1;2\n2;3\n", "there is a column for q but none for d"),
        ("strain [-];stress [MPa]\n80;2\n120;3\n", "a stretch of 81"),
        ("strain [-];stress [MPa]\n-1.5;2\n0.1;3\n", "beyond what is possible"),
        ("strain;stress [MPa]\n0.1;-0.2\n0.5;-0.9\n", "at a stretch of 1.5 the stress is -0.9"),
        ("strain;stress [MPa]\n0.1;0\n0.5;0\n", "all stresses of the test are zero"),
        ("strain;stress [mm]\n0.1;0\n0.5;0\n", "unit 'mm'"),
        ("PK2 stress;green strain\n0.1;0.1\n0.5;0.2\n", "neither nominal nor true"),
    ],
)
def test_what_is_no_test_is_refused(text: str, part: str) -> None:
    with pytest.raises(ProblemError) as error:
        parse_material_test(text)
    assert part in str(error.value)
    assert "\n" not in str(error.value)


@given(st.text(max_size=200) | st.text("0123456789.,;-e\nstrain ", max_size=200))
@settings(max_examples=60)
def test_any_text_is_a_test_or_refused_in_one_line(text: str) -> None:
    for header in ("", "stretch;stress [MPa]\n"):
        message = "a line"
        try:
            test = parse_material_test(header + text)
            assert np.isfinite([test.stretch, test.stress]).all()
        except NgspringError as error:
            message = str(error)
        assert len(message.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ({"law": "yeho"}, "did you mean 'yeoh'"),
        ({"nu": 0.5}, "nu = 0.5"),
        ({"nu": float("nan")}, "nu = nan"),
        ({"law": "ogden-3", "stretches": (1.0, 1.5)}, "5 points, but ogden-3 has 6 parameters"),
        ({"stretches": (5.0, 6.0)}, "fewer than two points have stretches from 5 to 6"),
    ],
)
def test_what_cannot_be_fitted_is_refused(arguments: dict[str, object], part: str) -> None:
    with pytest.raises(ProblemError, match=part):
        fit(PLANAR, **arguments)  # type: ignore[arg-type]


def test_no_test_or_something_else_is_refused() -> None:
    with pytest.raises(ProblemError, match="at least one test"):
        fit([])
    with pytest.raises(ProblemError, match="neither a MaterialTest nor the path"):
        fit([3])
    with pytest.raises(ProblemError, match=r"there\.csv"):
        fit("not/there.csv")
    with pytest.raises(ProblemError, match="same length"):
        MaterialTest("planar", np.ones(3), np.ones(2))
    with pytest.raises(ProblemError, match="did you mean 'planar'"):
        MaterialTest("planer", np.ones(3), np.ones(3))


def test_a_test_with_very_many_rows_is_thinned() -> None:
    stretch = np.linspace(1.0, 3.0, 30001)
    test = MaterialTest(
        "uniaxial", stretch, MODES["uniaxial"].nominal_stress(TRUE["yeoh"], stretch)
    )
    assert len(test.stretch) == 2000
    assert test.stretch[-1] == 3.0
    assert fit(test, "yeoh").largest_error < 1e-6


# -- into a problem --------------------------------------------------------------------------------


def test_a_fitted_law_is_a_file_that_a_problem_names(tmp_path: Path) -> None:
    found = fit(PLANAR, "yeoh", nu=0.45)
    (tmp_path / "material.toml").write_text(found.to_toml())
    (tmp_path / "spring.toml").write_text(f'material = "material.toml"\n{POINT}')
    problem = SpringProblem.from_toml(tmp_path / "spring.toml")
    assert isinstance(problem.law, Yeoh)
    assert list(problem.law.parameters.values()) == pytest.approx(
        list(found.law.parameters.values()), rel=1e-6
    )
    assert problem.law.initial_moduli[0] / problem.law.initial_moduli[1] == pytest.approx(
        2 * 1.45 / (3 * 0.1), rel=1e-6
    )
    # The problem that is written holds the law itself.
    assert SpringProblem.from_toml(problem.to_toml()) == problem
    # And the table may stand in the problem's own file.
    assert SpringProblem.from_toml(found.to_toml() + POINT) == problem


@pytest.mark.parametrize("name", [name for name in CANDIDATES if name != "ogden-3"])
def test_every_fit_is_a_file(name: str) -> None:
    found = fit(measured(TRUE[name], "uniaxial", "planar", noise=0.01), name)
    problem = SpringProblem.from_toml(found.to_toml() + POINT)
    assert problem.law.name == found.law.name
    assert pytest.approx(found.law.initial_moduli[1], rel=1e-5) == problem.G


def test_a_file_of_a_material_stays_in_its_folder_and_holds_nothing_else(tmp_path: Path) -> None:
    table = '[material]\nlaw = "gent"\nK = 2.0\nmu = 0.4\nJ_m = 30.0\n'
    (tmp_path / "outside.toml").write_text(table)
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "more.toml").write_text(f"L = 3.0\n{table}")
    (inside / "empty.toml").write_text("")
    (inside / "folder.toml").mkdir()
    cases = {
        "../outside.toml": "material = '../outside.toml' is not in the folder",
        "more.toml": "unknown key 'L': a file of a material has a [material] table only",
        "empty.toml": "no [material] table",
        "missing.toml": "cannot be read",
        "folder.toml": "cannot be read",
    }
    for name, part in cases.items():
        (inside / "spring.toml").write_text(f'material = "{name}"\n{POINT}')
        with pytest.raises(ProblemError) as error:
            SpringProblem.from_toml(inside / "spring.toml")
        assert part in str(error.value)
    with pytest.raises(ProblemError, match="does not come from a file"):
        SpringProblem.parse_toml(f'material = "material.toml"\n{POINT}')
    (inside / "spring.toml").write_text(f'material = "gent.toml"\nnu = 0.4\n{POINT}')
    (inside / "gent.toml").write_text(table)
    with pytest.raises(ProblemError, match="described twice"):
        SpringProblem.from_toml(inside / "spring.toml")


@pytest.mark.parametrize(
    "name", ["Ecoflex 00-30", "ecoflex 00-50", "Dragon Skin 10", "dragon-skin 30A"]
)
def test_silicones_have_their_measured_law_by_name(name: str) -> None:
    problem = SpringProblem.from_toml(f'material = "{name}"\n{POINT}')
    assert isinstance(problem.law, Ogden)
    assert pytest.approx(2 * 1.45 / (3 * 0.1)) == problem.K / problem.G
    other = SpringProblem.from_toml(f'material = "{name}"\nnu = 0.4\n{POINT}')
    assert problem.G == other.G
    assert pytest.approx(2 * 1.4 / (3 * 0.2)) == other.K / other.G


@pytest.mark.parametrize("name", ["Ecoflex", "Ecoflex 00-20", "Ecoflex 30", "Dragon Fruit 30"])
def test_their_neighbours_are_refused_without_another_name(name: str) -> None:
    with pytest.raises(ProblemError, match="there is no material") as error:
        SpringProblem.from_toml(f'material = "{name}"\n{POINT}')
    assert "did you mean" not in str(error.value)


def test_dragon_skin_20_and_pdms_are_what_their_hardness_says() -> None:
    for name in ("Dragon Skin 20", "Dragon Skin", "PDMS"):
        assert isinstance(SpringProblem.from_toml(f'material = "{name}"\n{POINT}').law, NeoHooke)


def test_fit_is_a_public_name() -> None:
    assert ngspring.fit is fit
    assert isinstance(ngspring.fit(PLANAR, "neo-hooke"), ngspring.Fit)
