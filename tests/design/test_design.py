"""A design is the spline of its coefficients, measured as in the paper and stored exactly."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.interpolate import BSpline

from ngspring import ControlPoint, Design, History, NgspringError, ProblemError, SpringProblem
from ngspring.design.history import Row

KINEMATICS = ("plane strain", "axisymmetric")
POINTS = (ControlPoint(10, 2), ControlPoint(-20, -4))
PROBLEM = SpringProblem(POINTS, elements=12, L=60.0, H=90.0, T=2.5)

FINITE = st.floats(-1e6, 1e6)


def waves(x: Any, y: Any) -> Any:
    return 5 * np.cos(0.11 * x) * np.sin(0.07 * y) - 0.03 * x + 1


def arbitrary(problem: SpringProblem, seed: int = 1) -> Design:
    values = np.random.default_rng(seed).uniform(-4, 4, problem.coefficient_shape)
    return Design(problem, values)


def spline(design: Design, x: Any, y: Any, nu: tuple[int, int] = (0, 0)) -> np.ndarray:
    """chi on the grid x, y by SciPy's B-splines, from coefficients mirrored here."""
    c = np.concatenate([design.coefficients, design.coefficients[::-1]])
    c = np.concatenate([c[:, :1], c], axis=1)
    c = np.concatenate([c, c[:, ::-1]], axis=1)
    cells = np.arange(-2, design.problem.elements + 3)
    along_x = BSpline(cells * design.problem.h_x, c, 2)(x, nu[0])
    return BSpline(cells * design.problem.h_y, along_x, 2, axis=1)(y, nu[1])


# -- construction ---------------------------------------------------------------------------------


@pytest.mark.parametrize("kinematics", list(KINEMATICS))
def test_coefficients_from_a_function_are_its_values_at_the_greville_points(
    kinematics: str,
) -> None:
    problem = PROBLEM.replace(kinematics=kinematics)
    design = Design.from_function(problem, waves)
    h_x, h_y = 60 / 12, 90 / 12
    assert design.coefficients.shape == (7, 6)
    for i, j in np.ndindex(7, 6):
        expected = waves((i - 0.5) * h_x, (j + 0.5) * h_y)
        assert design.coefficients[i, j] == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("kinematics", list(KINEMATICS))
def test_x_and_y_are_mm_from_the_lower_left_corner_because_linear_functions_are_reproduced(
    kinematics: str,
) -> None:
    problem = PROBLEM.replace(kinematics=kinematics)
    x = np.linspace(0, 30 - 5, 7)[:, None]  # as far as no spline reaches over the mirror lines
    y = np.linspace(7.5, 45 - 7.5, 9)
    in_x = Design.from_function(problem, lambda x, y: 2 * x - 3)
    np.testing.assert_allclose(in_x.chi(x, y), np.broadcast_to(2 * x - 3, (7, 9)), atol=1e-12)
    in_y = Design.from_function(problem, lambda x, y: 2 * y - 3)
    np.testing.assert_allclose(in_y.chi(x, y), np.broadcast_to(2 * y - 3, (7, 9)), atol=1e-12)


def test_a_function_may_return_one_number() -> None:
    design = Design.from_function(PROBLEM, lambda x, y: -1.5)
    assert (design.coefficients == -1.5).all()


@pytest.mark.parametrize(
    "f",
    [
        lambda x, y: np.full_like(x, np.nan),
        lambda x, y: np.full_like(x, np.inf),
        lambda x, y: np.zeros(3),
        lambda x, y: None,
        lambda x, y: "solid",
    ],
    ids=["nan", "inf", "shape", "nothing", "text"],
)
def test_a_function_without_usable_values_is_a_value_error(f: Callable[[Any, Any], Any]) -> None:
    with pytest.raises(ValueError, match=r".+"):
        Design.from_function(PROBLEM, f)


@pytest.mark.parametrize("bad", [np.zeros((6, 6)), np.zeros(42), np.full((7, 6), np.nan)])
def test_coefficients_of_another_shape_or_not_finite_are_refused(bad: np.ndarray) -> None:
    with pytest.raises(ProblemError):
        Design(PROBLEM, bad)


def test_a_design_does_not_change_with_the_array_it_was_made_from() -> None:
    values = np.zeros(PROBLEM.coefficient_shape)
    design = Design(PROBLEM, values)
    values[0, 0] = 7
    assert design.coefficients[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        design.coefficients[0, 0] = 7


@pytest.mark.parametrize("kinematics", list(KINEMATICS))
def test_the_column_start_is_a_column_that_varies_in_both_directions(kinematics: str) -> None:
    design = Design.column(SpringProblem(POINTS, elements=40, kinematics=kinematics))
    t = np.linspace(0, 100, 81)
    chi = design.chi(t[:, None], t)
    assert np.ptp(chi, axis=0).min() > 1
    assert np.ptp(chi, axis=1).max() > 1
    np.testing.assert_allclose(chi, chi[::-1], atol=1e-12)
    np.testing.assert_allclose(chi, chi[:, ::-1], atol=1e-12)
    # A column: solid along the axis at every height, void along both sides, one piece between.
    assert (chi[40] > 0).all()
    assert (chi[[0, -1]] < 0).all()
    assert (np.diff(chi > 0, axis=0).sum(axis=0) == 2).all()


# -- random start ---------------------------------------------------------------------------------


def test_the_random_start_is_reproducible_and_differs_between_seeds() -> None:
    first, again, other = (Design.random(PROBLEM, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.coefficients, again.coefficients)
    assert np.abs(first.coefficients - other.coefficients).max() > 0.05


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 2**63),
    half=st.integers(2, 30),
    kinematics=st.sampled_from(sorted(KINEMATICS)),
)
def test_the_random_start_is_bounded_and_doubly_symmetric(
    seed: int, half: int, kinematics: str
) -> None:
    design = Design.random(PROBLEM.replace(elements=2 * half, kinematics=kinematics), seed)
    x, y = np.linspace(0, 60, 31)[:, None], np.linspace(0, 90, 29)
    chi = design.chi(x, y)
    assert np.abs(chi).max() <= 0.4 + 0.222 + 0.154
    np.testing.assert_allclose(chi, chi[::-1], atol=1e-12)
    np.testing.assert_allclose(chi, chi[:, ::-1], atol=1e-12)


def test_the_random_start_uses_all_of_its_range_and_has_mean_zero() -> None:
    problem = SpringProblem(POINTS, elements=40)
    values = np.array([Design.random(problem, seed).coefficients for seed in range(100)])
    # Splines average their neighbours, so the extremes stay below the sum of the amplitudes.
    assert 0.4 < np.abs(values).max() <= 0.776
    assert abs(values.mean()) < 0.02


def test_the_random_start_is_the_same_field_on_every_mesh() -> None:
    coarse, fine = (Design.random(PROBLEM.replace(elements=n), 5) for n in (80, 160))
    x, y = np.linspace(0, 60, 33)[:, None], np.linspace(0, 90, 35)
    assert np.abs(coarse.chi(x, y) - fine.chi(x, y)).max() < 0.02


def test_the_random_start_has_the_detail_of_a_12_x_12_mesh_and_not_more() -> None:
    design = Design.random(SpringProblem(POINTS, elements=96), 2)
    # Third derivatives of quadratic splines live on their knots: elsewhere chi'' is constant.
    h = 100 / 96
    x = (np.arange(2, 48) - 0.5) * h
    second = np.diff(design.coefficients[1:], n=2, axis=0) / h**2
    jumps = np.abs(np.diff(second, axis=0)).max(axis=1)
    knots = np.array([k / m for m in (4, 8, 12) for k in range(m + 1)]) * 100
    far = np.array([np.abs(knots - (t + h / 2)).min() > 2 * h for t in x[: len(jumps)]])
    assert far.any()
    assert jumps[far].max() < 1e-12 < jumps[~far].max()


def test_a_negative_seed_is_a_value_error() -> None:
    with pytest.raises(ValueError, match=r".+"):
        Design.random(PROBLEM, -1)


# -- evaluation -----------------------------------------------------------------------------------


@pytest.mark.parametrize("nu", [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (2, 2)])
@pytest.mark.parametrize("kinematics", list(KINEMATICS))
def test_chi_and_its_derivatives_are_those_of_the_b_spline(
    kinematics: str, nu: tuple[int, int]
) -> None:
    design = arbitrary(PROBLEM.replace(kinematics=kinematics))
    generator = np.random.default_rng(0)
    x, y = generator.uniform(0, 60, 50), generator.uniform(0, 90, 40)
    np.testing.assert_allclose(design.chi(x[:, None], y, nu), spline(design, x, y, nu), atol=1e-11)


def test_derivatives_agree_with_central_differences() -> None:
    design = arbitrary(PROBLEM)
    generator = np.random.default_rng(1)
    x, y = generator.uniform(1, 59, 200), generator.uniform(1, 89, 200)
    e = 1e-4
    by_x = (design.chi(x + e, y) - design.chi(x - e, y)) / (2 * e)
    by_y = (design.chi(x, y + e) - design.chi(x, y - e)) / (2 * e)
    np.testing.assert_allclose(design.chi(x, y, (1, 0)), by_x, atol=1e-4)
    np.testing.assert_allclose(design.chi(x, y, (0, 1)), by_y, atol=1e-4)
    mixed = (design.chi(x + e, y, (0, 1)) - design.chi(x - e, y, (0, 1))) / (2 * e)
    np.testing.assert_allclose(design.chi(x, y, (1, 1)), mixed, atol=1e-4)


@settings(deadline=None, max_examples=30)
@given(
    coefficients=hnp.arrays(float, (5, 4), elements=st.floats(-10, 10)),
    x=st.floats(0, 30),
    y=st.floats(0, 45),
)
def test_chi_is_mirrored_about_both_axes(coefficients: np.ndarray, x: float, y: float) -> None:
    design = Design(PROBLEM.replace(elements=8), coefficients)
    four = design.chi([x, 60 - x, x, 60 - x], [y, y, 90 - y, 90 - y])
    np.testing.assert_allclose(four, four[0], atol=1e-10)


def test_the_normal_derivative_vanishes_on_bottom_and_top_and_on_the_mirror_lines() -> None:
    design = arbitrary(PROBLEM)
    x, y = np.linspace(0, 60, 25), np.linspace(0, 90, 25)
    for line in (0, 45, 90):
        np.testing.assert_allclose(design.chi(x, line, (0, 1)), 0, atol=1e-12)
    np.testing.assert_allclose(design.chi(30, y, (1, 0)), 0, atol=1e-12)
    # Nothing is imposed on the sides.
    assert np.abs(design.chi(0, y, (1, 0))).min() > 1e-3


def test_chi_is_vectorised_and_broadcasts() -> None:
    design = arbitrary(PROBLEM)
    assert np.shape(design.chi(1.0, 2.0)) == ()
    assert design.chi([1, 2, 3], 4).shape == (3,)
    grid = design.chi(np.array([[1.0], [2.0]]), np.array([3.0, 4.0, 5.0]))
    assert grid.shape == (2, 3)
    assert grid[1, 2] == design.chi(2, 5)
    assert design.chi([], []).shape == (0,)


def test_chi_reaches_to_the_very_border_of_the_domain() -> None:
    design = arbitrary(PROBLEM)
    corners = design.chi([0, 60, 0, 60], [0, 0, 90, 90])
    np.testing.assert_allclose(corners, spline(design, [0], [0])[0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("x", "y"),
    [
        (-0.1, 5),
        (60.1, 5),
        (5, -0.1),
        (5, 90.1),
        (np.nan, 5),
        (5, np.nan),
        (np.inf, 5),
        (5, -np.inf),
    ],
)
def test_a_point_outside_the_domain_or_nan_is_refused(x: float, y: float) -> None:
    design = arbitrary(PROBLEM)
    with pytest.raises(NgspringError, match="outside the domain") as caught:
        design.chi([1.0, x], [1.0, y])
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("derivative", [(3, 0), (0, 3), (-1, 0)])
def test_a_derivative_that_is_not_offered_is_a_value_error(derivative: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r".+"):
        arbitrary(PROBLEM).chi(1, 1, derivative)


# -- volume ---------------------------------------------------------------------------------------


def quadrature(design: Design, per_cell: int = 8) -> float:
    """V of Eqs. 10 and 23 by many Gauss points per cell of the full domain."""
    problem = design.problem
    nodes, weights = np.polynomial.legendre.leggauss(per_cell)
    place = (np.arange(problem.elements)[:, None] + (nodes + 1) / 2).ravel()
    weight = np.tile(weights / 2, problem.elements)
    x, y = place * problem.h_x, place * problem.h_y
    rho = 1 / (1 + np.exp(-spline(design, x, y)))
    if problem.kinematics == "axisymmetric":
        r = x - problem.L / 2
        across = weight * problem.h_x * 2 * np.pi * r * (r > 0)
    else:
        across = weight * problem.h_x * problem.T
    return float(across @ rho @ (weight * problem.h_y))


@pytest.mark.parametrize("kinematics", list(KINEMATICS))
@pytest.mark.parametrize("start", [Design.column, Design.random])
def test_the_volume_is_that_of_an_independent_quadrature(start: Any, kinematics: str) -> None:
    design = start(PROBLEM.replace(elements=20, kinematics=kinematics))
    assert design.volume == pytest.approx(quadrature(design), rel=2e-6)


def test_the_plane_volume_agrees_with_the_midpoint_rule() -> None:
    design = Design.column(PROBLEM.replace(elements=20))
    x, y = (np.arange(1000) + 0.5) * 0.06, (np.arange(1000) + 0.5) * 0.09
    midpoint = design.density(x[:, None], y).mean() * 60 * 90 * 2.5
    assert design.volume == pytest.approx(midpoint, rel=1e-5)


def test_uniform_designs_have_the_volume_of_the_domain_times_their_density() -> None:
    plane, round_ = PROBLEM, PROBLEM.replace(kinematics="axisymmetric")
    for chi, rho in ((0.0, 0.5), (60.0, 1.0), (-800.0, 0.0)):
        design = Design.from_function(plane, lambda x, y, chi=chi: chi)
        assert design.volume == pytest.approx(rho * 60 * 90 * 2.5, rel=1e-12, abs=1e-12)
        assert design.equivalent_width == pytest.approx(rho * 60, rel=1e-12, abs=1e-12)
        design = Design.from_function(round_, lambda x, y, chi=chi: chi)
        assert design.volume == pytest.approx(rho * np.pi * 30**2 * 90, rel=1e-12, abs=1e-12)
        assert design.equivalent_width == pytest.approx(np.sqrt(rho) * 60, rel=1e-12, abs=1e-12)


def test_the_axisymmetric_volume_weighs_the_outside_more() -> None:
    problem = SpringProblem(POINTS, kinematics="axisymmetric", elements=80, l_i=1)
    r = 20.0
    design = Design.from_function(problem, lambda x, y: 40 * (r - np.abs(x - 50)))
    assert design.volume == pytest.approx(np.pi * r**2 * 100, rel=5e-3)
    assert design.equivalent_width == pytest.approx(2 * r, rel=3e-3)


# -- another problem ------------------------------------------------------------------------------


def test_a_design_is_carried_to_another_mesh_as_the_same_field() -> None:
    design = Design.column(SpringProblem(POINTS, elements=40))
    finer = design.with_problem(SpringProblem(POINTS, elements=80))
    assert finer.problem.elements == 80
    x = np.linspace(0, 100, 41)
    assert np.abs(design.chi(x[:, None], x) - finer.chi(x[:, None], x)).max() < 0.03
    assert finer.volume == pytest.approx(design.volume, rel=2e-3)


def test_a_design_is_stretched_with_the_domain() -> None:
    design = arbitrary(PROBLEM)
    for elements in (12, 24):
        large = design.with_problem(PROBLEM.replace(L=120.0, H=45.0, elements=elements))
        assert large.problem.L == 120
        smooth = Design.column(PROBLEM).with_problem(large.problem)
        x, y = np.linspace(0, 1, 21)[:, None], np.linspace(0, 1, 17)
        expected = Design.column(PROBLEM).chi(60 * x, 90 * y)
        np.testing.assert_allclose(smooth.chi(120 * x, 45 * y), expected, atol=0.3)


def test_a_problem_with_the_same_mesh_keeps_the_coefficients_and_forgets_the_history() -> None:
    history = History(("update", "dt"), np.zeros((1, 2)))
    design = Design(PROBLEM, arbitrary(PROBLEM).coefficients, history, {"start": "x"})
    moved = design.with_problem(PROBLEM.replace(l_i=3.0, kinematics="axisymmetric"))
    np.testing.assert_array_equal(moved.coefficients, design.coefficients)
    assert moved.problem.l_i == 3
    assert moved.history is None


# -- files ----------------------------------------------------------------------------------------

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


#: Force of the only control point, or its offset.
FORCE = st.floats(-1e6, 1e6).map(lambda q: round(q, 3))
NUMBER = st.floats(-1e99, 1e99)
COUNT = st.integers(0, 1000)
ROWS = st.builds(
    lambda counts, dt, numbers: Row(
        *(counts[0], dt, *counts[1:], *numbers[:2], {"volume": numbers[2]}, (numbers[3],)),
        *((numbers[4],), *numbers[5:], counts[0] / 8),
    ),
    st.tuples(COUNT, COUNT, COUNT, COUNT),
    st.floats(0.0),
    st.tuples(*7 * [NUMBER]),
)
NOTES: dict[str, Any] = {
    "start": st.text(max_size=300).filter(str.isprintable).map(lambda text: " ".join(text.split())),
    "q": st.lists(NUMBER, min_size=1, max_size=1),
    "converged": st.booleans(),
    "falling_directions": COUNT,
}

OTHER_NOTES = (*NOTES, "failed", "stopped", "missed", "ngsolve", "grey", "corrections")


@st.composite
def designs(draw: st.DrawFn) -> Design:
    positive = st.floats(1e-3, 1e3)
    problem = SpringProblem(
        (ControlPoint(draw(st.floats(1e-4, 9e-4)), draw(FORCE), eta=draw(FORCE)),),
        name=draw(st.text(max_size=200).filter(str.isprintable)),
        kinematics=draw(st.sampled_from(sorted(KINEMATICS))),
        domain=draw(st.sampled_from(["quarter", "full"])),
        elements=2 * draw(st.integers(2, 8)),
        L=draw(positive),
        H=draw(positive),
        T=draw(positive),
        l_i=draw(positive),
    )
    any_number = st.floats(allow_nan=False, allow_infinity=False)
    coefficients = draw(hnp.arrays(float, problem.coefficient_shape, elements=any_number))
    history = None
    if draw(st.booleans()):
        history = History.from_rows(draw(st.lists(ROWS, min_size=1, max_size=4)))
    keys = st.text().filter(lambda key: key not in OTHER_NOTES)
    info = draw(st.dictionaries(keys, JSON, max_size=4))
    info |= draw(st.fixed_dictionaries({}, optional=NOTES))
    return Design(problem, coefficients, history, info)


def assert_same(a: Design, b: Design) -> None:
    assert a.problem == b.problem
    assert a.coefficients.tobytes() == b.coefficients.tobytes()
    assert dict(a.info) == dict(b.info)
    assert (a.history is None) == (b.history is None)
    if a.history is not None and b.history is not None:
        assert a.history.columns == b.history.columns
        np.testing.assert_array_equal(a.history.values, b.history.values)


@settings(deadline=None, max_examples=60)
@given(design=designs())
def test_a_design_file_gives_back_exactly_what_was_saved(
    design: Design, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("design") / "design.npz"
    design.save(path)
    assert_same(Design.load(path), design)
    Design.load(path).save(path)
    assert_same(Design.load(path), design)


def test_the_file_name_is_taken_as_it_is_whatever_its_ending(tmp_path: Path) -> None:
    design = arbitrary(PROBLEM)
    for name in ("spring", "spring.design", "ünï cödé.npz"):
        design.save(tmp_path / name)
        assert_same(Design.load(str(tmp_path / name)), design)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_design_file_is_small_and_describes_itself_without_pickle(tmp_path: Path) -> None:
    path = tmp_path / "design.npz"
    Design.column(SpringProblem(POINTS, elements=80)).save(path)
    assert path.stat().st_size < 50_000
    with np.load(path, allow_pickle=False) as file:
        assert not any(file[name].dtype.hasobject for name in file.files)
        assert str(file["format"]) == "ngspring-design"
        assert int(file["version"]) >= 1
        assert SpringProblem.from_toml(str(file["problem"])) == SpringProblem(POINTS, elements=80)


def test_a_pickle_inside_a_design_file_is_never_run(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (tmp_path / "sprung",)

    path = tmp_path / "design.npz"
    arbitrary(PROBLEM).save(path)
    with np.load(path) as file:
        parts = {name: file[name] for name in file.files}
    for name in parts:
        trap = np.empty((), dtype=object)
        trap[()] = Trap()
        np.savez(path, **{**parts, name: trap})
        (tmp_path / "sprung").unlink(missing_ok=True)
        assert zipfile.is_zipfile(path)
        with pytest.raises(NgspringError):
            Design.load(path)
        assert not (tmp_path / "sprung").exists()


def test_a_term_that_is_not_asked_for_on_every_mesh_is_zero_where_it_is_not() -> None:
    rows = [
        Row(update=0, C=1.0, terms={"volume": 1.0}, C_q=(0.5,), q=(2.0,)),
        Row(update=1, C=3.0, terms={"volume": 1.0, "walls": 2.0}, C_q=(0.5,), q=(2.0,)),
        Row(update=2, C=4.0, terms={"volume": 1.0, "gaps": 3.0}, C_q=(0.5,), q=(2.0,)),
    ]
    history = History.from_rows(rows)
    assert list(history["walls"]) == [0.0, 2.0, 0.0]
    assert list(history["gaps"]) == [0.0, 0.0, 3.0]
    assert [row.terms["volume"] for row in history.rows()] == [1.0, 1.0, 1.0]


def test_a_row_that_lacks_a_force_is_no_row_of_the_history() -> None:
    first = Row(update=0, C_q=(0.5, 0.5), q=(2.0, 4.0))
    with pytest.raises(KeyError, match="q2"):
        History.from_rows([first, Row(update=1, C_q=(0.5,), q=(2.0,))])
