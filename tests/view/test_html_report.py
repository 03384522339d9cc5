"""The report is one file that a browser shows: design, curve, convergence, time left."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.browser import needs_chromium, probe, screenshot

import ngspring
import ngspring.analysis.mechanics
from ngspring import ControlPoint, Design, History, SpringProblem, gallery
from ngspring.basics.arrays import FloatArray
from ngspring.design.history import stages
from ngspring.evolution.estimate import seconds_left
from ngspring.evolution.runstate import (
    CONVERGED,
    FAILED,
    RUNNING,
    RunState,
    StoredCurve,
    stored_state,
)
from ngspring.view.figure import new_figure
from ngspring.view.html import picture
from ngspring.view.report import REFRESH, report_page, time_left_text, write_index, write_report


class Tags(HTMLParser):
    """All tags with their attributes, and the visible text; complains about wrong nesting."""

    VOID = ("meta", "link", "img")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.text += data

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def cut(history: History, rows: int) -> History:
    return History(history.columns, history.values[:rows])


def running(name: str = "C7", rows: int = 30) -> RunState:
    """A stored run as it was after some design updates (with the picture of its end)."""
    design = gallery[name]
    assert design.history is not None
    history = cut(design.history, rows)
    points = len(design.problem.control_points)
    q = [history.last()[f"q{j + 1}"] for j in range(points)]
    now = Design(design.problem, design.coefficients, history, {"q": q, "converged": False})
    return RunState(now, RUNNING, updated=None)


def straight_curve(design: Design) -> StoredCurve:
    """Through the targets of a design."""
    points = sorted([(0.0, 0.0), *((p.d, p.q) for p in design.problem.control_points)])
    d, q = np.array(points).T
    return StoredCurve(d, q)


@pytest.fixture
def report(tmp_path: Path) -> Path:
    """A finished run's report with a curve."""
    design = gallery["C7"]
    path = tmp_path / "report.html"
    write_report(RunState(design, CONVERGED, curve=straight_curve(design)), path)
    return path


# -- the file --------------------------------------------------------------------------------------


def test_what_is_stored_and_not_computed_is_marked(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    for marked in ("reached q [N] †", "deviation †", "† The load-displacement curve"):
        assert marked in text
    assert "as the run has stored it, not computed anew" in text
    # These are.
    assert "W/H †" not in text


def test_the_file_needs_nothing_from_elsewhere(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    tags = Tags(text)
    for name in ("src", "href"):
        places = [attributes[name] for _, attributes in tags.tags if name in attributes]
        assert all(place is not None and place.startswith("data:") for place in places)
    assert not tags.of("script")
    assert "url(" not in text
    assert "@import" not in text


def test_the_file_is_readable_for_people_and_screen_readers(report: Path) -> None:
    tags = Tags(report.read_text(encoding="utf-8"))
    assert tags.of("html") == [{"lang": "en"}]
    assert tags.of("title")
    names = {attributes["id"] for attributes in tags.of("img")}
    assert names == {"design", "curve", "convergence", "forces"}
    assert all(len(attributes["alt"] or "") > 30 for attributes in tags.of("img"))
    assert any(attributes.get("name") == "viewport" for attributes in tags.of("meta"))


def test_the_report_tells_the_numbers_of_the_run(report: Path) -> None:
    design = gallery["C7"]
    assert design.history is not None
    text = Tags(report.read_text(encoding="utf-8")).text
    assert "C7: converged" in text
    assert f"{design.equivalent_width / design.problem.H:.4f}" in text
    assert str(design.history.newton_iterations) in text
    assert "target q [N]" in text
    for q in design.info["q"]:
        assert f"{q:.4f}" in text
    assert "80 × 80 elements" in text


@pytest.mark.long
def test_only_a_run_that_goes_on_is_loaded_again() -> None:
    def refreshes(state: RunState) -> list[str | None]:
        tags = Tags(report_page(state)).of("meta")
        return [tag["content"] for tag in tags if tag.get("http-equiv") == "refresh"]

    assert refreshes(running()) == [str(REFRESH)]
    assert refreshes(stored_state(gallery["C7"])) == []
    assert "time left" in Tags(report_page(running())).text
    assert "time left" not in Tags(report_page(stored_state(gallery["C7"]))).text


def test_a_failed_run_says_why() -> None:
    state = RunState(gallery["C7"], FAILED, "dt fell below 1e-8: no <convergence>")
    assert "dt fell below 1e-8: no <convergence>" in Tags(report_page(state)).text


def test_names_cannot_break_the_page() -> None:
    problem = SpringProblem(
        (ControlPoint(-10, -2),), name="</title><script>x</script>&", elements=8
    )
    text = report_page(stored_state(Design.column(problem)))
    assert "<script>" not in text
    assert problem.name in Tags(text).text


def test_a_design_without_history_and_forces_has_a_report_too() -> None:
    problem = SpringProblem((ControlPoint(-10, -2),), kinematics="axisymmetric", elements=8)
    tags = Tags(report_page(stored_state(Design.column(problem))))
    assert {a["id"] for a in tags.of("img")} == {"design", "curve"}
    assert "D/H" in tags.text


@pytest.mark.long
def test_a_design_is_reported_as_a_finished_run(tmp_path: Path) -> None:
    ngspring.write_report(gallery["C4"], tmp_path / "C4.html")
    assert "C4: converged" in (tmp_path / "C4.html").read_text(encoding="utf-8")


def test_a_curve_that_ends_early_is_named() -> None:
    design = gallery["C7"]
    curve = StoredCurve(np.array([0.0, 10.0]), np.array([0.0, 2.0]))
    text = Tags(report_page(RunState(design, CONVERGED, curve=curve))).text
    assert "The curve ends before d = -10, -20 mm" in text


def test_writing_a_report_computes_no_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("an equilibrium is computed")

    monkeypatch.setattr(ngspring.analysis.mechanics.Mechanics, "__init__", refuse)
    assert 'class="badge running"' in report_page(running())


def test_the_index_of_a_campaign_links_to_its_runs(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    runs = {"C7 & co": running(), "C4": stored_state(gallery["C4"]), "bad": "is damaged"}
    write_index(runs.items(), path, "mine", refresh=3)
    tags = Tags(path.read_text(encoding="utf-8"))
    assert [a["href"] for a in tags.of("a")] == ["C7%20%26%20co/report.html", "C4/report.html"]
    assert "3 runs begun, 2 of them ended" in tags.text
    assert "is damaged" in tags.text


# -- time left -------------------------------------------------------------------------------------


def with_clean_seconds(history: History) -> History:
    """The history of a machine with nothing beside: seconds as the iterations of each mesh cost."""
    values = history.values.copy()
    begun = history["dt"] == 0.0
    iterations = history["newton_iterations"] + history["rejected_iterations"] + 2 * begun
    cost = (history["elements"] / 80) ** 2.2
    values[:, history.columns.index("seconds")] = np.cumsum(iterations * cost)
    return History(history.columns, values)


def ratios(name: str) -> FloatArray:
    """Estimated over real time left, for every update but the first and last ones."""
    design = gallery[name]
    assert design.history is not None
    history = with_clean_seconds(design.history)
    seconds = history["seconds"]
    found = []
    for rows in range(4, len(history) - 2):
        estimate = seconds_left(cut(history, rows), design.problem)
        assert estimate is not None
        found.append(estimate / (seconds[-1] - seconds[rows - 1]))
    return np.array(found)


def climbed(name: str) -> bool:
    """Whether a stored design came over a ladder of meshes."""
    history = gallery[name].history
    return history is not None and len(stages(history.rows())) > 1


CLIMBED = sorted(filter(climbed, gallery))


@pytest.mark.parametrize("name", CLIMBED)
def test_the_time_left_is_right_within_a_factor_of_four(name: str) -> None:
    found = ratios(name)
    assert found.min() > 1 / 4
    assert found.max() < 4


def test_the_time_left_is_not_known_at_once_and_nothing_at_the_end() -> None:
    design = gallery["C7"]
    assert design.history is not None
    assert seconds_left(cut(design.history, 3), design.problem) is None
    assert time_left_text(cut(design.history, 1), design.problem) == "not known yet"
    assert seconds_left(design.history, design.problem) == 0.0


def test_the_time_left_is_proportional_to_the_seconds_of_the_machine() -> None:
    design = gallery["C7"]
    assert design.history is not None
    slow = cut(design.history, 40)
    values = slow.values.copy()
    values[:, slow.columns.index("seconds")] *= 100
    fast_estimate = seconds_left(slow, design.problem)
    slow_estimate = seconds_left(History(slow.columns, values), design.problem)
    assert fast_estimate is not None
    assert slow_estimate == pytest.approx(100 * fast_estimate)
    values[:, slow.columns.index("seconds")] /= 10
    text = time_left_text(History(slow.columns, values), design.problem)
    assert re.fullmatch(r"about \d+ min", text)


# -- in a real browser -----------------------------------------------------------------------------


def region(picture: FloatArray, box: list[float]) -> FloatArray:
    left, top, width, height = (round(value) for value in box)
    return picture[top : top + height, left : left + width]


@needs_chromium
def test_a_browser_shows_the_design_and_the_curve(report: Path, tmp_path: Path) -> None:
    images = probe(report, tmp_path)["images"]
    assert {"design", "curve", "convergence", "forces"} <= set(images)
    for image in images.values():
        assert image["complete"]
        assert image["width"] > 300
    shot = screenshot(report, tmp_path)
    shown = region(shot, images["design"]["box"])
    # C7 fills a quarter of the square, which is about half of the picture: black and white.
    assert 0.05 < (shown < 0.15).mean() < 0.5
    assert (shown > 0.9).mean() > 0.3
    # Without its curve the diagram has less ink.
    bare = tmp_path / "bare.html"
    write_report(RunState(gallery["C7"], CONVERGED), bare)
    boxes = probe(bare, tmp_path)["images"]["curve"]["box"]
    without = region(screenshot(bare, tmp_path), boxes)
    with_curve = region(shot, images["curve"]["box"])
    assert with_curve.shape == without.shape
    assert (with_curve < 0.3).sum() > (without < 0.3).sum() + 300


@needs_chromium
def test_the_browser_test_sees_a_broken_picture(report: Path, tmp_path: Path) -> None:
    text = report.read_text(encoding="utf-8")
    broken = tmp_path / "broken.html"
    start = text.index("base64,", text.index('id="design"')) + len("base64,")
    broken.write_text(text[:start] + "AAAA" + text[start + 4 :], encoding="utf-8")
    images = probe(broken, tmp_path)["images"]
    assert images["design"]["width"] == 0
    assert images["curve"]["width"] > 300
    shown = region(screenshot(broken, tmp_path), images["design"]["box"])
    assert (shown < 0.15).mean() < 0.05


@needs_chromium
def test_a_phone_shows_the_whole_width(report: Path, tmp_path: Path) -> None:
    found = probe(report, tmp_path, width=500, height=3000)
    assert found["overflow"] <= 0
    for image in found["images"].values():
        left, _, width, _ = image["box"]
        assert left >= 0
        assert 300 < width <= 500 - left


def test_pictures_say_their_size_before_they_are_loaded() -> None:
    figure = new_figure(4.0, 2.0, constrained=False)
    text = picture("x", figure, "nothing", "<nothing>", dpi=50)
    assert 'width="200" height="100"' in text
    assert "&lt;nothing&gt;" in text
