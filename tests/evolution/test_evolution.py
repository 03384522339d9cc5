"""The evolution ends at an exact stationary point, and its history says truly how it got there."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ngspring
from ngspring import ControlPoint, Design, ProblemError, Result, StepRule, Update
from ngspring.cli.tables import design_lines
from ngspring.evolution.steprule import PAPER_RULE
from ngspring.kkt.newton import EXACT
from ngspring.kkt.system import CoupledSystem

# Small enough to converge in seconds; the interface width is that of Table 1 in element sizes.
SMALL = ngspring.cases["C4"].replace(elements=8, l_i=10.0)
TINY = SMALL.replace(elements=4, l_i=20.0)


@dataclasses.dataclass(frozen=True)
class Run:
    result: Result
    updates: list[Update]
    folder: Path


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A whole run with the default rule and start."""
    folder = tmp_path_factory.mktemp("runs") / "small"
    updates: list[Update] = []
    result = ngspring.optimize(SMALL, out=folder, observers=[updates.append], threads=1)
    return Run(result, updates, folder)


@pytest.fixture(scope="module")
def by_the_paper() -> Result:
    return ngspring.optimize(SMALL, rule=PAPER_RULE, threads=1)


@pytest.fixture(scope="module")
def converged_steps() -> Result:
    return ngspring.optimize(SMALL, rule=StepRule(), threads=1)


def first_updates(problem: Any, n: int = 3, **options: Any) -> Result:
    return ngspring.optimize(problem, max_updates=n, threads=1, **options)


# -- a whole run ----------------------------------------------------------------------------------


def test_a_run_converges_to_its_targets(run: Run) -> None:
    result = run.result
    assert result.converged
    assert result.message == ""
    targets = [point.q for point in SMALL.control_points]
    np.testing.assert_allclose(result.q, targets, rtol=1e-3)
    assert result.design.problem == SMALL
    assert result.design.history is not None


def test_the_forces_are_those_of_an_independent_forward_analysis(run: Run) -> None:
    ways = sorted(point.d for point in SMALL.control_points)
    response = ngspring.load_displacement(run.result.design, ways, threads=1)
    q = dict(zip(response.d, response.q, strict=True))
    forward = [q[point.d] for point in SMALL.control_points]
    np.testing.assert_allclose(forward, run.result.q, rtol=1e-7)


@pytest.mark.parametrize("domain", ["quarter", "full"])
def test_the_final_design_is_a_stationary_point(run: Run, domain: str) -> None:
    check = ngspring.optimality(run.result.design, domain=domain, threads=1)
    assert check.residual <= 1e-6
    np.testing.assert_allclose(check.q, run.result.q, rtol=1e-7)
    np.testing.assert_allclose(check.targets, [2, -2, -4])
    assert abs(check.deviation).max() <= 1e-3


def test_a_design_beside_the_final_one_is_not_a_stationary_point(run: Run) -> None:
    design = run.result.design
    noise = np.random.default_rng(0).uniform(-1e-2, 1e-2, design.coefficients.shape)
    beside = Design(SMALL, design.coefficients + noise)
    assert ngspring.optimality(beside, threads=1).residual > 1e-4
    assert ngspring.optimality(Design.column(SMALL), threads=1).residual > 1e-2


def test_the_final_design_is_black_and_white_with_the_slope_of_the_interface(run: Run) -> None:
    design = run.result.design
    x = np.linspace(0, 100, 201)
    chi = design.chi(x[:, None], x)
    slope = np.hypot(design.chi(x[:, None], x, (1, 0)), design.chi(x[:, None], x, (0, 1)))
    assert chi.max() > 2
    assert chi.min() < -2
    assert slope.max() < 2 * 8 / SMALL.l_i


# -- history --------------------------------------------------------------------------------------


def test_c_is_the_sum_of_its_terms_in_every_row(run: Run) -> None:
    h = run.result.history
    terms = h["volume"] + h["interface"] + h["curvature"] + h["C_q1"] + h["C_q2"] + h["C_q3"]
    np.testing.assert_allclose(h["C"], terms, rtol=1e-12)


def test_every_term_of_c_is_what_the_paper_says(run: Run) -> None:
    h, design, p = run.result.history, run.result.design, SMALL
    for j, point in enumerate(p.control_points, start=1):
        expected = point.weight / 2 * (h[f"q{j}"] - point.q) ** 2
        np.testing.assert_allclose(h[f"C_q{j}"], expected, rtol=1e-9, atol=1e-25)
    np.testing.assert_allclose(h["volume"], p.k_rho * h["V"], rtol=1e-12)
    np.testing.assert_allclose(h["width"], h["V"] / (p.H * p.T) / p.H, rtol=1e-12)
    last = h.last()
    assert last["V"] == pytest.approx(design.volume, rel=1e-12)
    # Nine Gauss points per element, as in the paper, over the full domain.
    nodes, weights = np.polynomial.legendre.leggauss(3)
    place = (np.arange(p.elements)[:, None] + (nodes + 1) / 2).ravel() * p.h_x
    weight = np.tile(weights / 2, p.elements) * p.h_x
    d = {nu: design.chi(place[:, None], place, nu) for nu in np.ndindex(3, 3)}
    excess = np.maximum(np.hypot(d[1, 0], d[0, 1]) - 8 / p.l_i, 0)
    interface = weight @ (p.k_i / 6 * excess**6) @ weight * p.T
    hesse = d[2, 0] ** 2 + 2 * d[1, 1] ** 2 + d[0, 2] ** 2
    curvature = weight @ (p.k_H / 2 * hesse) @ weight * p.T
    assert last["interface"] == pytest.approx(interface, rel=1e-9)
    assert last["curvature"] == pytest.approx(curvature, rel=1e-9)


def test_c_without_the_transient_term_never_grows(run: Run, by_the_paper: Result) -> None:
    for history in (run.result.history, by_the_paper.history):
        c = history["C"]
        assert (np.diff(c) <= 1e-9 * c[1:]).all()
        assert c[-1] < 1e-3 * c[0]


def test_rows_are_numbered_from_the_initial_design_to_the_step_without_transient_term(
    run: Run,
) -> None:
    h = run.result.history
    np.testing.assert_array_equal(h["update"], np.arange(len(h)))
    assert h["dt"][0] == 0
    assert h["newton_iterations"][0] == 0
    assert np.isfinite(h["dt"][:-1]).all()
    assert h["dt"][-1] == math.inf
    assert (h["newton_iterations"][1:] >= 1).all()
    assert (np.diff(h["seconds"]) >= 0).all()
    assert h["V"][0] == pytest.approx(Design.column(SMALL).volume, rel=1e-12)
    total = h["newton_iterations"].sum() + h["rejected_iterations"].sum()
    assert h.newton_iterations == total
    np.testing.assert_allclose(h.last().q[0], run.result.q[0], rtol=1e-12)


@pytest.mark.parametrize("rule", ["converged", "paper"])
def test_dt_follows_the_step_rule_to_the_end(
    converged_steps: Result, by_the_paper: Result, rule: str
) -> None:
    history = converged_steps.history if rule == "converged" else by_the_paper.history
    steps = StepRule() if rule == "converged" else PAPER_RULE
    rows = history.rows()[1:]
    for before, after in itertools.pairwise(rows[:-1]):
        dt = steps.grown(before.dt, before.newton_iterations, before.rejected)
        assert after.dt == pytest.approx(dt / 4**after.rejected, rel=1e-12)
        assert after.dt <= 1e20
    last = rows[-2]
    at_rest = steps.at_rest(last.dt, last.newton_iterations)
    assert at_rest or steps.grown(last.dt, last.newton_iterations) > 1e20
    # The paper's rule waits for 1e20 whatever happens.
    assert at_rest == (rule == "converged")


def test_the_paper_s_rule_reaches_the_same_design(run: Run, by_the_paper: Result) -> None:
    assert by_the_paper.converged
    widths = [r.history.last().width for r in (run.result, by_the_paper)]
    assert widths[0] == pytest.approx(widths[1], rel=1e-3)


def test_the_history_file_holds_the_history(run: Run) -> None:
    h = run.result.history
    with (run.folder / "history.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(h)
    assert tuple(rows[0]) == h.columns
    for column in h.columns:
        np.testing.assert_array_equal([float(row[column]) for row in rows], h[column])


def test_the_run_folder_holds_the_final_design_with_its_history(run: Run) -> None:
    stored = Design.load(run.folder / "design.npz")
    assert stored.problem == SMALL
    np.testing.assert_array_equal(stored.coefficients, run.result.design.coefficients)
    assert stored.history is not None
    np.testing.assert_array_equal(stored.history.values, run.result.history.values)
    assert stored.info["converged"] is True
    np.testing.assert_array_equal(stored.info["q"], run.result.q)


# -- observers ------------------------------------------------------------------------------------


def test_an_observer_sees_every_accepted_update_in_order(run: Run) -> None:
    accepted = [update for update in run.updates if update.accepted]
    assert [update.row for update in accepted] == run.result.history.rows()
    for update in accepted:
        assert update.reason == ""
        assert update.design.volume == pytest.approx(update.row.V, rel=1e-10)
    last = accepted[-1].design
    np.testing.assert_array_equal(last.coefficients, run.result.design.coefficients)


def test_an_observer_sees_rejected_updates_and_each_divides_dt_by_four() -> None:
    updates: list[Update] = []
    result = first_updates(SMALL, 1, dt_initial=1e6, observers=[updates.append], rule=StepRule())
    start, *rejected, accepted = updates
    assert rejected
    assert start.accepted
    assert accepted.accepted
    for i, update in enumerate(rejected):
        assert not update.accepted
        assert update.reason
        assert update.dt == pytest.approx(1e6 / 4**i)
        assert update.row == start.row
        np.testing.assert_array_equal(update.design.coefficients, start.design.coefficients)
    row = result.history.last()
    assert row.rejected == len(rejected)
    assert row.rejected_iterations >= len(rejected)
    assert row.dt == accepted.dt == pytest.approx(1e6 / 4 ** len(rejected))


# -- arguments ------------------------------------------------------------------------------------


def test_max_updates_ends_the_run_with_a_message() -> None:
    result = first_updates(SMALL, 2)
    assert not result.converged
    assert len(result.history) == 3
    assert "2" in result.message


def test_dt_initial_is_the_first_step_and_a_smaller_one_changes_the_design_less() -> None:
    start = Design.column(SMALL).coefficients
    changes = []
    for dt in (0.25, 0.5):
        result = first_updates(SMALL, 1, dt_initial=dt)
        assert result.history["dt"][1] == dt
        changes.append(np.abs(result.design.coefficients - start).max())
    assert changes[1] == pytest.approx(2 * changes[0], rel=0.05)


def test_quarter_and_full_domain_give_the_same_updates() -> None:
    quarter, full = (first_updates(SMALL.replace(domain=d), 3) for d in ("quarter", "full"))
    np.testing.assert_allclose(
        quarter.design.coefficients, full.design.coefficients, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(quarter.q, full.q, rtol=1e-9)
    for column in ("C", "V", "dt"):
        np.testing.assert_allclose(quarter.history[column], full.history[column], rtol=1e-9)


def test_an_axisymmetric_run_makes_progress() -> None:
    problem = ngspring.cases["A3"].replace(elements=8, l_i=10.0)
    result = first_updates(problem, 8)
    h = result.history
    assert (np.diff(h["C"]) < 0).all()
    assert h["C"][-1] < 0.2 * h["C"][0]
    diameter = np.sqrt(4 * h["V"] / (np.pi * problem.H))
    np.testing.assert_allclose(h["width"], diameter / problem.H, rtol=1e-12)
    quarter, full = (first_updates(problem.replace(domain=d), 2) for d in ("quarter", "full"))
    np.testing.assert_allclose(quarter.q, full.q, rtol=1e-9)


def test_an_offset_control_point_loads_the_dilated_design() -> None:
    points = (ControlPoint(10, 2), ControlPoint(20, 4), ControlPoint(20, 4, weight=1e-4, eta=2.0))
    result = first_updates(SMALL.replace(control_points=points), 3, newton=EXACT)
    assert result.q[2] > result.q[1]
    h = result.history
    np.testing.assert_allclose(h["C_q3"], 0.5e-4 * (h["q3"] - 4) ** 2, rtol=1e-9)
    dilated = Design(SMALL, result.design.coefficients + 2.0)
    q = ngspring.load_displacement(dilated, [20.0], threads=1).q
    assert result.q[2] == pytest.approx(q[-1], rel=1e-7)


def test_the_start_may_be_a_function_or_a_design_of_any_mesh() -> None:
    def f(x: Any, y: Any) -> Any:
        return 3 * np.cos(2 * np.pi * (x / 100 - 0.5)) + 0.5 * np.cos(2 * np.pi * y / 100)

    expected = Design.from_function(SMALL, f)
    by_function = first_updates(SMALL, 1, initial=f)
    by_design = first_updates(SMALL, 1, initial=expected)
    assert by_function.history["V"][0] == pytest.approx(expected.volume, rel=1e-12)
    np.testing.assert_allclose(
        by_function.design.coefficients, by_design.design.coefficients, atol=1e-9
    )
    finer = Design.from_function(SMALL.replace(elements=24), f)
    by_finer = first_updates(SMALL, 1, initial=finer)
    assert by_finer.design.problem == SMALL
    assert by_finer.history["V"][0] == pytest.approx(expected.volume, rel=0.05)


def test_the_start_is_not_changed_by_the_run() -> None:
    start = Design.column(SMALL)
    before = start.coefficients.copy()
    first_updates(SMALL, 1, initial=start)
    np.testing.assert_array_equal(start.coefficients, before)


def test_two_runs_give_the_same_numbers(run: Run) -> None:
    again = first_updates(SMALL, 5)
    np.testing.assert_allclose(again.history["C"], run.result.history["C"][:6], rtol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"dt_initial": 0.0}, "dt_initial"),
        ({"dt_initial": -1.0}, "dt_initial"),
        ({"dt_initial": math.nan}, "dt_initial"),
        ({"dt_initial": math.inf}, "dt_initial"),
        ({"dt_initial": "1"}, "dt_initial"),
        ({"max_updates": 0}, "max_updates"),
        ({"max_updates": -3}, "max_updates"),
        ({"max_updates": math.nan}, "max_updates"),
        ({"max_updates": 1.5}, "max_updates"),
        ({"max_updates": "5"}, "max_updates"),
        ({"threads": 0}, "threads"),
        ({"threads": -1}, "threads"),
        ({"threads": 1.5}, "threads"),
        ({"threads": "2"}, "threads"),
        ({"resume": True}, "resume"),
        ({"solver": "magic"}, "solver"),
        ({"initial": "column"}, "initial"),
        ({"initial": 3.0}, "initial"),
        ({"initial": lambda x, y: x * np.nan}, "finite"),
    ],
)
def test_a_bad_argument_is_a_problem_error_that_names_it(
    arguments: dict[str, Any], name: str
) -> None:
    with pytest.raises(ProblemError, match=name) as caught:
        ngspring.optimize(TINY, **{"max_updates": 1, "threads": 1, **arguments})
    assert len(str(caught.value).splitlines()) == 1


def test_a_refused_argument_leaves_no_folder_behind(tmp_path: Path) -> None:
    for arguments in ({"dt_initial": -1}, {"max_updates": 0}, {"threads": 0}):
        with pytest.raises(ProblemError):
            ngspring.optimize(TINY, out=tmp_path / "run", **arguments)
    assert not (tmp_path / "run").exists()


# -- step rule ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("iterations", "factor"), [(1, 2), (2, 2), (3, 2), (4, 2), (5, 2), (6, 1), (7, 1), (20, 1)]
)
def test_the_paper_s_rule_doubles_dt_after_fewer_than_six_iterations(
    iterations: int, factor: float
) -> None:
    assert PAPER_RULE.grown(3.0, iterations) == 3.0 * factor
    assert PAPER_RULE.shrink == 4
    assert PAPER_RULE.end == 1e20


def test_nothing_moves_any_more_after_an_easy_update_with_a_large_dt() -> None:
    rule = StepRule(rest=1e10, still=3)
    assert rule.at_rest(1e10, 3)
    assert not rule.at_rest(0.9e10, 3)
    assert not rule.at_rest(1e10, 4)
    assert not PAPER_RULE.at_rest(1e19, 1)
    assert not rule.at_rest(1e10, 3, rejected=1)
    # The end is due then, or where dt grows beyond it.
    assert rule.end_is_due(1e10, 3)
    assert not rule.end_is_due(1e10, 3, rejected=1)
    assert PAPER_RULE.end_is_due(0.6e20, 1)
    assert not PAPER_RULE.end_is_due(0.4e20, 1)


def test_a_step_rule_grows_dt_by_its_own_numbers() -> None:
    rule = StepRule(few=4, growth=3.0, easy_growth=10.0, easy=1)
    assert [rule.grown(2.0, n) for n in (1, 2, 3, 4, 5)] == [20, 6, 6, 2, 2]


def test_the_rule_for_converged_updates_never_grows_less_than_the_paper_s() -> None:
    rule = StepRule()
    for iterations in range(1, 12):
        assert rule.grown(1.0, iterations) >= PAPER_RULE.grown(1.0, iterations)
        assert rule.grown(1.0, iterations, 1) == PAPER_RULE.grown(1.0, iterations)
    assert (rule.end, rule.shrink) == (PAPER_RULE.end, PAPER_RULE.shrink)


# -- full size ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["C1", "C4", "C7", "T4", "CT2", "A3"])
def test_the_cases_converge_on_a_coarse_mesh(name: str) -> None:
    problem = ngspring.cases[name].replace(elements=40, l_i=2.0)
    result = ngspring.optimize(problem)
    assert result.converged, result.message
    targets = [point.q for point in problem.control_points]
    np.testing.assert_allclose(result.q, targets, rtol=1e-3)
    assert ngspring.optimality(result.design).residual <= 1e-6


@pytest.mark.slow
def test_c7_at_the_paper_s_mesh_needs_no_more_material_than_the_paper_s() -> None:
    result = ngspring.optimize(ngspring.cases["C7"])
    assert result.converged, result.message
    np.testing.assert_allclose(result.q, [2, -2, -5.5], rtol=1e-3)
    assert result.history.last().width <= 0.2539
    assert ngspring.optimality(result.design).residual <= 1e-6


@pytest.mark.slow
def test_c4_is_reached_from_a_random_start() -> None:
    problem = ngspring.cases["C4"]
    result = ngspring.optimize(problem, Design.random(problem, 0))
    assert result.converged, result.message
    np.testing.assert_allclose(result.q, [2, -2, -4], rtol=1e-3)


@pytest.mark.long
def test_a_converged_saddle_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "falling_directions" not in ngspring.optimize(TINY, threads=1).design.info
    expected = CoupledSystem(TINY).eigenvalues_of_a_minimum
    monkeypatch.setattr(CoupledSystem, "negative_eigenvalues", expected + 2)
    design = ngspring.optimize(TINY, threads=1).design
    assert design.info["falling_directions"] == 2
    assert "at a saddle: C falls in 2 directions" in design_lines(design)[-1]
