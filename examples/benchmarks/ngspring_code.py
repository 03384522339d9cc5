"""The coupled system by ngspring, with the same commands as ``getfem_code.py``::

    python ngspring_code.py ELEMENTS THREADS STATE.npz

It makes the state that both codes start from and writes it into the file.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import exchange
import numpy as np

from ngspring.design.design import Design
from ngspring.evolution.bench import benchmark_run
from ngspring.evolution.steprule import PAPER_RULE
from ngspring.fem.process import parallel
from ngspring.kkt.bench import bench_problem, peak_memory
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.kkt.timings import Timings

#: Pseudo-time step of the iteration that is timed, in mm^2 scaled as in the paper.
DT = 100.0


def compared_state(system: CoupledSystem) -> tuple[State, np.ndarray]:
    """A state where every term of Eqs. 4, 7 and 8 counts, and the chi before it.

    The column with twice its contrast has void beyond chi = -6; off its equilibrium by a little, no
    residual is mere rounding.
    """
    problem = system.problem
    design = Design(problem, 2 * Design.column(problem).coefficients)
    state = initial_state(system, design)
    return State(state.chi, 1.00001 * state.u, 0.9 * state.lam), 0.999 * state.chi


class Code:
    """ngspring at one mesh, with one number of threads."""

    def __init__(self, elements: int, threads: int, path: Path) -> None:
        self.problem = bench_problem(elements)
        self.threads = threads
        self.path = path

    def prepare(self) -> dict[str, Any]:
        """Make the state and write it; one iteration goes ahead, with the symbolic analysis."""
        self.system = CoupledSystem(self.problem, threads=self.threads)
        self.state, self.chi_old = compared_state(self.system)
        exchange.write_state(self.path, self.system, self.state, self.chi_old, DT)
        first = self.iterate()
        return {"first": first["iteration"]}

    def start(self, out: str) -> dict[str, Any]:
        """Write the state that a run begins with."""
        state = initial_state(self.system, Design.column(self.problem))
        exchange.write_state(Path(out), self.system, state, state.chi, 1.0)
        return {}

    def iterate(self) -> dict[str, Any]:
        """Time one coupled Newton iteration."""
        timings = self.system.timings = Timings()
        begin, begin_cpu = time.perf_counter(), time.process_time()
        self._iteration()
        passed, cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
        seconds = timings.seconds
        return {
            "iteration": passed,
            "cpu": cpu,
            "assembly": seconds["assembly"] + seconds["reduction"],
            "linear": seconds["factorisation"] + seconds["solve"],
            "residual": seconds["residual"],
            "unknowns": self.system.unknowns,
            "memory": peak_memory(),
        }

    def _iteration(self) -> tuple[Any, State]:
        residual = self.system.residual(self.state, self.chi_old, DT)
        self.system.assemble(self.state, DT)
        return residual, self.system.solve(residual)

    def compare(self, theirs: str) -> dict[str, Any]:
        """How far their residual and their update are from ours."""
        residual, update = self._iteration()
        found = exchange.read_residual(Path(theirs), self.system)
        return {
            "residual": exchange.residual_distances(found, residual),
            "update": exchange.update_distances(Path(theirs), self.system, update),
        }

    def run(self, rule: str, most_updates: int | None = None) -> dict[str, Any]:
        """A whole run, with the paper's rule for dt or ngspring's own."""
        done = benchmark_run(
            self.problem,
            threads=self.threads,
            max_updates=most_updates,
            rule=PAPER_RULE if rule == "paper" else None,
        )
        return {
            "seconds": done.seconds,
            "parts": dict(done.parts),
            "updates": done.updates,
            "rejected": done.rejected,
            "iterations": done.iterations,
            "rejected_iterations": done.rejected_iterations,
            "message": "converged" if done.converged else done.message,
            "width": done.width,
            "memory": done.peak_memory,
        }


def main(elements: str, threads: str, path: str) -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    code = Code(int(elements), int(threads), Path(path))
    with parallel(int(threads)):
        for line in sys.stdin:
            command = json.loads(line)
            try:
                found = getattr(code, command.pop("do"))(**command)
            except ArithmeticError as error:
                found = {"error": str(error)}
            print(json.dumps(found), file=answers, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
