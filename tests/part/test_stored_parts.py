"""The stored parts are what they say: their targets met by the solid, found by every command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.commands import invoke

import ngspring
from ngspring.analysis.finished import responses_in_gallery
from ngspring.campaign.plan import parse_campaign
from ngspring.campaign.run import run_campaign
from ngspring.design.corrections import of_part, without_aims
from ngspring.design.soundness import flaw
from ngspring.evolution.folder import read_design
from ngspring.part.realisation import PartSettings

PARTS = sorted(ngspring.parts)
#: What is asked for beside the case, in examples/paper/parts.toml: what keeps foam out of pockets,
#: and a spring from buckling.
ASKED = {
    "CT3": ngspring.cases["CT3"].replace(gap=1.5, k_w=1e-4),
} | {
    f"{case}-stable": ngspring.cases[case].with_offsets(imperfection=0.2)
    for case in ("C2", "C3", "C4", "C5", "C6", "C7")
}


@pytest.mark.parametrize("name", PARTS)
def test_a_stored_part_goes_through_the_targets_of_its_case(name: str) -> None:
    part = ngspring.parts[name]
    asked = ASKED.get(name) or ngspring.cases[name]
    assert without_aims(part.problem).equals_but_for_name(asked)
    assert part.info["converged"] is True
    assert flaw(part) == ""
    points = part.problem.control_points
    own = of_part(points)
    assert part.solid is not None
    targets = np.array([points[j].q for j in own])
    forces = np.array([part.solid[j] for j in own])
    assert np.abs(forces / targets - 1).max() <= PartSettings().tolerance


@pytest.mark.parametrize("name", PARTS)
def test_its_load_path_is_stored_beside_it(name: str) -> None:
    assert responses_in_gallery(ngspring.parts[name]) is not None


def test_commands_find_a_part_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    design, path = read_design("C4-part")
    assert path == Path("C4-part.npz")
    np.testing.assert_array_equal(design.coefficients, ngspring.parts["C4"].coefficients)
    assert "solid q [N]" in invoke("show", "C4-part").output
    assert Path("C4-part.png").exists()


def test_a_point_with_an_imperfection_is_not_shown_as_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    output = invoke("show", "C4-stable-part").output
    assert "±1.6 xy" in output
    assert "not reached" not in output
    assert "incomplete" not in output


@pytest.mark.long
def test_a_part_that_does_not_buckle_is_confirmed() -> None:
    """Its control point with an imperfection is on no curve, so none is missed there."""
    assert "fails" not in invoke("check", "C4-stable-part", "--threads", "1").output


@pytest.mark.slow
def test_all_parts_are_confirmed_when_everything_is_computed_anew() -> None:
    assert "fails" not in invoke("check", "--parts").output


@pytest.mark.long
def test_a_changed_part_is_not_confirmed(tmp_path: Path) -> None:
    problem = ngspring.SpringProblem((ngspring.ControlPoint(10, 2),), elements=8, l_i=10.0)
    part = ngspring.realise(problem, threads=1).design
    path = tmp_path / "part.npz"
    part.save(path)
    assert "passes" in invoke("check", path, "--threads", "1").output
    found = [dict(one) for one in part.info["corrections"]]
    found[-1]["solid"] = [2.009]
    ngspring.Design(
        part.problem, part.coefficients, part.history, {**part.info, "corrections": found}
    ).save(path)
    assert "fails" in invoke("check", path, "--threads", "1", code=1).output


@pytest.mark.long
def test_a_campaign_makes_parts_and_takes_finished_ones_as_they_are(tmp_path: Path) -> None:
    problem = ngspring.SpringProblem((ngspring.ControlPoint(10, 2),), elements=8, l_i=10.0)
    (tmp_path / "one.toml").write_text(problem.to_toml())
    campaign = parse_campaign('[[run]]\nfile = "one.toml"\npart = true\n', tmp_path)
    outcomes = [run_campaign(campaign, tmp_path / "runs", workers=1) for _ in range(2)]
    for (outcome,) in outcomes:
        assert outcome.converged
        assert outcome.q == pytest.approx([2.0], rel=0.005)
        assert abs(outcome.worst_deviation or 1.0) <= 0.005
    assert outcomes[0][0].seconds == outcomes[1][0].seconds
