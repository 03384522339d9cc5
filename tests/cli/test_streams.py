"""Output that cannot be written costs output, never the run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from support.commands import environment

from ngspring.design.design import Design

RUN = ("optimize", "c4", "--elements", "12", "--max-updates", "2", "--out", "run")
pytestmark = pytest.mark.skipif(os.name == "nt", reason="needs POSIX signals and devices")


def ngspring(*args: str, cwd: Path, **options: Any) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "ngspring", *args]
    settings = {"env": environment(), "stderr": subprocess.PIPE, **options}
    return subprocess.run(command, cwd=cwd, check=False, **settings)


def assert_whole_run(done: subprocess.CompletedProcess[bytes], cwd: Path) -> str:
    """It ended well and wrote all its files; returns what it said on stderr."""
    said = done.stderr.decode()
    assert done.returncode == 0, said
    design = Design.load(cwd / "run" / "design.npz")
    assert design.history is not None
    assert len(design.history) == 3
    assert (cwd / "run" / "report.html").exists()
    return said.replace("not converged: stopped after 2 design updates, as asked\n", "")


@pytest.mark.long
def test_a_pipe_that_is_closed_ends_the_printing_and_not_the_run(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    assert assert_whole_run(ngspring(*RUN, cwd=tmp_path, stdout=writing), tmp_path) == ""
    os.close(writing)


@pytest.mark.long
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_costs_the_output_and_is_told(tmp_path: Path) -> None:
    with open("/dev/full", "wb") as full:
        said = assert_whole_run(ngspring(*RUN, cwd=tmp_path, stdout=full), tmp_path)
    assert said == "ngspring: warning: output is lost: No space left on device\n"


@pytest.mark.long
def test_streams_that_were_closed_before_it_began_are_no_files_of_the_run(tmp_path: Path) -> None:
    def close() -> None:
        os.close(1)
        os.close(2)

    done = ngspring(*RUN, cwd=tmp_path, stderr=None, preexec_fn=close)
    assert done.returncode == 0
    assert Design.load(tmp_path / "run" / "design.npz").history is not None


@pytest.mark.long
def test_characters_that_a_terminal_has_not_are_question_marks(tmp_path: Path) -> None:
    plain = {**environment(), "PYTHONIOENCODING": "ascii"}
    done = ngspring(*RUN, cwd=tmp_path, env=plain, stdout=subprocess.PIPE)
    assert done.returncode == 0, done.stderr
    assert b" mm?" in done.stdout


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_while_modules_are_imported_is_one_line(number: str, tmp_path: Path) -> None:
    slow = tmp_path / "numpy"
    slow.mkdir()
    (slow / "__init__.py").write_text("print('here', flush=True)\nimport time\ntime.sleep(60)\n")
    path = os.pathsep.join((str(tmp_path), environment()["PYTHONPATH"]))
    command = [sys.executable, "-m", "ngspring", "show", "C4"]
    with subprocess.Popen(
        command,
        env={**environment(), "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"here\n"
        began = time.monotonic()
        process.send_signal(getattr(signal, number))
        _, said = process.communicate()
    assert time.monotonic() - began < 30
    assert process.returncode == 130
    assert said == b"ngspring: error: interrupted\n"


@pytest.mark.long
def test_a_hang_up_that_is_to_be_ignored_is_ignored(tmp_path: Path) -> None:
    def ignore() -> None:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    command = [sys.executable, "-m", "ngspring", *RUN]
    with subprocess.Popen(
        command,
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=ignore,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith(b"12 instead of")
        process.send_signal(signal.SIGHUP)
        process.communicate()
    assert process.returncode == 0
