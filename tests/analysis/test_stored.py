"""What is stored of a finished design is shown, and never that of another one."""

from __future__ import annotations

import dataclasses
import logging
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.commands import invoke

from ngspring import ControlPoint, Design, DesignFileError, SpringProblem, gallery
from ngspring.analysis.finished import (
    STATES_FILE,
    computed_responses,
    curve_of,
    responses_in,
    responses_in_gallery,
    responses_of,
)
from ngspring.analysis.path import Jump
from ngspring.analysis.response import Response
from ngspring.analysis.states import control_places, full_displacement
from ngspring.analysis.stored import StoredResponse, StoredStates
from ngspring.basics.text import significant

POINTS = ControlPoint(10.0, 2.0), ControlPoint(-10.0, -2.0), ControlPoint(10.0, 2.0, eta=1.0)
PROBLEM = SpringProblem(POINTS, name="small", elements=8, l_i=10.0)
NUMBERS = ("d", "q", "energy", "stiffness", "grey")


@pytest.fixture(scope="module")
def design() -> Design:
    return Design.column(PROBLEM)


@pytest.fixture(scope="module")
def responses(design: Design) -> dict[float, Response]:
    return computed_responses(design, threads=1)


@pytest.fixture
def folder(design: Design, responses: dict[float, Response], tmp_path: Path) -> Path:
    """A folder with a design and its states."""
    design.save(tmp_path / "design.npz")
    StoredStates.of(design, responses).save(tmp_path / STATES_FILE)
    return tmp_path


def with_forces(stored: StoredStates, factor: float) -> StoredStates:
    """The same with other forces, for the same design."""
    changed = {e: dataclasses.replace(r, q=factor * r.q) for e, r in stored.responses.items()}
    return dataclasses.replace(stored, responses=changed)


def rewritten(path: Path, **parts: object) -> None:
    """Replace parts of a file."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    arrays |= {name: np.asarray(part) for name, part in parts.items()}
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]


# -- the file --------------------------------------------------------------------------------------


def test_numbers_are_stored_exactly(
    folder: Path, responses: dict[float, Response], design: Design
) -> None:
    stored = StoredStates.load(folder / STATES_FILE)
    assert stored.belong_to(design)
    assert list(stored.responses) == list(responses) == [0.0, 1.0]
    for eta, response in stored.responses.items():
        for name in NUMBERS:
            np.testing.assert_array_equal(getattr(response, name), getattr(responses[eta], name))
        assert response.iterations == responses[eta].iterations
        assert response.complete
        assert response.problem == responses[eta].problem


def test_states_at_control_points_are_stored_to_half_a_step_of_16_bits(
    folder: Path, responses: dict[float, Response]
) -> None:
    stored = StoredStates.load(folder / STATES_FILE).responses
    for eta, response in stored.items():
        places = control_places(response, PROBLEM, eta)
        assert sorted(response.nodes_u) == sorted(places)
        assert len(places) == sum(point.eta == eta for point in POINTS)
        for place in places:
            exact = responses[eta].nodes_u[place]
            most = 0.5001 * np.abs(exact).max() / 32767
            np.testing.assert_allclose(response.nodes_u[place], exact, rtol=0, atol=most)
            whole = full_displacement(response, place)
            np.testing.assert_allclose(whole, full_displacement(responses[eta], place), atol=2e-4)


def test_a_path_that_ends_early_and_its_jumps_are_stored(
    tmp_path: Path, design: Design, responses: dict[float, Response]
) -> None:
    jumps = (Jump(-3.0, -1.0, -0.5), Jump(2.0, 0.5, 0.25))
    reached = responses[0.0].selected(np.flatnonzero(np.abs(responses[0.0].d) < 5))
    early = dataclasses.replace(reached, complete=False, message="the path ends", jumps=jumps)
    none = responses[1.0].selected([])
    StoredStates.of(design, {0.0: early, 1.0: none}).save(tmp_path / STATES_FILE)
    stored = StoredStates.load(tmp_path / STATES_FILE).responses
    assert (stored[0.0].complete, stored[0.0].message) == (False, "the path ends")
    assert stored[0.0].jumps == jumps
    assert not stored[0.0].nodes_u
    assert len(stored[1.0].d) == 0
    assert stored[1.0].jumps == ()


def test_a_message_is_shown_and_not_obeyed(folder: Path) -> None:
    rewritten(folder / STATES_FILE, messages=np.array(["\x1b[2J", "x" * 1000]))
    first, second = StoredStates.load(folder / STATES_FILE).responses.values()
    assert first.message == "?[2J"
    assert len(second.message) <= 300


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        ({"format": "ngspring-design"}, "not a states file"),
        ({"version": 2}, "update ngspring"),
        ({"problem": "elements = 3"}, "not a valid states file"),
        ({"domain": "half"}, "domain"),
        ({"q": np.full(42, np.nan)}, "finite"),
        ({"d": np.zeros(42)}, "increase"),
        ({"q": np.zeros(5)}, "differ in length"),
        ({"points": np.array([-1, 43])}, "differ in length"),
        ({"eta": np.array([0.0, 0.0])}, "must differ"),
        ({"eta": np.array([2.0, 1.0])}, "0 be among them"),
        ({"messages": np.array(["one"])}, "differ in length"),
        ({"u": np.zeros((3, 2, 5, 5), np.int16)}, "another mesh"),
        ({"u": np.zeros((3, 2, 9, 9))}, "another type"),
        ({"places": np.array([0, 1, 99])}, "belong to no points"),
        ({"places": np.array([0, 1, 2])}, "are missing"),
        ({"jumps": np.zeros((1, 3))}, "another mesh"),
        ({"nonsense": 1}, "a part is missing"),
    ],
)
def test_what_is_no_states_file_is_refused_in_one_line(
    folder: Path, parts: dict[str, object], reason: str
) -> None:
    path = folder / STATES_FILE
    StoredStates.load(path)
    rewritten(path, **parts)
    with pytest.raises(DesignFileError, match=reason) as caught:
        StoredStates.load(path)
    assert "\n" not in str(caught.value)


# -- stored or computed ----------------------------------------------------------------------------


@pytest.mark.long
def test_what_is_stored_is_shown_and_not_computed_again(
    folder: Path, responses: dict[float, Response], design: Design
) -> None:
    before = invoke("show", folder, "--threads", 1).stdout
    twice = with_forces(StoredStates.of(design, responses), 2.0)
    twice.save(folder / STATES_FILE)
    after = invoke("show", folder, "--threads", 1).stdout
    q = float(responses[1.0].q[0])
    assert significant(q, 6) in before
    assert significant(2 * q, 6) in after


@pytest.mark.long
def test_show_prints_the_same_whether_it_is_stored_or_not(folder: Path) -> None:
    stored = invoke("show", folder, "--threads", 1)
    (folder / STATES_FILE).unlink()
    computed = invoke("show", folder, "--threads", 1)
    assert (stored.stdout, stored.stderr) == (computed.stdout, computed.stderr)


@pytest.mark.parametrize(
    "other",
    [
        Design(PROBLEM, Design.column(PROBLEM).coefficients + 1e-12),
        Design.column(PROBLEM.replace(k_r=2e-6)),
        Design.column(PROBLEM.replace(control_points=POINTS[:2])),
    ],
)
def test_the_states_of_another_design_are_never_taken(folder: Path, other: Design) -> None:
    assert responses_in(folder, other) is None


def test_a_design_whose_name_was_corrected_keeps_its_states(folder: Path, design: Design) -> None:
    renamed = Design(PROBLEM.replace(name="other"), design.coefficients)
    assert responses_in(folder, renamed) is not None


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\3\4 but nothing follows"])
def test_damaged_states_are_computed_again_and_the_log_says_so(
    folder: Path, design: Design, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    (folder / STATES_FILE).write_bytes(content)
    with caplog.at_level(logging.WARNING, "ngspring"):
        found = responses_of(design, folder, threads=1)
    assert isinstance(found[0.0], Response)
    assert "computed again" in caplog.text
    assert STATES_FILE in caplog.text


def test_a_folder_or_a_pipe_of_that_name_is_no_obstacle(tmp_path: Path, design: Design) -> None:
    (tmp_path / STATES_FILE).mkdir()
    assert responses_in(tmp_path, design) is None
    assert responses_in(tmp_path / "nowhere", design) is None


@pytest.mark.long
def test_showing_a_stored_design_does_not_import_ngsolve(tmp_path: Path) -> None:
    code = (
        "import sys; from ngspring.cli.main import cli\n"
        f"try: cli(['show', 'C7', '--out', {str(tmp_path / 'C7.png')!r}])\n"
        "except SystemExit as end: assert not end.code\n"
        "assert 'ngsolve' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    assert (tmp_path / "C7.png").stat().st_size > 10_000


def test_check_fails_a_design_whose_stored_load_path_is_not_its_own(
    folder: Path, responses: dict[float, Response], design: Design
) -> None:
    own = invoke("check", folder, "--threads", 1, code=1).stdout
    with_forces(StoredStates.of(design, responses), 1.001).save(folder / STATES_FILE)
    other = invoke("check", folder, "--threads", 1, code=1).stdout
    assert "stored" not in own
    assert "stored" in other


# -- the gallery -----------------------------------------------------------------------------------


def test_every_design_of_the_gallery_has_its_states() -> None:
    for name, design in gallery.items():
        stored = responses_in_gallery(design)
        assert stored is not None, name
        assert all(response.complete for response in stored.values()), name
        assert {0.0, *(p.eta for p in design.problem.control_points)} == set(stored), name


def test_no_states_are_left_of_designs_that_are_gone() -> None:
    for resource in gallery.folder.iterdir():
        if resource.name.startswith("states-"):
            assert resource.name.removeprefix("states-").removesuffix(".npz") in gallery


def test_stored_forces_are_those_that_the_runs_have_noted() -> None:
    for name, design in gallery.items():
        stored = responses_in_gallery(design)
        assert stored is not None, name
        for point, q in zip(design.problem.control_points, design.info["q"], strict=True):
            response = stored[point.eta]
            found = response.q[list(response.d).index(point.d)]
            assert found == pytest.approx(q, rel=1e-5), name


@pytest.mark.slow
def test_the_stored_load_path_of_every_design_is_what_is_computed() -> None:
    for name, design in gallery.items():
        stored, computed = responses_in_gallery(design), computed_responses(design)
        assert stored is not None, name
        for eta, response in computed.items():
            np.testing.assert_array_equal(stored[eta].d, response.d, name)
            np.testing.assert_allclose(stored[eta].q, response.q, rtol=1e-6, err_msg=name)
            for place, u in stored[eta].nodes_u.items():
                np.testing.assert_allclose(u, response.nodes_u[place], atol=1e-3, err_msg=name)


def test_a_curve_at_stored_displacements_is_not_computed_again() -> None:
    design = gallery["C7"]
    places = [10.0, -20.0, -2.0]
    curve = curve_of(design, places)
    assert isinstance(curve, StoredResponse)
    # In the order asked for, with the fields of the control points where they belong.
    assert curve.d.tolist() == places
    forces = dict(zip([p.d for p in design.problem.control_points], design.info["q"], strict=True))
    assert curve.q[:2] == pytest.approx([forces[10.0], forces[-20.0]], rel=1e-9)
    assert sorted(curve.nodes_u) == [0, 1]
    assert curve.nodes_u[0][1].max() == pytest.approx(10.0 / 2, rel=1e-3)


def test_a_curve_elsewhere_is_computed() -> None:
    design = gallery["C7"].with_problem(PROBLEM)
    curve = curve_of(design, [0.0, 1.0], threads=1)
    assert isinstance(curve, Response)
    assert curve.d.tolist() == [0.0, 1.0]
