"""Watching a run: its state is read from the folder while it is written, and reported."""

from __future__ import annotations

import csv
import dataclasses
import os
import re
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup
from support.commands import invoke

from ngspring import ControlPoint, Design, RunFolderError, SpringProblem, gallery, optimize
from ngspring.analysis.finished import STATES_FILE
from ngspring.design.history import History
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.folder import CHECKPOINT, DESIGN, LOCK, in_use, locked
from ngspring.evolution.runstate import (
    CONVERGED,
    FAILED,
    RESPONSE,
    RUNNING,
    STALE,
    STOPPED,
    read_run,
    stored_state,
)
from ngspring.evolution.steprule import StepRule
from ngspring.evolution.updates import Update
from ngspring.kkt.newton import NewtonSettings
from ngspring.view.report import REPORT, ReportWriter, report_page
from ngspring.view.run_files import write_pictures

PROBLEM = SpringProblem((ControlPoint(-10.0, -2.0),), name="small", elements=8, l_i=10.0)


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {
        str(path.relative_to(folder)): (path.read_bytes(), path.stat().st_mtime_ns)
        for path in folder.rglob("*")
        if path.is_file()
    }


def status_of(report: Path) -> str:
    """The status that a report shows."""
    (found,) = re.findall(r'<span class="badge \w+">(\w+)</span>', report.read_text("utf-8"))
    return str(found)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was stopped after four design updates."""
    folder = tmp_path_factory.mktemp("runs") / "begun"
    optimize(PROBLEM, max_updates=4, out=folder, threads=1)
    return folder


@pytest.fixture(scope="module")
def ended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that has converged, with its pictures."""
    folder = tmp_path_factory.mktemp("runs") / "ended"
    result = optimize(PROBLEM, out=folder, threads=1)
    assert result.converged
    write_pictures(result, folder, threads=1)
    return folder


@pytest.fixture
def run(begun: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(begun, tmp_path / "run"))


@pytest.fixture
def finished(ended: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(ended, tmp_path / "finished"))


@pytest.fixture
def sleeps(monkeypatch: pytest.MonkeyPatch) -> list[Callable[[], object]]:
    """What happens while ``ngspring watch`` sleeps, one after the other; then the test ends."""
    steps: list[Callable[[], object]] = []

    def sleep(seconds: float) -> None:
        assert seconds == 0.5
        assert steps, "the run has ended, but the watch goes on"
        steps.pop(0)()

    monkeypatch.setattr("ngspring.cli.watch.time.sleep", sleep)
    return steps


@pytest.fixture
def no_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures in reports are their ids, for what is about when a report is written, and where."""
    monkeypatch.setattr(
        "ngspring.view.report.picture",
        lambda name, *_, **__: Markup('<p id="{}"></p>').format(name),
    )


# -- what state a run is in ------------------------------------------------------------------------


def test_a_run_that_was_asked_to_stop_says_so(run: Path) -> None:
    state = read_run(run)
    assert state.status == STOPPED
    assert state.reason == "stopped after 4 design updates, as asked"
    assert not state.going_on
    checkpoint = Checkpoint.load(run / CHECKPOINT)
    assert state.forces == [checkpoint.history.last().q[0]]
    np.testing.assert_array_equal(state.design.coefficients.ravel(), checkpoint.state.chi)


def test_a_run_whose_process_died_was_interrupted(run: Path) -> None:
    (run / DESIGN).unlink()
    state = read_run(run)
    assert (state.status, state.reason) == (STOPPED, "interrupted before its end")


def test_a_run_that_failed_says_why(tmp_path: Path) -> None:
    never = NewtonSettings(0.0, 0.0, 0.0, max_iterations=1)
    rule = StepRule(smallest=0.5)
    result = optimize(PROBLEM, out=tmp_path / "run", threads=1, rule=rule, newton=never)
    state = read_run(tmp_path / "run")
    assert (state.status, state.reason) == (FAILED, result.message)
    assert "dt fell below" in state.reason


def test_a_run_is_running_while_a_process_holds_its_folder(run: Path) -> None:
    assert in_use(run) is False
    with locked(run):
        assert in_use(run) is True
        state = read_run(run)
        assert state.status == RUNNING
        assert state.going_on
    assert in_use(run) is False


def test_a_run_without_an_update_for_long_is_stale(run: Path) -> None:
    hour_ago = time.time() - 3600
    with locked(run):
        for name in (CHECKPOINT, LOCK):
            os.utime(run / name, (hour_ago, hour_ago))
        state = read_run(run)
    assert state.status == STALE
    assert state.reason == "no design update for 60 minutes"
    assert state.elapsed == pytest.approx(3600, abs=60)


def test_a_run_that_is_resumed_after_a_pause_is_not_stale(run: Path) -> None:
    yesterday = time.time() - 86400
    for name in (CHECKPOINT, LOCK):
        os.utime(run / name, (yesterday, yesterday))
    with locked(run):
        state = read_run(run)
    assert state.status == RUNNING
    assert state.elapsed is not None
    assert state.elapsed < 600


def test_looking_whether_a_folder_is_in_use_never_stops_a_run_from_beginning(run: Path) -> None:
    stop = threading.Event()

    def look() -> None:
        while not stop.is_set():
            in_use(run)

    thread = threading.Thread(target=look)
    thread.start()
    try:
        for _ in range(200):
            with locked(run):
                pass
    finally:
        stop.set()
        thread.join()


def test_a_converged_run_has_its_curve_and_its_pictures(finished: Path) -> None:
    state = read_run(finished)
    assert state.status == CONVERGED
    assert not state.going_on
    assert state.curve is not None
    assert state.curve.d.min() == -10.0
    assert np.interp(-10.0, state.curve.d, state.curve.q) == pytest.approx(-2.0, rel=1e-3)
    assert state.states is not None


def test_a_converged_run_goes_on_until_its_curve_is_there(finished: Path) -> None:
    for name in (RESPONSE, STATES_FILE):
        (finished / name).unlink()
    with locked(finished):
        state = read_run(finished)
        assert (state.status, state.going_on, state.evolving) == (CONVERGED, True, False)
    assert not read_run(finished).going_on


def test_the_curve_of_another_design_is_not_shown(run: Path, finished: Path) -> None:
    # Left behind by an earlier end of a run that was resumed since.
    for name in (RESPONSE, STATES_FILE, "design.png"):
        shutil.copy(finished / name, run / name)
    with locked(run):
        state = read_run(run)
    assert state.curve is None
    assert state.responses is None
    assert state.states is None


def test_a_run_from_before_there_were_states_has_the_curve_of_its_table(finished: Path) -> None:
    stored = read_run(finished).curve
    (finished / STATES_FILE).unlink()
    state = read_run(finished)
    assert state.responses is None
    assert stored is not None
    assert state.curve is not None
    np.testing.assert_array_equal(state.curve.d, stored.d)
    np.testing.assert_array_equal(state.curve.q, stored.q)


def test_damaged_states_are_no_states_and_the_table_is_left(finished: Path) -> None:
    content = (finished / STATES_FILE).read_bytes()
    (finished / STATES_FILE).write_bytes(content[: len(content) // 2])
    state = read_run(finished)
    assert state.responses is None
    assert state.curve is not None


@pytest.mark.long
def test_a_report_draws_the_states_that_are_stored_if_nobody_has_drawn_them(finished: Path) -> None:
    (finished / "design.png").unlink()
    assert 'id="states"' in report_page(read_run(finished))
    (finished / STATES_FILE).unlink()
    assert 'id="states"' not in report_page(read_run(finished))


@pytest.mark.parametrize("text", ["", "d,q\n1,x\n2,3\n", "a,b\n1,2\n", "d,q\n1,nan\n2,1\n", "\0"])
def test_a_damaged_curve_is_not_shown(finished: Path, text: str) -> None:
    (finished / STATES_FILE).unlink()
    (finished / RESPONSE).write_text(text)
    assert read_run(finished).curve is None


def test_a_curve_that_misses_the_forces_is_not_shown(finished: Path) -> None:
    (finished / STATES_FILE).unlink()
    with (finished / RESPONSE).open(newline="") as file:
        rows = list(csv.DictReader(file))
    lines = ["d,q", *(f"{row['d']},{1.01 * float(row['q'])}" for row in rows)]
    (finished / RESPONSE).write_text("\n".join(lines))
    assert read_run(finished).curve is None


def test_a_run_can_be_read_while_it_is_written(run: Path) -> None:
    checkpoint = Checkpoint.load(run / CHECKPOINT)
    stop = threading.Event()

    def write() -> None:
        while not stop.is_set():
            checkpoint.save(run / CHECKPOINT)

    thread = threading.Thread(target=write)
    thread.start()
    try:
        for _ in range(50):
            assert len(read_run(run).design.history or ()) == 5
    finally:
        stop.set()
        thread.join()


def test_reading_writes_nothing(run: Path, finished: Path) -> None:
    with locked(run):
        before = contents(run.parent)
        read_run(run)
        read_run(finished)
        assert contents(run.parent) == before


def test_a_stored_design_is_converged_and_has_forces() -> None:
    state = stored_state(gallery["C7"])
    assert state.status == CONVERGED
    assert state.forces == pytest.approx([2.0, -2.0, -5.5], rel=1e-3)


def test_a_stored_design_has_the_curve_and_the_states_of_the_gallery(
    finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(finished)
    # Neither the curve nor the picture of the run whose folder this is.
    state = stored_state(gallery["C7"], Path())
    assert state.curve is not None
    assert state.curve.d.min() == -20.0
    assert state.states is None
    page = report_page(state)
    assert 'id="states"' in page
    assert "The whole curve has not been computed" not in page


def test_a_folder_with_nothing_but_a_design_can_be_read(finished: Path) -> None:
    (finished / CHECKPOINT).unlink()
    state = read_run(finished)
    assert state.status == CONVERGED
    assert state.curve is not None


# -- ngspring watch --------------------------------------------------------------------------------


def test_watching_a_run_that_has_ended_writes_one_report(run: Path) -> None:
    result = invoke("watch", run)
    assert f"report: {run / REPORT}" in result.stdout
    assert "stopped after 4 design updates" in result.stdout
    assert "stopped after 4 design updates, as asked" in (run / REPORT).read_text()


@pytest.mark.usefixtures("no_drawing")
def test_watching_goes_on_until_the_run_ends(
    run: Path, sleeps: list[Callable[[], object]], tmp_path: Path
) -> None:
    out = tmp_path / "mine.html"
    reports: list[str] = []
    hold = locked(run)
    hold.__enter__()

    def look() -> None:
        reports.append(out.read_text())

    def next_update() -> None:
        look()
        checkpoint = Checkpoint.load(run / CHECKPOINT)
        rows = checkpoint.history.rows()
        # One update more: a report of the same ones may be the same text within a second.
        rows.append(dataclasses.replace(rows[-1], update=rows[-1].update + 1))
        dataclasses.replace(checkpoint, history=History.from_rows(rows)).save(run / CHECKPOINT)
        later = time.time() + 5
        os.utime(run / CHECKPOINT, (later, later))

    def nothing() -> None:
        look()

    def end() -> None:
        look()
        hold.__exit__(None, None, None)

    sleeps += [next_update, nothing, end]
    result = invoke("watch", run, "--interval", 0.5, "--out", out)
    assert not sleeps
    assert reports[0] != reports[1] == reports[2]
    assert all('http-equiv="refresh"' in text for text in reports)
    assert 'http-equiv="refresh"' not in out.read_text()
    assert "stopped" in result.stdout
    assert not (run / REPORT).exists()


@pytest.mark.usefixtures("no_drawing")
def test_watching_once_does_not_wait(run: Path, sleeps: list[Callable[[], object]]) -> None:
    with locked(run):
        result = invoke("watch", run, "--once", "--interval", 0.5)
    assert "running after 4 design updates" in result.stdout
    assert 'content="1"' in (run / REPORT).read_text()


@pytest.mark.usefixtures("no_drawing")
def test_watching_waits_for_the_first_design(
    begun: Path, tmp_path: Path, sleeps: list[Callable[[], object]]
) -> None:
    folder = tmp_path / "new"
    hold = locked(folder)
    hold.__enter__()

    def begin() -> None:
        shutil.copy(begun / CHECKPOINT, folder / CHECKPOINT)

    def end() -> None:
        hold.__exit__(None, None, None)

    sleeps += [begin, end]
    result = invoke("watch", folder, "--interval", 0.5)
    assert "waiting for the first design" in result.stdout
    assert "stopped" in result.stdout


def test_watching_a_stored_design_writes_its_report_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke("watch", "C4").stdout == "report: C4.html\n"
    assert status_of(tmp_path / "C4.html") == CONVERGED


@pytest.mark.long
def test_watching_a_campaign_writes_an_index_and_every_report(run: Path, finished: Path) -> None:
    folder = run.parent
    (folder / "damaged").mkdir()
    (folder / "damaged" / CHECKPOINT).write_bytes(b"nonsense")
    result = invoke("watch", folder)
    index = (folder / REPORT).read_text()
    assert 'href="run/report.html"' in index
    assert 'href="finished/report.html"' in index
    assert "not a checkpoint file" in index
    assert "3 runs begun, 3 of them ended" in index
    assert status_of(run / REPORT) == STOPPED
    assert (finished / REPORT).is_file()
    assert "damaged: " in result.stdout


@pytest.mark.usefixtures("no_drawing")
def test_watching_a_campaign_goes_on_while_the_campaign_does(
    run: Path, finished: Path, sleeps: list[Callable[[], object]]
) -> None:
    folder = run.parent
    hold = locked(folder)
    hold.__enter__()
    sleeps += [lambda: None, lambda: hold.__exit__(None, None, None)]
    invoke("watch", folder, "--interval", 0.5)
    assert not sleeps
    assert 'http-equiv="refresh"' not in (folder / REPORT).read_text()


def _empty(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _damaged(folder: Path) -> Path:
    _empty(folder)
    (folder / CHECKPOINT).write_bytes(b"PK\x03\x04 not really")
    return folder


def _without_design(folder: Path) -> Path:
    _empty(folder)
    (folder / ".lock").touch()
    return folder


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path, "there is no run folder"),
        (_empty, "holds no run"),
        (_without_design, "holds no run"),
        (_damaged, "is not a checkpoint file of ngspring, or it is truncated"),
        (lambda path: path.with_name("C77"), "there is no run folder"),
        (lambda path: "C77", "there is no stored design 'C77'"),
        (lambda path: path.with_suffix(".npz"), "there is no file"),
    ],
)
def test_what_cannot_be_watched_is_one_line_and_exit_code_2(
    tmp_path: Path, make: Callable[[Path], Path], message: str
) -> None:
    result = invoke("watch", make(tmp_path / "run"), code=2)
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert result.stdout == ""
    assert not list(tmp_path.rglob("*.html"))


def test_a_run_without_a_design_yet_cannot_be_reported_once(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with locked(folder), pytest.raises(RunFolderError, match="has no design yet"):
        read_run(folder)
    with locked(folder):
        assert "has no design yet" in invoke("watch", folder, "--once", code=2).stderr


@pytest.mark.usefixtures("no_drawing")
def test_a_report_that_cannot_be_written_is_one_line(run: Path, tmp_path: Path) -> None:
    result = invoke("watch", run, "--out", tmp_path / "nowhere" / "x.html", code=2)
    assert "cannot write" in result.stderr
    assert len(result.stderr.splitlines()) == 1


# -- while a run goes on ---------------------------------------------------------------------------


def _update(design: Design, accepted: bool = True) -> Update:
    assert design.history is not None
    return Update(accepted, design.history.last(), 1.0, "", design)


@pytest.mark.usefixtures("no_drawing")
def test_the_report_is_not_written_more_often_than_it_may(tmp_path: Path) -> None:
    path = tmp_path / REPORT
    writer = ReportWriter(path, interval=1000.0)
    writer(_update(gallery["C7"], accepted=False))
    assert not path.exists()
    writer(_update(gallery["C7"]))
    assert status_of(path) == RUNNING
    path.unlink()
    writer(_update(gallery["C7"]))
    assert not path.exists()


@pytest.mark.usefixtures("no_drawing")
def test_writing_takes_a_small_share_of_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, 2.0, 99.0, 103.0, 104.0])
    monkeypatch.setattr("ngspring.view.report.time.monotonic", lambda: next(clock))
    path = tmp_path / REPORT
    writer = ReportWriter(path, interval=1.0)
    writer(_update(gallery["C7"]))
    path.unlink()
    # It took two seconds: nothing for a hundred seconds.
    writer(_update(gallery["C7"]))
    assert not path.exists()
    writer(_update(gallery["C7"]))
    assert path.exists()


@pytest.mark.usefixtures("no_drawing")
def test_a_report_that_cannot_be_written_does_not_end_the_run(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    writer = ReportWriter(tmp_path / "nowhere" / REPORT)
    writer(_update(gallery["C7"]))
    assert "cannot write" in caplog.text


@pytest.mark.long
def test_optimize_keeps_the_report_up_to_date(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.toml").write_text(PROBLEM.to_toml())
    folder = tmp_path / "run"
    seen: list[str] = []
    calls: list[int] = []

    def look(self: ReportWriter, update: Update) -> None:
        original(self, update)
        calls.append(int(update.row.update))
        seen.append(status_of(folder / REPORT))

    original = ReportWriter.__call__
    monkeypatch.setattr(ReportWriter, "__call__", look)
    arguments = ("optimize", tmp_path / "mine.toml", "--out", folder, "--threads", 1)
    invoke(*arguments, "--max-updates", 2, "--report")
    assert calls == [0, 1, 2]
    # Only the first one: it is too soon for the others.
    assert seen == [RUNNING] * 3
    report = (folder / REPORT).read_text()
    assert "stopped after 2 design updates, as asked" in report
    assert 'http-equiv="refresh"' not in report
    assert 'id="states"' in report


@pytest.mark.usefixtures("no_drawing")
def test_ctrl_c_leaves_a_report_of_the_stopped_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.toml").write_text(PROBLEM.to_toml())

    def interrupt(self: ReportWriter, update: Update) -> None:
        original(self, update)
        if update.row.update == 2:
            raise KeyboardInterrupt

    original = ReportWriter.__call__
    monkeypatch.setattr(ReportWriter, "__call__", interrupt)
    folder = tmp_path / "run"
    arguments = ("optimize", tmp_path / "mine.toml", "--out", folder, "--threads", 1, "--report")
    result = invoke(*arguments, code=130)
    assert "--report --resume" in " ".join(result.stderr.split())
    report = (folder / REPORT).read_text()
    assert "interrupted before its end" in report
    assert 'http-equiv="refresh"' not in report
