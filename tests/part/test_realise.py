"""The solid goes through the targets; what was asked and what was aimed at both stay."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.commands import invoke

import ngspring
from ngspring import ControlPoint, Design, PartSettings, ProblemError, Result, SpringProblem, Update
from ngspring.cli.progress import plain_line
from ngspring.design.corrections import MISSED, corrections_of
from ngspring.design.soundness import flaw
from ngspring.evolution import evolve
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.continuation import FollowSteps
from ngspring.evolution.folder import CHECKPOINT, DESIGN
from ngspring.view.report import report_page

PROBLEM = SpringProblem(
    (ControlPoint(10, 2), ControlPoint(-10, -2)), name="two", elements=8, l_i=10.0
)
ONE = SpringProblem((ControlPoint(10, 2),), name="one", elements=8, l_i=10.0)
CYLINDER = ngspring.cases["A1"].replace(
    elements=8, l_i=10.0, control_points=(ngspring.cases["A1"].control_points[0],)
)
SETTINGS = PartSettings(tolerance=0.01)


def solid_curve(design: Design) -> list[float]:
    """Forces of the solid at the control points, without `realise`."""
    body = ngspring.mesh_body(design)
    places = [point.d for point in design.problem.control_points]
    return [float(q) for q in ngspring.contact_load_displacement(body, places, threads=1).q]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("part") / "run"


@pytest.fixture(scope="module")
def updates() -> list[Update]:
    return []


@pytest.fixture(scope="module")
def whole(folder: Path, updates: list[Update]) -> Result:
    return ngspring.realise(
        PROBLEM, out=folder, settings=SETTINGS, observers=[updates.append], threads=1
    )


# -- what comes out --------------------------------------------------------------------------------


@pytest.mark.long
def test_the_solid_goes_through_its_targets(whole: Result) -> None:
    assert whole.converged
    assert whole.message == ""
    assert flaw(whole.design) == ""
    np.testing.assert_allclose(solid_curve(whole.design), [2, -2], rtol=0.01)
    assert whole.design.solid == pytest.approx(solid_curve(whole.design), rel=1e-6)


@pytest.mark.long
def test_without_corrections_it_would_have_missed_them(whole: Result) -> None:
    first = corrections_of(whole.design.info)[0]
    assert first.aims == (2.0, -2.0)
    assert abs(first.worst(PROBLEM.control_points)) > 0.2


@pytest.mark.long
def test_the_design_is_an_exact_stationary_point_for_what_was_aimed_at(whole: Result) -> None:
    found = ngspring.optimality(whole.design)
    assert found.residual < 1e-8
    aims = [point.aim for point in whole.design.problem.control_points]
    np.testing.assert_allclose(found.q, aims, rtol=1e-3)
    np.testing.assert_allclose(found.targets, aims, rtol=0)


@pytest.mark.long
def test_what_was_asked_stays_beside_it(whole: Result, folder: Path) -> None:
    stored = Design.load(folder / DESIGN)
    assert [point.q for point in stored.problem.control_points] == [2.0, -2.0]
    assert stored.problem == whole.design.problem
    assert stored.solid == whole.design.solid
    assert Checkpoint.load(folder / CHECKPOINT).goal == PROBLEM


@pytest.mark.long
def test_every_correction_is_in_the_history(whole: Result) -> None:
    rows, found = whole.history.rows(), corrections_of(whole.design.info)
    assert [row.correction for row in rows if row.is_end] == list(range(len(found)))
    for number, one in enumerate(found):
        assert rows[one.update].is_end
        assert rows[one.update].correction == number
        np.testing.assert_allclose(rows[one.update].q, one.aims, rtol=1e-3)
    # The first state with other aims is the old one.
    starts = [row for row in rows if row.correction and row.dt == 0.0]
    before = [rows[row.update - 1] for row in starts]
    np.testing.assert_allclose([row.q for row in starts], [row.q for row in before], rtol=1e-8)


@pytest.mark.long
def test_an_observer_is_told_what_each_solid_carries(whole: Result, updates: list[Update]) -> None:
    told = [update.correction for update in updates if update.correction is not None]
    assert tuple(told) == corrections_of(whole.design.info)


@pytest.mark.long
def test_the_same_for_axisymmetric_springs() -> None:
    result = ngspring.realise(CYLINDER, settings=SETTINGS, threads=1)
    assert result.message == ""
    assert solid_curve(result.design)[0] == pytest.approx(100.0, rel=0.01)


@pytest.mark.long
def test_the_aim_of_an_offset_design_follows_that_of_the_part() -> None:
    points = (ControlPoint(10, 2), ControlPoint(10, 2.2, weight=1e-3, eta=0.5))
    problem = ONE.replace(control_points=points)
    result = ngspring.realise(problem, settings=SETTINGS, threads=1)
    assert result.message == ""
    aims = [point.q_star for point in result.design.problem.control_points]
    assert aims[1] / aims[0] == pytest.approx(1.1)
    assert result.design.solid is not None
    assert result.design.solid[0] == pytest.approx(2.0, rel=0.01)
    assert np.isnan(result.design.solid[1])


def test_a_part_without_a_target_of_its_own_is_none() -> None:
    with pytest.raises(ProblemError, match="without an offset eta"):
        ngspring.realise(ONE.replace(control_points=(ControlPoint(10, 2, eta=0.5),)))


# -- left and taken up -----------------------------------------------------------------------------


class LeftError(Exception):
    """Somebody pulls the plug."""


@pytest.fixture(scope="module")
def uninterrupted() -> Result:
    return ngspring.realise(ONE, settings=SETTINGS, threads=1)


#: A branch of stationary points that ends at once: corrections have to evolve.
ENDS = FollowSteps(first=1.0, largest=1.0, smallest=1.0, many=1)


@pytest.mark.long
@pytest.mark.parametrize("where", ["before a correction", "before the solid", "after the solid"])
def test_a_run_that_was_left_anywhere_ends_in_the_same_part(
    tmp_path: Path, uninterrupted: Result, where: str
) -> None:
    def leave(update: Update) -> None:
        if update.row.correction != 1:
            return
        solid, ends = update.correction is not None, update.row.is_end
        places = {
            "before a correction": update.row.dt == 0.0,
            "before the solid": ends and not solid,
            "after the solid": ends and solid,
        }
        if places[where]:
            raise LeftError

    is_left_and_ends_as(uninterrupted, leave, tmp_path / "run")


@pytest.mark.long
def test_a_correction_whose_branch_ends_evolves_and_may_be_left(
    tmp_path: Path, uninterrupted: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    def leave(update: Update) -> None:
        if update.row.correction == 1 and 0 < update.row.dt < 1e9:
            raise LeftError

    monkeypatch.setattr(evolve, "AT_ONCE", ENDS)
    evolved = ngspring.realise(ONE, settings=SETTINGS, threads=1)
    is_left_and_ends_as(evolved, leave, tmp_path / "run")
    # The way does not matter: the stationary point is the one that is followed to otherwise.
    np.testing.assert_allclose(
        evolved.design.coefficients, uninterrupted.design.coefficients, atol=1e-5
    )
    assert evolved.history.newton_iterations > uninterrupted.history.newton_iterations


@pytest.mark.long
def test_a_correction_in_steps_tells_how_far_it_is_and_may_be_left_between_them(
    tmp_path: Path, uninterrupted: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines: list[str] = []

    def leave(update: Update) -> None:
        lines.append(plain_line(update, ONE))
        if update.followed is not None:
            assert not update.accepted
            assert not update.rejected
            assert update.row.dt == 0.0
            shorter = dataclasses.replace(update, reason="no convergence in 8 iterations")
            lines.append(plain_line(shorter, ONE))
            raise LeftError

    monkeypatch.setattr(evolve, "AT_ONCE", FollowSteps(first=0.5, largest=0.5))
    is_left_and_ends_as(uninterrupted, leave, tmp_path / "run", history=False)
    told = "followed    50 % of the way to the corrected targets"
    failed = "; a step of it failed: no convergence in 8 iterations"
    assert lines[-2:] == [told, told + failed]


def is_left_and_ends_as(
    whole: Result, leave: Callable[[Update], None], out: Path, history: bool = True
) -> None:
    """A run that is left by an observer and resumed is the one that was not."""
    with pytest.raises(LeftError):
        ngspring.realise(ONE, out=out, settings=SETTINGS, observers=[leave], threads=1)
    assert Checkpoint.load(out / CHECKPOINT).history.last().correction >= 1
    again = ngspring.realise(ONE, out=out, settings=SETTINGS, resume=True, threads=1)
    assert again.message == ""
    for one, other in zip(
        corrections_of(again.design.info), corrections_of(whole.design.info), strict=True
    ):
        np.testing.assert_allclose([*one.aims, *one.solid], [*other.aims, *other.solid], rtol=1e-9)
    difference = again.design.coefficients - whole.design.coefficients
    np.testing.assert_allclose(difference, 0.0, atol=1e-7)
    if history:
        assert again.history.newton_iterations == whole.history.newton_iterations


@pytest.mark.long
def test_a_finished_part_leads_to_that_for_other_forces_without_an_evolution(whole: Result) -> None:
    points = [ControlPoint(p.d, 1.02 * p.q) for p in PROBLEM.control_points]
    goal = PROBLEM.replace(control_points=points)
    result = ngspring.realise(goal, whole.design, settings=SETTINGS, threads=1)
    assert result.message == ""
    first = corrections_of(result.design.info)[0]
    # It begins as the part that it was ...
    assert first.aims == corrections_of(whole.design.info)[-1].aims
    np.testing.assert_allclose(first.solid, whole.design.solid, rtol=1e-6)
    # ... and every design is a stationary point followed to: dt is 0 or infinite.
    assert not any(0.0 < row.dt < np.inf for row in result.history.rows())
    np.testing.assert_allclose(solid_curve(result.design), [2.04, -2.04], rtol=0.01)
    # With a dt it is a start like others.
    evolved = ngspring.realise(goal, whole.design, 1e8, 1, settings=SETTINGS, threads=1)
    assert 0.0 < evolved.history.rows()[1].dt < np.inf


@pytest.mark.long
def test_a_finished_part_is_returned_as_it_is(whole: Result, folder: Path) -> None:
    told: list[Update] = []
    again = ngspring.realise(
        PROBLEM, out=folder, settings=SETTINGS, resume=True, observers=[told.append], threads=1
    )
    assert told == []
    np.testing.assert_array_equal(again.design.coefficients, whole.design.coefficients)


@pytest.mark.long
def test_a_smaller_tolerance_goes_on_from_a_finished_part(whole: Result, tmp_path: Path) -> None:
    tighter = PartSettings(tolerance=2e-4)
    again = ngspring.realise(PROBLEM, whole.design, settings=tighter, threads=1)
    assert again.message == ""
    # It begins with what the part aimed at.
    first = corrections_of(again.design.info)[0]
    assert first.aims == corrections_of(whole.design.info)[-1].aims
    assert first.update == 1
    assert again.history.rows()[0].correction == 0
    np.testing.assert_allclose(solid_curve(again.design), [2, -2], rtol=2.1e-4)


@pytest.mark.long
def test_a_finished_design_is_not_evolved_again_before_its_first_correction() -> None:
    design = ngspring.optimize(ONE, threads=1).design
    result = ngspring.realise(ONE, design, settings=SETTINGS, threads=1)
    assert result.history.rows()[1].is_end
    assert result.message == ""


# -- what cannot be met ----------------------------------------------------------------------------


@pytest.mark.long
def test_where_corrections_do_not_suffice_the_best_part_says_how_far_it_came() -> None:
    few = PartSettings(tolerance=1e-5, corrections=2)
    result = ngspring.realise(ONE, settings=few, threads=1)
    found = corrections_of(result.design.info)
    assert len(found) == 3
    best = min(found, key=lambda one: abs(one.worst(ONE.control_points)))
    assert result.design.solid == best.solid
    assert [p.q_star for p in result.design.problem.control_points] == list(best.aims)
    assert "after 2 corrections" in result.message
    assert result.design.info[MISSED] == flaw(result.design) == result.message
    assert ngspring.optimality(result.design).residual < 1e-8


@pytest.mark.long
def test_the_best_part_is_kept_while_others_are_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solids = iter([2.5, 2.1, 2.3, 1.5])
    monkeypatch.setattr(
        "ngspring.part.realisation.solid_forces", lambda *_, **__: (np.array([next(solids)]), "")
    )
    out = tmp_path / "run"
    impatient = PartSettings(patience=2)
    result = ngspring.realise(ONE, out=out, settings=impatient, threads=1)
    found = corrections_of(result.design.info)
    assert [one.solid for one in found] == [(2.5,), (2.1,), (2.3,), (1.5,)]
    assert result.design.solid == (2.1,)
    assert "after 3 corrections the best solid carries 2.100 N" in result.message
    assert ngspring.optimality(result.design).q == pytest.approx(found[1].aims, rel=1e-3)
    again = ngspring.realise(ONE, out=out, settings=impatient, resume=True, threads=1)
    np.testing.assert_array_equal(again.design.coefficients, result.design.coefficients)
    assert Design.load(out / DESIGN).solid == (2.1,)


def test_a_solid_that_does_not_hold_together_is_said_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "ngspring.part.realisation.solid_forces", lambda *_, **__: (np.array([np.nan]), "it broke")
    )
    result = ngspring.realise(ONE, threads=1)
    assert result.message == "the solid's path does not reach d = 10 mm (it broke)"
    assert result.history.last().correction == 0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"tolerance": 0.0}, "tolerance"),
        ({"tolerance": 2.0}, "tolerance"),
        ({"tolerance": float("nan")}, "tolerance"),
        ({"corrections": 0}, "corrections = 0"),
        ({"patience": 1.5}, "patience"),
        ({"elements_across": 0}, "elements_across"),
    ],
)
def test_settings_that_mean_nothing_are_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(ProblemError, match=message):
        PartSettings(**wrong)  # type: ignore[arg-type]


# -- what one sees ---------------------------------------------------------------------------------


@pytest.mark.long
def test_the_report_tells_of_corrections_and_of_the_solid(whole: Result, folder: Path) -> None:
    page = report_page(ngspring.read_run(folder))
    assert "Corrections" in page
    assert "solid carries [N]" in page
    assert "third medium: asked [N]" in page


@pytest.mark.long
def test_the_command_makes_a_part_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("one.toml").write_text(ONE.to_toml())
    command = ["optimize", "one.toml", "--part", "--tolerance", "1", "--threads", "1", "--anyway"]
    output = invoke(*command).output
    assert "the solid after 0 corrections" in output
    assert "correction 1" in output
    assert "solid q [N]" in output
    design = Design.load(Path("runs/one-part/design.npz"))
    assert design.solid == pytest.approx([2.0], rel=0.01)
    assert "solid q [N]" in invoke("show", "runs/one-part").output


@pytest.mark.long
def test_a_part_that_misses_is_no_success_of_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("one.toml").write_text(ONE.to_toml())
    command = ["optimize", "one.toml", "--part", "--tolerance", "0.001", "--corrections", "1"]
    output = invoke(*command, "--threads", "1", "--anyway", code=4).output
    assert "after 1 corrections the best solid carries" in output
    assert "try more --corrections" in output


def test_options_of_parts_need_a_part(tmp_path: Path) -> None:
    for option in ("--tolerance", "--corrections"):
        output = invoke("optimize", "C4", option, "1", "--out", tmp_path / "x", code=2).output
        assert f"{option} belongs to --part" in output
