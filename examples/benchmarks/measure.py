"""The two codes as processes, measured in turn."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PACKAGE = "python3-getfem"
#: What both codes must agree to at the same state before their times are compared.
RESIDUAL, UPDATE = 1e-8, 1e-6
Answer = dict[str, Any]


class CodeError(RuntimeError):
    """A code has no answer, and why."""


class Code:
    """One of the two codes in a process of its own, so that its peak memory is its own."""

    def __init__(self, command: list[str], threads: int) -> None:
        # BLAS within MUMPS has as many threads as ngspring; everything else in GetFEM has one.
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": str(threads)}
        environment["PYTHONPATH"] = os.pathsep.join(
            [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        )
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
        )

    def answer(self) -> Answer:
        """The next line that the process writes."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            code = self._process.wait()
            raise CodeError(f"the process ended with exit code {code}")
        found: Answer = json.loads(line)
        if "error" in found:
            raise CodeError(found["error"])
        return found

    def ask(self, do: str, **arguments: object) -> Answer:
        """Send a command and wait for its answer."""
        assert self._process.stdin is not None
        print(json.dumps({"do": do, **arguments}), file=self._process.stdin, flush=True)
        return self.answer()

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.wait()


@contextlib.contextmanager
def ngspring(elements: int, threads: int, state: Path) -> Iterator[Code]:
    """ngspring, which writes the state that both codes start from."""
    command = [sys.executable, str(HERE / "ngspring_code.py"), str(elements), str(threads)]
    code = Code([*command, str(state)], threads)
    try:
        yield code
    finally:
        code.close()


@contextlib.contextmanager
def getfem(python: str, threads: int, state: Path) -> Iterator[Code]:
    """GetFEM with that state."""
    code = Code([python, str(HERE / "getfem_code.py"), str(state)], threads)
    try:
        code.answer()
        yield code
    finally:
        code.close()


def has_getfem(python: str) -> bool:
    """Whether this Python can import GetFEM."""
    try:
        done = subprocess.run([python, "-c", "import getfem, scipy"], capture_output=True)
    except OSError:
        return False
    return done.returncode == 0


def agreement(ours: Code, theirs: Code, folder: Path) -> Answer:
    """Distances of the two codes' residuals and updates.

    Raises
    ------
    CodeError
        If they do not solve the same system: their times could not be compared.
    """
    out = str(folder / "theirs.npz")
    theirs.ask("compare", out=out)
    found = ours.ask("compare", theirs=out)
    for name, bound in (("residual", RESIDUAL), ("update", UPDATE)):
        worst = max(found[name].values())
        if not worst <= bound:
            raise CodeError(f"the codes disagree: {name} by {worst:.1e}, more than {bound:.0e}")
    return found


def pairs(elements: int, threads: int, rounds: int, python: str | None) -> Answer:
    """Iterations in turn, ours and theirs; ours alone without GetFEM."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        state = Path(name) / "state.npz"
        ours = stack.enter_context(ngspring(elements, threads, state))
        first = ours.ask("prepare")["first"]
        result: Answer = {"elements": elements, "threads": threads, "first": first}
        if python is None:
            return {**result, "ours": [ours.ask("iterate") for _ in range(rounds)]}
        theirs = stack.enter_context(getfem(python, threads, state))
        result["agreement"] = agreement(ours, theirs, Path(name))
        result |= {"ours": [], "theirs": []}
        for _ in range(rounds):
            result["ours"].append(ours.ask("iterate"))
            result["theirs"].append(theirs.ask("iterate"))
        return result


def growth(elements: int, threads: int, rounds: int, python: str | None) -> Answer:
    """One mesh of the series: each code alone in the machine's memory, one after the other."""
    result: Answer = {"elements": elements, "threads": threads}
    with tempfile.TemporaryDirectory() as name:
        state = Path(name) / "state.npz"
        with ngspring(elements, threads, state) as ours:
            ours.ask("prepare")
            result["ours"] = [ours.ask("iterate") for _ in range(rounds)]
        if python is not None:
            try:
                with getfem(python, threads, state) as theirs:
                    theirs.ask("iterate")
                    result["theirs"] = [theirs.ask("iterate") for _ in range(rounds)]
            except CodeError as error:
                result["theirs_failed"] = str(error)
    return result


def our_run(elements: int, threads: int, rule: str, most_updates: int | None) -> Answer:
    """A whole run of ngspring."""
    # The state is not asked for, and not written.
    with ngspring(elements, threads, Path("state.npz")) as ours:
        found = ours.ask("run", rule=rule, most_updates=most_updates)
    return {"elements": elements, "threads": threads, "rule": rule, **found}


def their_run(elements: int, python: str, seconds: float, most_updates: int) -> Answer:
    """A whole run of GetFEM with the paper's rule, from the start that ngspring has solved."""
    with tempfile.TemporaryDirectory() as name:
        state, start = Path(name) / "state.npz", Path(name) / "start.npz"
        with ngspring(elements, 1, state) as ours:
            ours.ask("prepare")
            ours.ask("start", out=str(start))
        with getfem(python, 1, start) as theirs:
            found = theirs.ask("run", seconds=seconds, dt=1.0, most_updates=most_updates)
    return {"elements": elements, "threads": 1, "rule": "paper", **found}
