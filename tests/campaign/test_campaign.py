"""Campaigns: what a file stands for, and runs that fail, wait, are killed, stopped and resumed."""

from __future__ import annotations

import csv
import errno
import json
import multiprocessing
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from support.campaigns import TINY, Watch

import ngspring
from ngspring import Design, NgspringError, ProblemError, RunFolderError, cases
from ngspring.campaign.outcome import Outcome
from ngspring.campaign.plan import Campaign, Run, parse_campaign, read_campaign
from ngspring.campaign.results import record, results_csv
from ngspring.campaign.run import Event, run_campaign
from ngspring.campaign.workers import execute
from ngspring.cli.main import cli
from ngspring.evolution.folder import CHECKPOINT, locked
from ngspring.problem.point import ControlPoint

ROOT = Path(ngspring.__file__).parents[1]
GALLERY = Path(__file__).parents[2] / "examples" / "paper" / "gallery.toml"


def names(text: str) -> list[str]:
    return [run.name for run in parse_campaign(text).runs]


def one(text: str) -> Run:
    (run,) = parse_campaign(f"[[run]]\n{text}").runs
    return run


# -- what a file stands for ------------------------------------------------------------------------


# Why is said in examples/paper/README.md.
STARTS = {
    "C1": "run C2",
    "C5": "run C4",
    "C6": "run C5",
    "C7-random": "random, seed 0",
    "T5": "run T4",
    "T6": "run T5",
    "CT1": "run CT2",
    "T1": "design starts/T1-ellipse.npz",
    "T2": "run T2-coarse",
    "T1-not-robust": "run T1-nr-coarse",
    "T2-not-robust": "run T2-nr-coarse",
    "CT5": "run CT2",
    "CT6": "run CT5",
    "A2": "run A1",
    "A3": "run A4",
    "C4-random": "random, seed 0",
}


def test_the_gallery_has_26_runs_c4_from_a_random_start_and_three_that_are_only_starts() -> None:
    runs = {run.name: run for run in read_campaign(GALLERY).runs}
    coarse = {name for name in runs if name.endswith("-coarse")}
    assert coarse == {"T2-coarse", "T1-nr-coarse", "T2-nr-coarse"}
    assert [name for name in runs if name not in coarse] == [
        *(f"C{i}" for i in range(1, 8)),
        "C7-random",
        *(f"T{i}" for i in range(1, 7)),
        *("T1-not-robust", "T2-not-robust"),
        *(f"CT{i}" for i in range(1, 7)),
        *(f"A{i}" for i in range(1, 5)),
        "C4-random",
    ]
    assert len(runs) - len(coarse) == 27
    for name, run in runs.items():
        problem = cases[name.split("-")[0]]
        if "not-robust" in name or "nr-coarse" in name:
            problem = problem.replace(control_points=problem.control_points[:2])
        if name in coarse:
            problem = problem.replace(elements=80)
        fine = name.split("-")[0] in ("T1", "T2") and name not in coarse
        assert run.problem == problem
        assert run.problem.elements == (160 if fine else 80)
        assert run.start_name == STARTS.get(name, "column")


def test_every_key(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(TINY.replace(name="").to_toml())
    file = tmp_path / "campaign.toml"
    file.write_text(
        '[[run]]\nfile = "own.toml"\n'
        '[[run]]\ncase = "c4"\nname = "b"\nstart = "run:own"\ndt_initial = 2\nmax_updates = 5\n'
        "elements = 20\nchanges = {p = 6.0}\n"
        '[[run]]\ncase = "T1"\nname = "c"\nstart = "random"\nseed = 7\nrobust = false\n'
        '[[run]]\ncase = "C1"\nstart = "design:C6"\noffsets = {imperfection = 0.2}\n'
        '[[run]]\ncase = "C2"\nstart = "design:old/design.npz"\n'
    )
    own, b, c, stored, path = read_campaign(file).runs
    assert own == Run("own", TINY.replace(name="own"))
    # The coarse mesh widens the interface, as on the command line.
    problem = cases["C4"].replace(elements=20, l_i=4.0, p=6.0)
    assert b == Run("b", problem, "run:own", dt_initial=2, max_updates=5)
    assert (b.after, b.design, b.start_name) == ("own", None, "run own")
    assert (c.seed, c.start_name, len(c.problem.control_points)) == (7, "random, seed 7", 2)
    assert stored.design == "C6"
    assert stored.problem == cases["C1"].with_offsets(imperfection=0.2)
    assert stored.problem.control_points[-1].eta_odd == pytest.approx(1.6)
    assert path.design == str(tmp_path / "old" / "design.npz")
    # A campaign that is moved with its designs goes on.
    assert path.start_name == "design old/design.npz"


def test_changes_with_lists_give_every_combination() -> None:
    text = 'case = "C4"\nchanges = {k_rho = [1e-8, 2e-8], T = 2.0, domain = ["quarter", "full"]}'
    runs = parse_campaign(f"[[run]]\n{text}").runs
    assert [run.name for run in runs] == [
        f"C4-k_rho={k_rho}-domain={domain}"
        for k_rho in ("1e-08", "2e-08")
        for domain in ("quarter", "full")
    ]
    expected = cases["C4"].replace(k_rho=2e-8, T=2.0, domain="quarter")
    assert runs[2].problem == expected
    # One value in a list is a variation, too; one without a list is not.
    assert names('[[run]]\ncase = "C4"\nchanges = {p = [6]}') == ["C4-p=6"]
    assert names('[[run]]\ncase = "C4"\nchanges = {p = 6}') == ["C4"]


FLOATS = st.lists(st.floats(1e-9, 1e3), min_size=1, max_size=4, unique=True)


@settings(max_examples=50)
@given(st.dictionaries(st.sampled_from(["K", "G", "k_rho", "l_i", "p"]), FLOATS, max_size=3))
def test_expansion_keeps_every_value(changes: dict[str, list[float]]) -> None:
    table = ", ".join(f"{key} = {values!r}" for key, values in changes.items())
    runs = parse_campaign(f'[[run]]\ncase = "C3"\nchanges = {{{table}}}').runs
    count = 1
    for key, values in changes.items():
        count *= len(values)
        assert {getattr(run.problem, key) for run in runs} == set(values)
    assert len(runs) == len({run.name for run in runs}) == count


@pytest.mark.long
@settings(max_examples=200)
@given(st.text(max_size=60))
def test_any_text_is_a_campaign_or_one_line(text: str) -> None:
    for content in (text, f"[[run]]\n{text}", f'[[run]]\ncase = "C4"\nname = {json.dumps(text)}'):
        try:
            parse_campaign(content)
        except ProblemError as error:
            assert len(str(error).splitlines()) == 1  # noqa: PT017


C4 = '[[run]]\ncase = "C4"\n'
BAD = {
    "": "at least one",
    "run = 3": "[[run]] tables",
    "run = [3]": "run[0] = 3",
    "x = = 3": "not valid TOML",
    'name = "a"\n[[control_points]]\nd = 1\nq = 2': (
        "this is a problem, not a campaign: ngspring optimize bad.toml"
    ),
    'name = "a"\ntargets = "curve.csv"': "ngspring optimize bad.toml",
    'name = "a"': "did you mean 'run'?",
    "runs = []": "did you mean 'run'?",
    f"{C4}elemnts = 8": "did you mean 'elements'?",
    "[[run]]": "either case",
    f'{C4}file = "a.toml"': "either case",
    '[[run]]\ncase = "C44"': "did you mean 'C4'?",
    "[[run]]\ncase = 4": "not the name of a case",
    '[[run]]\nfile = "nothere.toml"': "No such file",
    "[[run]]\nfile = 3": "file = 3",
    f"{C4}{C4}": "two runs would share a folder",
    f'{C4}[[run]]\ncase = "C3"\nname = "c4"': "'C4' and 'c4'",
    f'{C4}name = "a/b"': "the name 'a/b' is not valid",
    f'{C4}name = ".."': "the name '..' is not valid",
    f'{C4}name = "{"x" * 201}"': "longer than 200",
    f'{C4}name = "results.csv"': "that of a file",
    f'{C4}name = "Report.html"': "that of a file",
    f"{C4}name = 3": "the name 3",
    f"{C4}elements = 7": "even integer",
    f'{C4}elements = "8"': "even integer",
    f'{C4}start = "colum"': "start = 'colum'",
    f'{C4}start = "run:"': "start = 'run:'",
    f"{C4}start = 3": "start = 3",
    f"{C4}seed = 3": 'start = "random"',
    f'{C4}start = "random"\nseed = -1': "seed = -1",
    f'{C4}start = "random"\nseed = true': "seed = True",
    f"{C4}dt_initial = 0": "dt_initial = 0",
    f"{C4}dt_initial = nan": "dt_initial = nan",
    f"{C4}max_updates = 1.5": "max_updates = 1.5",
    f'{C4}robust = "no"': "true or false",
    f"{C4}offsets = 3": "offsets = 3",
    f"{C4}offsets = {{robust = 0}}": "robust = 0",
    f"{C4}offsets = {{robus = 0.2}}": "did you mean 'robust'?",
    f'{C4}offsets = {{imperfection_odd_in = "x"}}': "without imperfection",
    f"{C4}changes = 3": "changes = 3",
    f"{C4}changes = {{k_roh = 1e-8}}": "did you mean 'k_rho'?",
    f"{C4}gap = 1.5": "changes = {gap = ...}",
    f"{C4}offsets = {{gap = 1.5}}": "changes = {gap = ...}",
    f"{C4}changes = {{imperfection = 0.2}}": "offsets = {imperfection = ...}",
    f"{C4}imperfection = 0.2": "offsets = {imperfection = ...}",
    f"{C4}changes = {{part = true}}": "belongs to the run itself",
    f"{C4}changes = {{k_rho = []}}": "at least one value",
    f"{C4}changes = {{k_rho = [1e-8, 1e-8]}}": "two runs would share",
    f"{C4}changes = {{k_rho = [[1e-8]]}}": "k_rho = [1e-08] is not valid",
    f"{C4}changes = {{K = [1, 0]}}": "K = 0.0 is not valid",
    f"{C4}changes = {{control_points = []}}": "in a file",
    f"{C4}elements = 8\nchanges = {{elements = 8}}": "given twice",
    f"{C4}changes = {{K = {list(range(1, 102))}, G = {list(range(1, 102))}}}": "more than 10000",
    f'{C4}start = "run:C5"': "not a run of this campaign: did you mean 'C4'?",
    f'{C4}start = "run:C4"': "in a circle: C4 -> C4",
    f'{C4}start = "run:C5"\n[[run]]\ncase = "C5"\nstart = "run:C4"': "in a circle",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_files(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text(text)
    result = CliRunner().invoke(cli, ["campaign", "bad.toml"])
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("ngspring: error: 'bad.toml': ")
    assert BAD[text] in result.stderr
    assert result.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_bytes(b"\xff\xfe")
    for file in ("bad.toml", "nothere.toml", "."):
        with pytest.raises(ProblemError, match="cannot be read") as caught:
            read_campaign(tmp_path / file)
        assert len(str(caught.value).splitlines()) == 1


def test_a_byte_order_mark_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbf" + C4.encode())
    assert len(read_campaign(tmp_path / "a.toml").runs) == 1


def test_bad_arguments(tmp_path: Path) -> None:
    campaign = Campaign((Run("a", TINY),))
    bad: list[dict[str, Any]]
    bad = [{"workers": 0}, {"workers": True}, {"threads": 1.5}, {"threads": -1}]
    for options in bad:
        with pytest.raises(ProblemError, match="at least 1"):
            run_campaign(campaign, tmp_path / "out", **options)
    with pytest.raises(ProblemError, match="scheduler has its own"):
        run_campaign(campaign, tmp_path / "out", workers=1, scheduler="tcp://localhost:1")
    assert not (tmp_path / "out").exists()
    missing = Campaign((Run("a", TINY), Run("b", TINY, "design:nothere.npz")))
    with pytest.raises(NgspringError, match=r"run 'b': there is no file nothere\.npz"):
        run_campaign(missing, tmp_path / "out")
    with locked(tmp_path / "out"), pytest.raises(RunFolderError, match="another run"):
        run_campaign(campaign, tmp_path / "out")


# -- a campaign for real ---------------------------------------------------------------------------


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() for p in folder.rglob("*.*") if p.name != ".lock"}


@pytest.mark.long
def test_a_campaign_with_failing_killed_and_continued_runs(tmp_path: Path) -> None:
    campaign = Campaign(
        (
            Run("last", TINY.replace(p=7.0), "run:first"),
            Run("in the way", TINY),
            Run("orphan", TINY, "run:in the way"),
            Run("first", TINY, max_updates=300),
            Run("short", TINY, "random", max_updates=1),
        )
    )
    (tmp_path / "in the way").touch()
    killed: list[str] = []

    def kill(event: Event) -> None:
        update = event.update
        if update and event.run.name == "first" and update.row.update >= 4 and not killed:
            workers = multiprocessing.active_children()
            (worker,) = (p for p in workers if p.name == "ngspring first")
            worker.kill()
            killed.append(worker.name)

    watch = Watch(kill)
    outcomes = run_campaign(campaign, tmp_path, workers=2, observers=[watch])
    last, way, orphan, first, short = outcomes

    # The killed one went on from its checkpoint to the end.
    assert killed
    assert watch.events.count(("first", "restarted")) == 1
    assert watch.events.count(("first", "started")) == 2
    assert first.status == "converged"
    assert first.q[0] == pytest.approx(-2.0, rel=1e-3)
    assert first.worst_deviation == pytest.approx(first.q[0] / -2.0 - 1)
    design = Design.load(tmp_path / "first" / "design.npz")
    assert design.history is not None
    assert first.updates == len(design.history) - 1
    assert list(design.history["update"]) == list(range(len(design.history)))

    # The last began from its design, after it.
    assert watch.first("first", "ended") < watch.first("last", "started")
    assert (last.status, last.start) == ("converged", "run first")
    begun = Design.load(tmp_path / "last" / "design.npz").history
    assert begun is not None
    assert begun["width"][0] == pytest.approx(first.width)

    # The others failed without stopping these.
    assert way.status == "failed"
    assert "cannot make the folder" in way.message
    assert (orphan.status, orphan.message) == (
        "skipped",
        "run in the way left no design to continue from",
    )
    assert ("orphan", "started") not in watch.events
    assert (short.status, short.updates) == ("not converged", 1)
    assert "stopped after 1 design updates" in short.message

    rows = json.loads((tmp_path / "results.json").read_text())
    assert [row["name"] for row in rows] == [run.name for run in campaign.runs]
    assert rows == [record(outcome) for outcome in outcomes]
    assert rows[3]["minutes"] == pytest.approx(first.seconds / 60 if first.seconds else None)
    with (tmp_path / "results.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [float(table[3][key]) for key in ("q", "target")] == [first.q[0], -2.0]
    assert [row["converged"] for row in table] == ["True", "False", "False", "True", "False"]

    # What is finished is not repeated, even without its checkpoint, nor written to.
    finished = Campaign((campaign.runs[0], campaign.runs[3]))
    (tmp_path / "first" / CHECKPOINT).unlink()
    before = {name: contents(tmp_path / name) for name in ("first", "last")}
    watch = Watch()
    assert run_campaign(finished, tmp_path, observers=[watch]) == [last, first]
    assert watch.events == [("last", "ended"), ("first", "ended")]
    assert before == {name: contents(tmp_path / name) for name in before}


# Ctrl-C goes to the whole group, as from a terminal; `kill` to the campaign's process alone.
@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
@pytest.mark.parametrize("interrupt", ["ctrl-c", "kill"])
def test_an_interrupt_stops_every_worker_and_says_how_to_resume(
    tmp_path: Path, interrupt: str
) -> None:
    # So fine that no run can end before it hears of the interrupt.
    (tmp_path / "own.toml").write_text(TINY.replace(elements=24, l_i=4.0).to_toml())
    (tmp_path / "a b.toml").write_text('[[run]]\nfile = "own.toml"\nchanges = {p = [7.0, 8.0]}\n')
    command = ["campaign", "a b.toml", "--workers", "2"]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    with subprocess.Popen(
        [sys.executable, "-m", "ngspring", *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        start_new_session=True,
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if ": update    2 " in line:
                if interrupt == "ctrl-c":
                    os.killpg(process.pid, signal.SIGINT)
                else:
                    process.terminate()
                break
        _, err = process.communicate(timeout=120)
    assert process.returncode == 130, err
    assert err.count("\n") == 1
    assert "interrupted with 0 of 2 runs ended" in err
    again = shlex.split(err.strip().split("resume with: ")[1])
    assert again == ["ngspring", *command[:2], "--out", "runs/a b", *command[2:]]
    out = tmp_path / "runs" / "a b"
    begun = [folder.parent for folder in out.glob("*/design.npz")]
    assert begun
    for folder in begun:
        # Nobody holds the folder any more.
        with locked(folder):
            assert Design.load(folder / "design.npz").info["converged"] is False
    assert not (out / "results.csv").exists()


@pytest.mark.long
def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.toml").write_text(TINY.to_toml())
    Path("a.toml").write_text('[[run]]\nfile = "own.toml"\nmax_updates = 1\n')
    result = CliRunner().invoke(cli, ["campaign", "a.toml", "--workers", "1"])
    assert result.exit_code == 3, result.output
    assert "own: started\nown: update    0" in result.stdout
    assert "own: not converged: stopped after 1 design updates, as asked" in result.stdout
    assert "│ own " in result.stdout
    assert "results.csv, results.json" in result.stdout
    assert result.stderr == "not converged: 1 of 1 runs\n"
    assert Path("runs/a/results.csv").exists()
    # Another start of the same name does not go on from this one's checkpoint.
    Path("a.toml").write_text('[[run]]\nfile = "own.toml"\nstart = "random"\n')
    result = CliRunner().invoke(cli, ["campaign", "a.toml", "--workers", "1"])
    assert result.exit_code == 3, result.output
    assert "holds an unfinished run from column, not from random, seed 0" in result.stdout


@pytest.mark.long
def test_a_converged_run_that_hangs_on_grey_is_no_success(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("soft.toml").write_text(TINY.replace(control_points=(ControlPoint(10.0, 0.5),)).to_toml())
    Path("a.toml").write_text('[[run]]\nfile = "soft.toml"\n')
    result = CliRunner().invoke(cli, ["campaign", "a.toml", "--workers", "1"])
    assert result.exit_code == 4, result.output
    assert result.stderr == "no part: 1 of 1 runs, see the table\n"
    assert "through" in result.stdout
    (row,) = csv.DictReader(Path("runs/a/results.csv").read_text().splitlines())
    assert row["status"] == "converged"
    assert "through grey" in row["flaw"]


# -- failures in one process -----------------------------------------------------------------------


def fail_with(error: BaseException) -> Callable[..., None]:
    def fail(*args: object, **kwargs: object) -> None:
        raise error

    return fail


@pytest.mark.long
def test_a_full_disk_is_the_message_and_the_run_goes_on_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run("a", TINY, max_updates=2)
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fail_with(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
        outcome = execute(run, tmp_path, 1, lambda update: None)
    assert outcome.status == "failed"
    assert os.strerror(errno.ENOSPC) in outcome.message
    assert outcome.message.count("\n") == 0
    assert execute(run, tmp_path, 1, lambda update: None).updates == 2


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (KeyboardInterrupt(), "interrupted", ""),
        (MemoryError(), "failed", "not enough memory"),
        (ngspring.ConvergenceError("the path\nends"), "failed", "the path ends"),
        (ZeroDivisionError("by zero"), "failed", "ZeroDivisionError: by zero"),
    ],
)
def test_any_error_is_an_outcome(
    error: BaseException,
    status: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ngspring.campaign.workers.optimize", fail_with(error))
    run = Run("a", TINY)
    expected = Outcome(run, status, message)
    assert execute(run, tmp_path, 1, lambda update: None) == expected


def test_a_worker_that_dies_again_and_again_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ngspring.campaign import run as campaign_run
    from ngspring.campaign.workers import Death, News

    class Deadly:
        full = False

        def __init__(self, *args: object) -> None:
            self.runs: list[Run] = []

        def start(self, run: Run) -> None:
            self.runs.append(run)

        def news(self) -> list[News]:
            return [Death(self.runs.pop(), "killed by SIGKILL")]

        def stop(self) -> None:
            assert not self.runs

    watch = Watch()
    monkeypatch.setattr(campaign_run, "LocalWorkers", Deadly)
    (outcome,) = run_campaign(Campaign((Run("a", TINY),)), tmp_path, observers=[watch])
    assert watch.events.count(("a", "started")) == 3
    assert watch.events.count(("a", "restarted")) == 2
    assert outcome.status == "failed"
    assert "died 3 times without a design update: killed by SIGKILL" in outcome.message


def test_why_a_part_misses_is_said_once() -> None:
    part, missed = ngspring.parts["C4"], "after 9 corrections the best solid carries 1 N"
    info = {**part.info, "start": "column", "missed": missed}
    part = Design(part.problem, part.coefficients, part.history, info)
    outcome = Outcome.of_design(Run("a", TINY, part=True), part, "converged", missed)
    assert (outcome.message, outcome.flaw) == ("", missed)


def test_points_with_eta_are_not_judged() -> None:
    points = (ControlPoint(10, 2), ControlPoint(20, 4, eta=2.0))
    run = Run("a", TINY.replace(control_points=points))
    outcome = Outcome(run, "converged", q=(2.002, 8.0))
    assert outcome.worst_deviation == pytest.approx(1e-3)
    assert Outcome(run, "failed").worst_deviation is None
    (row,) = csv.DictReader(results_csv([outcome]).splitlines())
    assert (row["q"], row["eta"], row["updates"]) == ("2.002 8.0", "0.0 2.0", "")
