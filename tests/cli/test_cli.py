"""The command line: every command once for real, every kind of bad input, exit codes."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import meshio
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from support.commands import environment, invoke

import ngspring
from ngspring.analysis.path import Jump
from ngspring.basics.errors import ConvergenceError
from ngspring.cli.arguments import read_problem
from ngspring.cli.main import cli
from ngspring.cli.progress import LiveTable
from ngspring.cli.response import response_lines
from ngspring.cli.tables import make_console
from ngspring.design.corrections import Correction
from ngspring.design.design import Design
from ngspring.design.history import Row
from ngspring.evolution.runstate import read_run
from ngspring.evolution.updates import Update
from ngspring.problem.cases import cases
from ngspring.problem.point import ControlPoint
from ngspring.problem.scaling import on_mesh
from ngspring.problem.spring import SpringProblem
from ngspring.view.figure import new_figure
from ngspring.view.text import deviation_percent, duration

PICTURES = ("convergence.png", "design.png")
FILES = {
    "design.npz",
    "history.csv",
    "checkpoint.npz",
    "checkpoint-before.npz",
    "snapshots.npz",
    "design.vtu",
    "response.csv",
    "report.html",
    "states.npz",
    *PICTURES,
}

TOML = """
elements = 12
l_i = 7.0

[[control_points]]
d = -10.0
q = -2.0
"""


def start(*args: object, cwd: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "ngspring", *map(str, args)]
    pipe = subprocess.PIPE
    return subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, cwd=cwd, env=environment(), encoding="utf-8"
    )


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A whole run with 12 elements and one control point, as a user starts it."""
    home = tmp_path_factory.mktemp("home")
    (home / "mine.toml").write_text(TOML)
    with start("optimize", "mine.toml", "--threads", 1, cwd=home) as process:
        out, err = process.communicate()
    folder = home / "runs" / "mine"
    return SimpleNamespace(home=home, out=out, err=err, code=process.returncode, folder=folder)


@pytest.fixture
def copy(finished: SimpleNamespace, tmp_path: Path) -> Path:
    """A copy of the finished run's folder."""
    return Path(shutil.copytree(finished.folder, tmp_path / "copy"))


@pytest.fixture
def empty_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run's pictures show nothing, for what is not about them: real ones take a second each."""

    def empty(*_: object) -> Figure:
        return new_figure(1.0, 1.0)

    for name in ("convergence_figure", "design_figure"):
        monkeypatch.setattr(f"ngspring.view.run_files.{name}", empty)


@pytest.fixture
def plain_pictures(empty_figures: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The report has no pictures, either, nor anything else."""
    monkeypatch.setattr(
        "ngspring.view.run_files.write_report", lambda _, path: path.write_text("a report")
    )


# -- a whole run -----------------------------------------------------------------------------------


def test_run_converges_and_writes_everything(finished: SimpleNamespace) -> None:
    assert finished.code == 0, finished.err
    assert finished.err.startswith("ngspring: warning: no target in tension")
    assert len(finished.err.splitlines()) == 1
    assert {path.name for path in finished.folder.iterdir()} - {".lock"} == FILES
    design = Design.load(finished.folder / "design.npz")
    assert design.problem.name == "mine"
    assert design.info["converged"] is True
    assert design.info["q"][0] == pytest.approx(-2.0, rel=1e-3)
    for name in PICTURES:
        picture = imread(finished.folder / name)
        assert min(picture.shape[:2]) > 400
        assert np.ptp(picture) == 1.0
    assert "displacement_-10mm" in meshio.read(finished.folder / "design.vtu").point_data


def test_piped_output_is_plain_lines(finished: SimpleNamespace) -> None:
    assert "\x1b" not in finished.out
    lines = finished.out.splitlines()
    updates = [line for line in lines if line.startswith("update")]
    history = (finished.folder / "history.csv").read_text().splitlines()
    assert len(updates) == len(history) - 1
    row = r"update +\d+ dt \S+  newton \d+  C \S+  W/H 0\.\d+  q/target -\d\.\d+/-2  \d+\.\d s"
    assert all(re.fullmatch(row, line) for line in updates)
    column = history[0].split(",").index("rejected")
    rejected = sum(int(line.split(",")[column]) for line in history[1:])
    assert len([line for line in lines if line.startswith("rejected ")]) == rejected


def test_summary_of_a_run(finished: SimpleNamespace) -> None:
    tail = finished.out[finished.out.rindex("update ") :]
    assert re.search(r"-2\.0\d+ |-1\.9\d+ ", tail)
    assert re.search(r"[+-]?0\.0\d\d %", tail)
    for part in ("W/H = 0.", "design updates", "Newton iterations", "converged to dt = ∞"):
        assert part in tail
    assert "files in runs/mine: design.npz, history.csv" in tail


def test_a_finished_run_is_not_overwritten(finished: SimpleNamespace) -> None:
    before = (finished.folder / "design.npz").read_bytes()
    file = finished.home / "mine.toml"
    result = invoke("optimize", file, "--out", finished.folder, code=2)
    assert "holds a run already" in result.stderr
    assert "--resume" in result.stderr
    assert (finished.folder / "design.npz").read_bytes() == before


@pytest.mark.long
@pytest.mark.usefixtures("empty_figures")
def test_a_design_that_hangs_on_grey_is_no_success(tmp_path: Path) -> None:
    """A target far softer than any strut of the mesh: converged, on grey material."""
    file = tmp_path / "soft.toml"
    file.write_text("elements = 8\nl_i = 10.0\n[[control_points]]\nd = 10.0\nq = 0.5\n")
    options = ("--threads", 1, "--out", tmp_path / "run")
    result = invoke("optimize", file, *options, code=4)
    assert "softer than the thinnest straight strut" in result.stderr  # before the run
    assert "converged, but it carries its load through grey" in result.stderr
    again = invoke("optimize", file, *options, "--resume", code=4)
    assert again.stderr == result.stderr.splitlines()[-1] + "\n"
    saved = Design.load(tmp_path / "run" / "design.npz")
    assert saved.info["converged"] is True
    assert 0.25 < saved.info["grey"][0] < 1
    assert "through grey" in (tmp_path / "run" / "report.html").read_text()
    checked = invoke("check", tmp_path / "run", "--threads", 1, code=4).stdout
    assert "through grey" in " ".join(checked.replace("│", " ").split())
    assert "through grey" in invoke("show", tmp_path / "run", "--threads", 1).stderr


@pytest.mark.long
def test_resume_of_a_finished_run_draws_the_pictures_again(
    finished: SimpleNamespace, copy: Path
) -> None:
    for name in (*PICTURES, "design.vtu"):
        (copy / name).unlink()
    file = finished.home / "mine.toml"
    result = invoke("optimize", file, "--out", copy, "--resume", "--threads", 1)
    assert {path.name for path in copy.iterdir()} - {".lock"} == FILES
    assert "update " not in result.stdout
    first, second = Design.load(copy / "design.npz"), Design.load(finished.folder / "design.npz")
    assert np.array_equal(first.coefficients, second.coefficients)


@pytest.mark.usefixtures("plain_pictures")
def test_resume_of_a_finished_run_computes_no_load_path_again(
    finished: SimpleNamespace, copy: Path
) -> None:
    kept = ("states.npz", "response.csv", "design.vtu")
    for name in kept:
        os.utime(copy / name, (0, 0))
    for name in PICTURES:
        (copy / name).unlink()
    invoke("optimize", finished.home / "mine.toml", "--out", copy, "--resume", "--threads", 1)
    assert {path.name for path in copy.iterdir()} - {".lock"} == FILES
    assert all((copy / name).stat().st_mtime == 0 for name in kept)


def test_resume_refuses_another_problem(copy: Path) -> None:
    result = invoke("optimize", "C5", "--elements", 12, "--out", copy, "--resume", code=2)
    assert "another problem" in result.stderr


@pytest.mark.usefixtures("plain_pictures")
def test_max_updates_is_success_and_says_so(finished: SimpleNamespace, tmp_path: Path) -> None:
    file, out = finished.home / "mine.toml", tmp_path / "a" / "b"
    options = ("--initial", "random", "--seed", 3, "--max-updates", 1, "--threads", 1)
    result = invoke("optimize", file, "--out", out, *options)
    assert "not converged: stopped after 1 design updates" in result.stderr
    assert {path.name for path in out.iterdir()} - {".lock"} == FILES
    assert Design.load(out / "design.npz").info["start"] == "random, seed 3"


@pytest.mark.long
def test_no_convergence_is_code_3_with_pictures(
    finished: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import ngspring.evolution.optimize as evolution

    original = evolution.optimize

    def give_up(*args: Any, **kwargs: Any) -> evolution.Result:
        rule = ngspring.StepRule(smallest=1e30)
        newton = evolution.NewtonSettings(chi_tolerance=1e-9, max_iterations=1)
        return original(*args, **kwargs, rule=rule, newton=newton)

    monkeypatch.setattr("ngspring.cli.optimize.optimize", give_up)
    out = tmp_path / "out"
    file = finished.home / "mine.toml"
    result = invoke("optimize", file, "--out", out, "--threads", 1, code=3)
    assert "not converged: dt fell below" in result.stderr
    assert re.search(r"^rejected    dt 1\.0e\+00  no convergence in 1", result.stdout, re.M)
    assert (out / "design.png").exists()


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals")
@pytest.mark.parametrize("interrupt", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.usefixtures("plain_pictures")
def test_an_interrupt_saves_and_says_how_to_resume(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interrupt: signal.Signals
) -> None:
    command = ("optimize", "c4", "--elements", 12, "--threads", 1)
    with start(*command, cwd=tmp_path) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("update    1"):
                process.send_signal(interrupt)
        _, err = process.communicate()
    assert process.returncode == 130
    assert len(err.strip().splitlines()) == 1
    assert "last accepted design is saved in runs/C4-12" in err
    again = shlex.split(err.strip().split("resume with: ")[1])
    expected = "optimize c4 --elements 12 --threads 1 --out runs/C4-12 --resume"
    assert again == ["ngspring", *expected.split()]
    saved = Design.load(tmp_path / "runs" / "C4-12" / "design.npz")
    assert saved.history is not None
    more = len(saved.history)
    monkeypatch.chdir(tmp_path)
    out = invoke(*again[1:], "--max-updates", more).stdout
    # A resumed run first says where it stands.
    assert re.findall(r"^update +(\d+)", out, re.M) == [str(more - 1), str(more)]


# -- the other commands ----------------------------------------------------------------------------


def test_cases() -> None:
    out = invoke("cases").stdout
    for name in cases:
        assert re.search(rf"│ {name} +│", out)
    assert len(re.findall("\\(robust", out)) == 2
    # Stored designs are marked, and those that are no case are named.
    assert re.search("│ C7 +│ plane strain +│ 80 x 80 +│ stored │", out)
    assert "C7-random" in out
    assert "+10:+2  -10:-2  -20:-5.5" in out
    assert "axisymmetric" in out


def test_version_help_and_nothing() -> None:
    assert invoke("--version").stdout == f"ngspring {ngspring.__version__}\n"
    assert "Exit codes" in invoke("--help").stdout
    assert invoke().stdout == invoke("--help").stdout


def test_help_and_cases_import_neither_ngsolve_nor_matplotlib() -> None:
    code = (
        "import sys\nfrom ngspring.cli.main import cli\n"
        "try: cli.main(sys.argv[1:])\n"
        "except SystemExit: pass\n"
        "sys.exit(any(name in sys.modules for name in ('ngsolve', 'matplotlib', 'meshio')))"
    )
    for argument in ("--help", "cases"):
        command = [sys.executable, "-c", code, argument]
        done = subprocess.run(command, env=environment(), capture_output=True, check=False)
        assert done.returncode == 0, done.stderr


def test_response(copy: Path) -> None:
    result = invoke("response", copy, "--points", 3, "--to", 5, "--threads", 1)
    lines = result.stdout.splitlines()
    assert lines[0].split() == ["d", "[mm]", "q", "[N]"]
    assert [float(line.split()[0]) for line in lines[1:]] == [-10.0, -2.5, 5.0]
    table = np.genfromtxt(copy / "response-custom.csv", delimiter=",", names=True)
    assert table.dtype.names == ("d", "q", "energy", "stiffness")
    assert table["q"][0] == pytest.approx(-2.0, rel=1e-3)
    assert float(lines[1].split()[1]) == pytest.approx(table["q"][0], rel=1e-8)
    assert imread(copy / "response-custom.png").ndim == 3
    assert "response-custom.csv, response-custom.png" in result.stderr


@pytest.mark.parametrize("options", [("--points", 3), ("--to", 5), ("--from", -5)])
def test_another_curve_leaves_that_of_the_report_alone(
    copy: Path, options: tuple[object, ...]
) -> None:
    before = (copy / "response.csv").read_bytes()
    invoke("response", copy, *options, "--threads", 1)
    assert (copy / "response.csv").read_bytes() == before
    assert not (copy / "response.png").exists()
    assert (copy / "response-custom.csv").exists()


def test_the_default_curve_has_the_name_the_report_reads(copy: Path) -> None:
    (copy / "response.csv").unlink()
    # Saying what is the default anyway does not make another curve.
    invoke("response", copy, "--from", -10, "--to", 0, "--points", 41, "--threads", 1)
    assert read_run(copy).curve is not None
    assert (copy / "response.png").exists()
    assert not list(copy.glob("*custom*"))


def test_a_spring_at_rest_carries_nothing(copy: Path) -> None:
    lines = invoke("response", copy, "--points", 3, "--to", 10, "--threads", 1).stdout.splitlines()
    assert lines[2].split() == ["0", "0"]


def test_what_rounding_leaves_of_nothing_is_printed_as_nothing() -> None:
    response: Any = SimpleNamespace(
        d=[-10.0, -0.0, 1e-3], q=[-2.0, 3.3e-16, 1e-6], jumps=(Jump(0.5, 1.25, 0.75),)
    )
    *rows, jump = [line.split() for line in response_lines(response)[1:]]
    assert rows == [["-10", "-2"], ["0", "0"], ["0.001", "1e-06"]]
    assert " ".join(jump) == "snap-through at d = 0.5 mm: q from 1.25 to 0.75 N"


def test_response_default_range_and_domain(copy: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "folder"
    options = ("--points", 2, "--domain", "full", "--out", out, "--threads", 1)
    result = invoke("response", copy / "design.npz", *options)
    assert [float(line.split()[0]) for line in result.stdout.splitlines()[1:]] == [-10.0, 0.0]
    assert {path.name for path in out.iterdir()} == {"response-custom.csv", "response-custom.png"}


@pytest.mark.long
def test_response_that_ends_early(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import ngspring.analysis.forward as forward

    original = forward.follow

    def stop_before(body: Any, targets: Any, *args: Any, **kwargs: Any) -> Any:
        points, _ = original(body, targets[:-1], *args, **kwargs)
        return points, "the path ends at d = -8 mm, before -10 mm: a reason"

    monkeypatch.setattr(forward, "follow", stop_before)
    (copy / "states.npz").unlink()
    options = ("--from", -10, "--to", -2, "--points", 3, "--threads", 1)
    result = invoke("response", copy, *options, code=3)
    displacements = [float(line.split()[0]) for line in result.stdout.splitlines()[1:]]
    assert displacements == [-6.0, -2.0]
    assert "the path ends at d = -8 mm" in result.stderr
    # One line about the files, one about the end.
    assert result.stderr.count("\n") == 2
    assert len((copy / "response-custom.csv").read_text().splitlines()) == 3
    assert (copy / "response-custom.png").exists()
    assert "not reached" in invoke("show", copy, "--threads", 1, code=3).stdout


def test_show(copy: Path, tmp_path: Path) -> None:
    (copy / "design.png").unlink()
    out = invoke("show", copy / "design.npz", "--threads", 1).stdout
    assert "mine: plane strain, 12 x 12 elements (quarter)" in out
    assert "start: column" in out
    assert "converged to dt = ∞" in out
    assert re.search(r"-10 .* -2 .* -(2\.0|1\.9)\d+ .* [+-]?0\.\d+ %", out)
    assert (copy / "design.png").exists()
    invoke("show", copy, "--out", tmp_path / "other.png", "--threads", 1)
    assert (tmp_path / "other.png").exists()


def test_check_passes_a_converged_design(copy: Path) -> None:
    out = invoke("check", copy, copy / "design.npz", "--threads", 1).stdout
    assert len(re.findall("│ passes +│", out)) == 2
    residuals = re.findall(r"│ (\d\.\de-\d\d) │", out.replace("  ", " "))
    assert len(residuals) == 2
    assert max(map(float, residuals)) < 1e-6


def test_check_says_how_far_forces_are_off_and_takes_another_limit(copy: Path) -> None:
    """The stored design of C7 misses by 0.0007 %."""
    arguments = "check", copy, "--threads", 1, "--force-tolerance"
    out = " ".join(invoke(*arguments, 1e-5, code=1).stdout.split())
    assert "forces" in out
    assert "limit" in out
    assert "passes" in invoke(*arguments, 0.01).stdout
    assert "--force-tolerance" in invoke(*arguments, -1.0, code=2).stderr


def test_check_fails_what_is_not_optimal(copy: Path, tmp_path: Path) -> None:
    Design.column(cases["C7"].replace(elements=8, l_i=10.0)).save(tmp_path / "column.npz")
    out = invoke("check", copy, tmp_path / "column.npz", "--threads", 1, code=1).stdout
    assert "fails: residual and forces" in out
    assert len(re.findall("│ passes +│", out)) == 1


def test_check_does_not_judge_robust_control_points(copy: Path, tmp_path: Path) -> None:
    design = Design.load(copy / "design.npz")
    dilated = ControlPoint(-10, -2, weight=1e-12, eta=2.0)
    problem = design.problem.replace(control_points=(*design.problem.control_points, dilated))
    Design(problem, design.coefficients).save(tmp_path / "robust.npz")
    out = invoke("check", tmp_path / "robust.npz", "--threads", 1).stdout
    assert "(η = 2)" in out
    assert "passes" in out


@pytest.mark.long
def test_check_gallery_by_name(copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from ngspring.design.gallery import gallery

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(gallery, "folder", copy)
    for other in ("checkpoint.npz", "checkpoint-before.npz", "snapshots.npz", "states.npz"):
        (copy / other).unlink()
    assert "passes" in invoke("check", "design", "--threads", 1).stdout
    assert "passes" in invoke("check", "--gallery", "--threads", 1).stdout
    invoke("show", "design", "--threads", 1)
    assert (tmp_path / "design.png").exists()
    result = invoke("check", "desing", code=2)
    assert "did you mean 'design'?" in result.stderr


def test_bench() -> None:
    options = ("--elements", 8, "--control-points", 1, "--threads", 1, "--repeat", 1)
    out = invoke("bench", *options, "--solver", "sparsecholesky").stdout
    for row in ("unknowns", "non-zeros", "assembly", "reduction", "factorisation", "solve"):
        assert row in out
    assert "peak memory" in out


@pytest.mark.long
def test_bench_of_a_run_says_where_the_time_went_and_keeps_nothing(tmp_path: Path) -> None:
    options = ("--run", "c7", "--elements", 8, "--max-updates", 1, "--threads", 1)
    out = invoke("bench", *options).stdout
    for row in ("equilibrium", "pictures", "the rest", "whole run", "rejected", "peak memory"):
        assert row in out
    assert "stopped after 1 design updates" in out
    assert not list(tmp_path.iterdir())


NAMES = ("$x^{$", "costs $5, $\\\\frac$ \\\\$", "漢字 😀", "x" * 200)


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_any_name_goes_through_a_whole_run(name: str, tmp_path: Path) -> None:
    """No mathematics is looked for, no picture is lost, and no warning of a font reaches stderr."""
    file, out = tmp_path / "mine.toml", tmp_path / "out"
    file.write_text(f'name = "{name}"\n{TOML}'.replace("elements = 12", "elements = 4"))
    options = ("--max-updates", 1, "--threads", 1, "--out", out, "--report", "--anyway")
    result = invoke("optimize", file, *options)
    assert {path.name for path in out.iterdir()} - {".lock"} == FILES
    assert "not written" not in result.stdout
    lines = result.stderr.splitlines()
    assert lines[-1].startswith("not converged: stopped after 1")
    assert all(line.startswith("ngspring: warning: ") for line in lines[:-1])
    invoke("watch", out, "--once")
    assert Design.load(out / "design.npz").problem.name == name.replace("\\\\", "\\")


@pytest.mark.long
@pytest.mark.parametrize("broken", ["convergence_figure", "design_figure", "write_report"])
def test_a_picture_that_fails_costs_nothing_else(
    broken: str, finished: SimpleNamespace, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("no\nfont")

    files = {"convergence_figure": "convergence.png", "design_figure": "design.png"}
    lost = files.get(broken, "report.html")
    for name in FILES:
        if Path(name).suffix != ".npz":
            (copy / name).unlink()
    monkeypatch.setattr(f"ngspring.view.run_files.{broken}", fail)
    file = finished.home / "mine.toml"
    result = invoke("optimize", file, "--out", copy, "--resume", "--threads", 1)
    assert {path.name for path in copy.iterdir()} - {".lock"} == FILES - {lost}
    assert f"not written: {lost}: no font\n" in result.stdout
    assert lost not in result.stdout.splitlines()[-1]


def test_warnings_of_libraries_are_for_the_log_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def warn(*_: object) -> None:
        warnings.warn("a warning of Python", stacklevel=1)
        logging.getLogger("matplotlib.font_manager").warning("a warning of matplotlib")

    monkeypatch.setattr("ngspring.cli.cases.make_console", warn)
    log = tmp_path / "log.txt"
    with contextlib.redirect_stderr(io.StringIO()) as err, pytest.raises(AttributeError):
        cli.main(["--log-file", str(log), "cases"])
    assert err.getvalue() == ""
    assert "a warning of Python" in log.read_text()
    assert "a warning of matplotlib" in log.read_text()


@pytest.mark.usefixtures("plain_pictures")
def test_verbose_and_log_file(finished: SimpleNamespace, tmp_path: Path) -> None:
    log = tmp_path / "log.txt"
    file, out = finished.home / "mine.toml", tmp_path / "out"
    options = ("--max-updates", 1, "--threads", 1, "--out", out)
    result = invoke("-v", "--log-file", log, "optimize", file, *options)
    assert "ngspring.evolution.evolve: update 1" in log.read_text()
    assert "ngspring.evolution.evolve: update 1" in result.stderr
    # What is written after every update is not worth a line each time.
    assert f"wrote {out / 'design.npz'}" in result.stderr
    assert "checkpoint.npz" not in result.stderr
    assert "snapshots.npz" not in result.stderr


def test_logging_options_may_stand_behind_the_command(
    finished: SimpleNamespace, tmp_path: Path
) -> None:
    log = tmp_path / "log.txt"
    options = ("--from", 0, "--to", 1, "--points", 2, "--threads", 1, "--out", tmp_path)
    result = invoke("-v", "response", finished.folder, *options, "-v", "--log-file", log)
    for text in (log.read_text(), result.stderr):
        # Once, although -v stands there twice.
        assert text.count("d = 1 mm: q = ") == 1
        assert f"wrote {tmp_path / 'response-custom.csv'}" in text
    assert not logging.getLogger("ngspring").handlers


@pytest.mark.usefixtures("plain_pictures")
def test_resume_says_that_a_run_only_begins(finished: SimpleNamespace, tmp_path: Path) -> None:
    options = ("--max-updates", 1, "--threads", 1, "--out", tmp_path / "new", "--resume")
    file = finished.home / "mine.toml"
    said = f"there is no run in {tmp_path / 'new'} yet: it begins"
    assert said in invoke("optimize", file, *options).stderr
    assert said not in invoke("optimize", file, *options).stderr


# -- arguments -------------------------------------------------------------------------------------


def test_coarser_mesh_widens_the_interface() -> None:
    problem, note = on_mesh(cases["C4"], 20)
    assert (problem.elements, problem.l_i) == (20, 4.0)
    assert "l_i = 4 mm instead of 1 mm" in note
    assert "dilation" not in note
    assert "dilation" in on_mesh(cases["T1"], 80)[1]


def test_finer_mesh_keeps_the_interface() -> None:
    problem, note = on_mesh(cases["C4"], 160)
    assert (problem.l_i, note) == (1.0, "")


def test_names_of_runs(tmp_path: Path) -> None:
    assert read_problem("ct3")[1] == "CT3"
    path = tmp_path / "spring 7.toml"
    path.write_text('name = "C4"\n' + TOML)
    problem, name = read_problem(str(path))
    assert (problem.name, name) == ("C4", "spring 7")


def test_live_table() -> None:
    problem = SpringProblem((ControlPoint(10, 2), ControlPoint(20, 0)), name="x")
    table, console = LiveTable(problem), make_console()

    def drawn() -> str:
        with console.capture() as capture:
            console.print(table)
        return capture.get()

    assert "starting" in drawn()
    row = Row(4, 2e6, 3, C=1e-4, q=(2.01, 0.1), width=0.25, seconds=3700.0)
    design = Design.column(problem)
    table(Update(True, row, 2e6, "", design))
    for part in ("2.0e+06", "0.2500", "q [N] at d = 10 mm", "2.0100", "+0.500 %", "1:01:40"):
        assert part in drawn()
    table(Update(False, row, 1e7, "bad", design))
    assert "dt 1.0e+07 rejected: bad" in drawn()
    solid = Correction(4, (2.0, 0.0), (2.04, 0.1))
    table(Update(True, row, 0.0, "", design, correction=solid))
    assert "+5.00 %" in drawn()


def test_formats() -> None:
    assert duration(59.9) == "0:59"
    assert deviation_percent(-2.002, -2.0) == deviation_percent(2.002, 2.0) == "+0.100 %"
    assert deviation_percent(0.5, 0.0) == "+5.00e-01 N"
    # What is rounded to 0 has no sign, on either side.
    assert deviation_percent(-2.0 + 1e-9, -2.0) == deviation_percent(-2.0 - 1e-9, -2.0) == "0.000 %"


# -- bad input -------------------------------------------------------------------------------------

POINT = "[[control_points]]\nd = 10.0\nq = 2.0\n"
BAD_TOML = {
    "malformed": ("elements = = 4", "not valid TOML"),
    "unknown key": (f"elemnts = 4\n{POINT}", "did you mean 'elements'?"),
    "unknown key in a point": (f"{POINT}wieght = 1", "did you mean 'weight'?"),
    "force in a point": ("[[control_points]]\nforce = 2.0", "did you mean 'q'?"),
    "F in a point": ("[[control_points]]\nF = 2.0", "did you mean 'q'?"),
    "load in a point": ("[[control_points]]\nload = 2.0", "did you mean 'q'?"),
    "u in a point": ("[[control_points]]\nu = 2.0", "did you mean 'd'?"),
    "displacement in a point": ("[[control_points]]\ndisplacement = 2", "did you mean 'd'?"),
    "missing key": ("[[control_points]]\nd = 10.0", "missing key 'q'"),
    "no control points": ("control_points = []", "control_points"),
    "no points at all": ("K = 1.0", "missing key 'control_points'"),
    "zero K": (f"K = 0\n{POINT}", "K = 0.0 is not valid"),
    "negative G": (f"G = -1.0\n{POINT}", "G = -1.0 is not valid"),
    "zero l_i": (f"l_i = 0.0\n{POINT}", "l_i = 0.0 is not valid"),
    "negative thickness": (f"T = -1\n{POINT}", "T = -1.0 is not valid"),
    "odd N": (f"elements = 21\n{POINT}", "even integer"),
    "N too small": (f"elements = 2\n{POINT}", "at least 4"),
    "d = 0": ("[[control_points]]\nd = 0\nq = 2", "d = 0.0 is not valid"),
    "d = H": ("[[control_points]]\nd = -100\nq = 2", "smaller in size than H"),
    "nan": (f"L = nan\n{POINT}", "finite"),
    "inf": ("[[control_points]]\nd = inf\nq = 2", "finite"),
    "contradiction": (f"{POINT}{POINT.replace('2.0', '3.0')}", "contradict"),
    "wrong type": (f'elements = "many"\n{POINT}', "elements = 'many'"),
    "not text": ("\0\1\2", "not valid TOML"),
}


def complaint(*args: object) -> str:
    """The one line on stderr about bad input."""
    result = invoke(*args, code=2)
    assert result.stderr.startswith("ngspring: error: ")
    assert result.stderr.count("\n") == 1
    assert "Traceback" not in result.output
    return result.stderr


@pytest.mark.parametrize("name", BAD_TOML)
def test_bad_toml(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text, expected = BAD_TOML[name]
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text(text)
    assert expected in complaint("optimize", "bad.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


@pytest.mark.parametrize(
    ("args", "expected"),
    [
        ("optimize C77", "did you mean 'C7'?"),
        ("optimize nothere.toml", "No such file"),
        ("optimize folder/x", "No such file"),
        ("optimize", "Missing argument"),
        ("optimize C7 C4", "unexpected extra argument"),
        ("optimize C7 --elements 7", "even integer"),
        ("optimize C7 --elements 0", "even integer"),
        ("optimize C7 --elements many", "not a valid integer"),
        ("optimize C7 --domain half", "'half' is not one of"),
        ("optimize C7 --solver magic", "'magic' is not one of"),
        ("optimize C7 --seed 3", "--initial random"),
        ("optimize C7 --initial random --seed -1", "--seed"),
        ("optimize C7 --initial nothere.npz", "no file nothere.npz"),
        ("optimize C7 --initial nothere", "no stored design"),
        ("optimize C7 --initial foo", "--initial: it must be column, random, a design's file"),
        ("optimize C7 --initial colum", "did you mean 'column'?"),
        ("optimize folder/a.csv", "ngspring targets folder/a.csv --write mine.toml"),
        ("targets folder/a.csv", "No such file"),
        ("optimize C7 --threads 0", "--threads"),
        ("optimize C7 --elements 12 --max-updates 0", "max_updates"),
        ("optimize C7 --elements 12 --dt-initial -1", "dt_initial"),
        ("optimize C7 --elements 12 --dt-initial nan", "not a finite number"),
        ("optimise C7", "No such command"),
        ("--nonsense", "No such option"),
        ("--log-file no/folder/log cases", "cannot write the log file"),
        ("show nothere.npz", "no file nothere.npz"),
        ("show .", "no file design.npz"),
        ("response nothere.npz", "no file nothere.npz"),
        ("check nothere.npz", "no file nothere.npz"),
        ("check", "name a design"),
        ("check x.npz --tolerance nan", "--tolerance"),
        ("bench --elements 5", "even integer"),
        ("bench --control-points 0", "control points"),
        ("bench --repeat 0", "--repeat"),
        ("bench --run C7 --repeat 2", "--repeat does not go with --run"),
        ("bench --max-updates 2", "--max-updates belongs to --run"),
        ("bench --run C99", "C99"),
    ],
)
def test_bad_arguments(
    args: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert expected in complaint(*args.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("option", ["--from nan", "--to inf", "--to 100", "--points 1"])
def test_bad_range(copy: Path, option: str) -> None:
    complaint("response", copy, *option.split())
    assert not list(copy.glob("response*.png"))


def test_bad_design_files(copy: Path, tmp_path: Path) -> None:
    good = (copy / "design.npz").read_bytes()
    bad = tmp_path / "bad.npz"
    for data in (good[: len(good) // 2], b"", b"nonsense", good[:-10]):
        bad.write_bytes(data)
        assert "bad.npz" in complaint("show", bad)
    with np.load(copy / "design.npz") as file:
        arrays = dict(file)
    np.savez(bad, **{**arrays, "version": 99})
    assert "version 99" in complaint("check", bad)
    np.savez(bad, x=1)
    assert "not a design file" in complaint("response", bad)
    assert "ngspring-checkpoint" in complaint("show", copy / "checkpoint.npz")
    text = "coefficients have shape"
    np.savez(bad, **{**arrays, "coefficients": np.zeros((2, 2))})
    assert text in complaint("optimize", "C4", "--elements", 12, "--initial", bad)


def test_bad_output_places(copy: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    run = ("optimize", "C4", "--elements", 12, "--out")
    assert "cannot make the folder" in complaint(*run, tmp_path / "file")
    out = ("--points", 2, "--threads", 1, "--out", tmp_path / "file")
    assert "cannot make the folder" in complaint("response", copy, *out)
    show = ("show", copy, "--threads", 1, "--out")
    assert "cannot write" in complaint(*show, tmp_path / "nowhere" / "x.png")
    assert "suffix of a picture" in complaint(*show, tmp_path / "x.nonsense")


@pytest.mark.long
def test_console_script_has_the_same_codes(tmp_path: Path) -> None:
    with start("optimize", "C77", cwd=tmp_path) as process:
        out, err = process.communicate()
    assert (process.returncode, out) == (2, "")
    assert err.startswith("ngspring: error: there is no case 'C77'")
    assert err.count("\n") == 1


def test_a_load_path_that_ends_is_code_3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import ngspring.evolution.evolve as evolution

    def nowhere(*args: Any, **kwargs: Any) -> Any:
        raise ConvergenceError("the path ends at d = -1 mm,\nbefore -10 mm")

    monkeypatch.setattr(evolution, "initial_state", nowhere)
    result = invoke("optimize", "C4", "--elements", 8, "--out", tmp_path / "out", code=3)
    expected = "ngspring: error: the path ends at d = -1 mm, before -10 mm"
    # On so coarse a mesh the strut that it resolves is stiff, which is told before.
    assert result.stderr.splitlines()[-1] == expected


def test_too_many_elements_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def too_much(problem: SpringProblem) -> Design:
        raise MemoryError

    monkeypatch.setattr(Design, "column", too_much)
    assert "not enough memory" in complaint("optimize", "C7", "--out", tmp_path / "out")
