"""The command ``ngspring bench``."""

from __future__ import annotations

import click
from rich.table import Table

from ngspring.cli.options import OK, solver_option, threads_option
from ngspring.cli.tables import make_console
from ngspring.kkt.bench import Benchmark, bench_problem, benchmark
from ngspring.problem.sector import DOMAINS
from ngspring.problem.spring import SpringProblem


@click.command("bench")
@click.option("--elements", type=int, default=80, show_default=True)
@click.option("--domain", type=click.Choice(list(DOMAINS)), default="quarter", show_default=True)
@click.option("--control-points", type=int, default=3, show_default=True)
@threads_option
@solver_option
@click.option("--repeat", type=click.IntRange(min=1), default=5, show_default=True)
def bench_command(
    elements: int,
    domain: str,
    control_points: int,
    threads: int | None,
    solver: str,
    repeat: int,
) -> int:
    """Time the parts of a coupled Newton iteration on this machine."""
    problem = bench_problem(elements, control_points, domain)
    result = benchmark(problem, threads=threads, solver=solver, repeat=repeat)
    make_console().print(_bench_table(problem, result))
    return OK


def _bench_table(problem: SpringProblem, result: Benchmark) -> Table:
    """Sizes, seconds and memory of a Newton iteration."""
    n = problem.elements
    table = Table(caption=f"seconds: medians of {result.repeat}", show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_row("elements", f"{n} x {n} ({problem.domain})")
    table.add_row("control points", f"{len(problem.control_points)}")
    table.add_row("threads", f"{result.threads}")
    table.add_row("unknowns", f"{result.unknowns:,}")
    table.add_row("non-zeros (lower triangle)", f"{result.nonzeros:,}")
    for name in ("assembly", "reduction", "factorisation", "solve", "residual"):
        table.add_row(f"{name} [s]", f"{getattr(result, name):.4f}")
    table.add_row("whole Newton iteration [s]", f"{result.iteration:.4f}")
    table.add_row("first iteration, with symbolic analysis [s]", f"{result.first_iteration:.4f}")
    table.add_row("peak memory of the process [GB]", f"{result.peak_memory:.3f}")
    return table
