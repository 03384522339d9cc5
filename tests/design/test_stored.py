"""The gallery holds finished designs of the paper's cases, and they are what they claim to be."""

from __future__ import annotations

from importlib.resources import files

import numpy as np
import pytest

from ngspring import Design, DesignFileError, cases, gallery, optimality
from ngspring.design.soundness import flaw


def test_the_gallery_holds_the_compression_springs_c4_and_c7() -> None:
    assert {"C4", "C7"} <= set(gallery)


def test_the_gallery_is_a_read_only_mapping_of_every_stored_file() -> None:
    stored = [e.name for e in (files("ngspring.design") / "stored").iterdir() if e.name[0] != "."]
    stored = [name for name in stored if not name.startswith(("snapshots-", "states-"))]
    assert sorted(gallery) == sorted(name.removesuffix(".npz") for name in stored)
    assert len(gallery) == len(list(gallery)) == len(set(gallery))
    assert all(name in gallery for name in gallery)
    assert "no such design" not in gallery
    assert 7 not in gallery
    with pytest.raises(TypeError):
        gallery["C7"] = None  # type: ignore[index]


@pytest.mark.parametrize("name", ["C77", "c7", "", "../stored/C7", "C7.npz", "\n", "x" * 1000])
def test_an_unknown_name_is_one_line_that_says_so(name: str) -> None:
    assert name not in gallery
    with pytest.raises(DesignFileError, match="no stored design") as caught:
        gallery[name]
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert len(message) < 250
    assert message[0] not in "'\""  # str() of a plain KeyError is a quoted repr


def test_an_unknown_name_is_answered_with_the_nearest_one() -> None:
    for name in gallery:
        with pytest.raises(DesignFileError, match=f"did you mean '{name}'"):
            gallery[name.lower() + " "]


def test_get_of_an_unknown_name_is_its_default_as_for_every_mapping() -> None:
    assert gallery.get("no such design") is None


def test_every_stored_design_belongs_to_its_case() -> None:
    for name, design in gallery.items():
        assert isinstance(design, Design), name
        case = design.problem.name
        assert name == case or name.startswith(f"{case}-"), name
        problem = cases[case]
        if name.endswith("-not-robust"):
            # Appendix A: without the control point of the dilated design.
            blueprint = [point for point in problem.control_points if not point.eta]
            assert len(blueprint) < len(problem.control_points), name
            problem = problem.replace(control_points=tuple(blueprint))
        assert design.problem == problem, name


def test_every_stored_design_says_that_it_converged_to_its_targets() -> None:
    for name, design in gallery.items():
        assert design.info["converged"] is True, name
        for point, q in zip(design.problem.control_points, design.info["q"], strict=True):
            if point.eta == 0:
                assert q == pytest.approx(point.q, rel=1e-3), name


def test_every_stored_design_has_the_history_of_a_whole_run() -> None:
    for name, design in gallery.items():
        h = design.history
        assert h is not None, name
        np.testing.assert_array_equal(h["update"], np.arange(len(h)), name)
        assert h["dt"][-1] == np.inf, name
        assert np.isfinite(h["dt"][:-1]).all(), name
        # C falls but where the states were put back on the path from rest (dt = 0).
        steps = h["dt"][1:] > 0
        assert (np.diff(h["C"])[steps] <= 1e-6 * np.abs(h["C"][1:])[steps]).all(), name
        width = design.problem.equivalent_width(design.volume) / design.problem.H
        assert h["width"][-1] == pytest.approx(width, rel=1e-10), name
        np.testing.assert_allclose(
            [h[f"q{j + 1}"][-1] for j in range(len(design.info["q"]))], design.info["q"]
        )


def test_c7_needs_no_more_material_than_the_paper_s() -> None:
    if "C7" in gallery:  # that it is there is a test of its own
        design = gallery["C7"]
        assert design.equivalent_width / design.problem.H <= 0.2539


def test_volume_grows_with_the_stiffening_that_is_asked_for() -> None:
    for family in ("C1 C2 C3 C4 C5 C6 C7", "T2 T3 T4 T5 T6"):
        widths = [gallery[name].equivalent_width for name in family.split() if name in gallery]
        assert (np.diff(widths) > 0).all()


@pytest.mark.slow
def test_every_stored_design_is_a_stationary_point_that_meets_its_targets() -> None:
    assert len(gallery) > 0
    for name, design in gallery.items():
        check = optimality(design)
        assert check.residual <= 1e-6, name
        blueprint = np.array([point.eta == 0 for point in design.problem.control_points])
        assert abs(check.deviation[blueprint]).max() <= 1e-3, name
        # What the dilated control point is there for (section 2.6).
        assert bool(flaw(design, check.grey)) == (name == "T1-not-robust"), name


@pytest.mark.slow
def test_every_stored_design_is_a_stationary_point_on_the_full_domain_too() -> None:
    for name, design in gallery.items():
        if design.problem.elements <= 80:
            assert optimality(design, domain="full").residual <= 1e-6, name
