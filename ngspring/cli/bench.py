"""The command ``ngspring bench``."""

from __future__ import annotations

import click
from rich.table import Table

from ngspring.cli.arguments import read_problem
from ngspring.cli.options import OK, anywhere_option, solver_option, threads_option
from ngspring.cli.progress import shown_progress
from ngspring.cli.tables import make_console, new_table
from ngspring.evolution.bench import PARTS, RunBenchmark, benchmark_run
from ngspring.kkt.bench import Benchmark, bench_problem, benchmark
from ngspring.problem.scaling import on_mesh
from ngspring.problem.sector import DOMAINS
from ngspring.problem.spring import SpringProblem
from ngspring.view.run_files import write_pictures

#: Options that mean something only for one iteration, and only for a run.
_OF_ITERATION, _OF_RUN = ("control_points", "repeat"), ("max_updates", "targets_anywhere")


@click.command("bench")
@click.option(
    "--run",
    "case",
    metavar="CASE|FILE.toml",
    help="Time a whole run of `ngspring optimize` with its pictures; nothing of it is kept.",
)
@click.option(
    "--elements",
    type=int,
    help="N of an N x N mesh; 80 by default, or the problem's own with --run.",
)
@click.option(
    "--domain",
    type=click.Choice(list(DOMAINS)),
    help="Part of the spring that is analysed; quarter by default, or the problem's own.",
)
@click.option("--control-points", type=int, default=3, show_default=True)
@threads_option
@solver_option
@click.option("--repeat", type=click.IntRange(min=1), default=5, show_default=True)
@click.option("--max-updates", type=int, help="Stop the run after this many design updates.")
@anywhere_option
@click.pass_context
def bench_command(
    context: click.Context,
    case: str | None,
    elements: int | None,
    domain: str | None,
    control_points: int,
    threads: int | None,
    solver: str,
    repeat: int,
    max_updates: int | None,
    targets_anywhere: bool,
) -> int:
    """Time the parts of a coupled Newton iteration on this machine, or of a whole run."""
    _refuse(context, _OF_RUN if case is None else _OF_ITERATION, case is None)
    if case is None:
        mesh = 80 if elements is None else elements
        problem = bench_problem(mesh, control_points, domain or "quarter")
        result = benchmark(problem, threads=threads, solver=solver, repeat=repeat)
        make_console().print(_bench_table(problem, result))
        return OK
    problem = _run_problem(case, elements, domain, targets_anywhere)
    with shown_progress(problem, make_console()) as observer:
        run = benchmark_run(
            problem,
            threads=threads,
            solver=solver,
            max_updates=max_updates,
            observers=[observer],
            pictures=lambda result, folder: write_pictures(result, folder, threads),
        )
    make_console().print(_run_table(problem, run))
    return OK


def _refuse(context: click.Context, names: tuple[str, ...], iteration: bool) -> None:
    """Refuse options that would mean nothing."""
    for name in names:
        source = context.get_parameter_source(name)
        if source is click.core.ParameterSource.COMMANDLINE:
            option = f"--{name.replace('_', '-')}"
            raise click.UsageError(
                f"{option} belongs to --run" if iteration else f"{option} does not go with --run"
            )


def _run_problem(
    case: str, elements: int | None, domain: str | None, targets_anywhere: bool
) -> SpringProblem:
    problem, _ = read_problem(case, None, targets_anywhere)
    if elements is not None:
        problem, note = on_mesh(problem, elements)
        if note:
            click.echo(note)
    return problem if domain is None else problem.replace(domain=domain)


def _run_table(problem: SpringProblem, run: RunBenchmark) -> Table:
    """Where the seconds of a run went, and what it did in them."""
    n = problem.elements
    name = problem.name or "spring"
    title = f"{name}, {n} x {n} elements ({problem.domain}), threads: {run.threads}"
    table = new_table("", "seconds", "share", texts=("",), title=title)
    for name, words in PARTS.items():
        table.add_row(words, f"{run.parts[name]:.2f}", f"{run.parts[name] / run.seconds:.1%}")
    table.add_section()
    table.add_row("whole run", f"{run.seconds:.2f}", "")
    table.add_row(
        "per coupled Newton iteration, without pictures", f"{run.seconds_an_iteration:.3f}", ""
    )
    table.add_section()
    table.add_row("design updates", f"{run.updates}", "")
    table.add_row("  rejected", f"{run.rejected}", "")
    table.add_row("coupled Newton iterations", f"{run.iterations}", "")
    table.add_row("  of rejected updates", f"{run.rejected_iterations}", "")
    table.add_row("peak memory of the process [GB]", f"{run.peak_memory:.3f}", "")
    table.caption = "converged" if run.converged else run.message
    return table


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
