"""The report of a run or a design: one HTML file that needs nothing but a browser.

It is made from what is stored; no equilibrium is computed, so it takes about a second and may be
written again and again while the run goes on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from markupsafe import Markup
from matplotlib.figure import Figure

from ngspring.basics.files import PathLike, attempt, write_text
from ngspring.basics.text import significant
from ngspring.design.corrections import corrections_of
from ngspring.design.design import Design
from ngspring.design.history import History, stages
from ngspring.evolution.estimate import TYPICAL_UPDATES, seconds_left
from ngspring.evolution.runstate import RUNNING, RunState, forces_of, stored_state
from ngspring.evolution.updates import Update
from ngspring.problem.dimension import used_weights
from ngspring.problem.laws.stability import stable_range
from ngspring.problem.point import worst_deviation
from ngspring.problem.sector import DOMAINS
from ngspring.problem.spring import SpringProblem
from ngspring.view.design import density_figure
from ngspring.view.html import link, page, picture
from ngspring.view.rows import design_figure
from ngspring.view.run import convergence_figure, forces_figure, reached_figure
from ngspring.view.targets import Forces, targets_table
from ngspring.view.text import duration, signed_percent, step, width_symbol

REPORT = "report.html"
#: A browser loads the report of a running run again after so many seconds.
REFRESH = 10
_ROWS = 12
_NO_NUMBER = "–"
_MARGINS = (0.12, 0.12, 0.97, 0.93)


def write_report(state: RunState | Design, path: PathLike, refresh: int = REFRESH) -> None:
    """Write the report of a run or a design atomically.

    Parameters
    ----------
    state : RunState or Design
        See `ngspring.read_run`.
    path : path
    refresh : int
        Seconds after which a browser loads the file again, while the run goes on.

    Raises
    ------
    RunFolderError
        If the file cannot be written.
    """
    state = stored_state(state) if isinstance(state, Design) else state
    write_text(path, report_page(state, refresh))


def keep_report(read: Callable[[], RunState], path: PathLike) -> bool:
    """Write the report of a run, or log why not: a report is no reason to lose anything.

    Parameters
    ----------
    read : callable
        Gives the state of the run.
    path : path

    Returns
    -------
    bool
        Whether it was written.
    """
    return not attempt(Path(path), lambda place: write_report(read(), place))


def report_page(state: RunState, refresh: int = REFRESH) -> str:
    """The report as HTML text."""
    problem, history = state.asked, state.design.history
    history = history if history is not None and len(history) else None
    columns, targets = _targets(state)
    return page(
        "report.html",
        refresh if state.going_on else None,
        name=problem.name or "spring",
        state=state,
        problem=problem,
        history=history,
        symbol=width_symbol(problem),
        summary=_summary(state, history),
        typical_updates=TYPICAL_UPDATES,
        target_columns=columns,
        targets=targets,
        quantities=_quantities(problem, state.design.info),
        **_pictures(state, history),
        **({} if history is None else _convergence(history, problem, state.design)),
        meshes=[] if history is None else _meshes(history, problem),
        corrections=[] if history is None else _corrections(state.design, history),
    )


# -- numbers ---------------------------------------------------------------------------------------


def _summary(state: RunState, history: History | None) -> list[tuple[str, str]]:
    """Names and values."""
    design = state.design
    cards = [(width_symbol(design.problem), f"{design.relative_width:.4f}")]
    cards.append(("volume V", f"{significant(design.volume, 5)} mm³"))
    if history is not None:
        cards.append(("design updates", str(len(history) - 1)))
        cards.append(("Newton iterations", str(history.newton_iterations)))
        cards.append(("dt", step(history.last().dt)))
        cards.append(("elapsed", duration(state.elapsed or 0.0)))
        if state.evolving:
            cards.append(("time left (estimate)", time_left_text(history, state.asked)))
    return cards


def time_left_text(history: History, problem: SpringProblem) -> str:
    """The estimate of the time left in words, no more exact than it is."""
    seconds = seconds_left(history, problem)
    if seconds is None:
        return "not known yet"
    for size, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            value = seconds / size
            return f"about {value:.1f} {unit}" if value < 3 else f"about {value:.0f} {unit}"
    return f"about {max(1, round(seconds, -1 if seconds > 20 else 0)):.0f} s"


def _targets(state: RunState) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Targets, reached forces and deviations, with the names of the columns."""
    design = state.design
    forces: Forces = state.forces or [None] * len(design.problem.control_points)
    return targets_table(design.problem, forces, design.solid, missing=_NO_NUMBER, mark=" †")


def _updates(history: History) -> list[list[str]]:
    """The last rows of the history, the newest first."""
    rows = []
    for row in reversed(history.rows()[-_ROWS:]):
        cells = [str(row.update), step(row.dt), str(row.newton_iterations)]
        cells += [str(row.rejected), f"{row.C:.4e}", f"{row.width:.4f}"]
        cells += [significant(q, 5) for q in row.q]
        rows.append([*cells, duration(row.seconds)])
    return rows


def _meshes(history: History, problem: SpringProblem) -> list[list[str]]:
    """What was done on each mesh, if there was more than one."""
    meshes = [stage for stage in stages(history.rows()) if not stage[0].correction]
    if len(meshes) == 1:
        return []
    rows, before = [], 0.0
    for mesh in meshes:
        first, last = mesh[0], mesh[-1]
        far = worst_deviation(problem.control_points, first.q)
        cells = [f"{last.elements} × {last.elements}", str(last.update - first.update)]
        cells += [str(sum(row.iterations for row in mesh)), step(last.dt)]
        cells += [_NO_NUMBER if far is None else signed_percent(far, 3), f"{last.width:.4f}"]
        rows.append([*cells, duration(last.seconds - before)])
        before = last.seconds
    return rows


def _corrections(design: Design, history: History) -> list[list[str]]:
    """What the third medium was asked for, and what the solid carried, time after time."""
    points, rows = design.problem.control_points, history.rows()
    found = []
    for number, one in enumerate(corrections_of(design.info)):
        effort = [row for row in rows[: one.update + 1] if row.correction == number]
        cells = [str(number), ", ".join(significant(force, 5) for force in one.aims)]
        cells.append(", ".join(significant(force, 5) for force in one.solid))
        cells += [signed_percent(one.worst(points), 2), f"{rows[one.update].width:.4f}"]
        cells += [str(len(effort) - 1), str(sum(row.iterations for row in effort))]
        found.append(cells)
    return found


def _quantities(problem: SpringProblem, info: Mapping[str, object]) -> list[tuple[str, str]]:
    """Mesh, material and weights."""
    rows = [
        ("kinematics", problem.kinematics),
        ("analysed", DOMAINS[problem.domain].words),
        ("mesh over the full domain", f"{problem.elements} × {problem.elements} elements"),
        ("L × H", f"{problem.L:g} × {problem.H:g} mm"),
    ]
    names = list(used_weights(problem))
    values = [f"{getattr(problem, name):g}" for name in names]
    parameters = [f"{name} = {value:g}" for name, value in problem.law.parameters.items()]
    law = []
    if problem.material is not None:
        law = [
            (f"{problem.law.name} law", ", ".join(parameters)),
            ("stable for stretches", str(stable_range(problem.law))),
        ]
    if problem.stretch_limit:
        rows.append(("limit of the largest stretch", f"{problem.stretch_limit:g}"))
    if problem.energy_limit:
        rows.append(("limit of the strain energy density", f"{problem.energy_limit:g} MPa"))
    for key in ("wall", "gap"):
        if getattr(problem, key):
            rows.append((f"smallest {key}", f"{getattr(problem, key):g} mm"))
    if problem.motion.thick:
        rows.append(("thickness T", f"{problem.T:g} mm"))
    rows += [
        ("bulk and shear modulus K, G", f"{problem.K:.4g}, {problem.G:.4g} MPa"),
        *law,
        ("interface width l_i", f"{problem.l_i:g} mm"),
        (f"weights {', '.join(names).replace('rho', 'ρ')}", ", ".join(values)),
        ("void: E_0, k_r, p", f"{problem.E_0:g}, {problem.k_r:g}, {problem.p:g}"),
    ]
    if info.get("start"):
        rows.append(("start", str(info["start"])))
    return rows


# -- pictures --------------------------------------------------------------------------------------


def _pictures(state: RunState, history: History | None) -> dict[str, Markup | None]:
    design, problem = state.design, state.design.problem
    forces, curve = state.forces, state.curve
    known = "The load-displacement curve and the" if curve is not None else "The"
    caption = f"† {known} forces at the control points against their targets."
    if state.going_on:
        caption += " The whole curve is computed at the end of the run."
    elif curve is None:
        caption += " The whole curve has not been computed: ngspring response does it."
    if curve is not None:
        low, high = float(curve.d.min()), float(curve.d.max())
        outside = [f"{p.d:g}" for p in problem.control_points if not low <= p.d <= high]
        if outside:
            caption += f" The curve ends before d = {', '.join(outside)} mm."
    return {
        "design": picture(
            "design",
            density_figure(design),
            f"Density of the design over {problem.L:g} by {problem.H:g} mm: black is solid,"
            " white is void",
            "Design: density ρ on the undeformed body (dash-dotted: symmetry axes).",
        ),
        "curve": picture(
            "curve",
            reached_figure(problem, forces, curve, history, design.solid),
            "Diagram of force q in N against displacement d in mm with "
            + _forces_text(problem, forces),
            caption,
            margins=_MARGINS,
        ),
        "states": _states(state),
    }


def _states(state: RunState) -> Markup | None:
    """The picture of the deformed states, as it was drawn or from what is stored of them."""
    drawn: bytes | Figure | None = state.states
    if drawn is None and state.responses is not None:
        drawn = design_figure(state.design, state.responses, state.responses[0.0])
    if drawn is None:
        return None
    return picture(
        "states",
        drawn,
        "The design undeformed and deformed at each control point, and its load-displacement curve",
        "† The design undeformed and deformed at the control points.",
    )


def _forces_text(problem: SpringProblem, forces: Sequence[float] | None) -> str:
    texts = []
    for j, point in enumerate(problem.control_points):
        reached = "" if forces is None else f", reached {forces[j]:.4g} N"
        texts.append(f"target {point.q:g} N at {point.d:g} mm{reached}")
    return "; ".join(texts)


def _convergence(history: History, problem: SpringProblem, design: Design) -> dict[str, object]:
    """What there is to see of the design updates."""
    symbol = width_symbol(problem)
    points = problem.control_points[: len(history.last().q)]
    return {
        "force_names": [f"q at {point.d:g} mm [N]" for point in points],
        "updates": _updates(history),
        "convergence": picture(
            "convergence",
            convergence_figure(history, problem),
            f"Four diagrams over design updates: time step dt, objective C, its control-point"
            f" terms, and {symbol}, which is now {history.last().width:.4f}",
            f"dt, the objective C, its control-point terms and the volume as {symbol} over the"
            " design updates.",
            dpi=90,
        ),
        "forces": picture(
            "forces",
            forces_figure(history, problem, corrections_of(design.info)),
            "Diagram of the forces at the control points over design updates",
            "Forces at the control points over the design updates.",
            margins=_MARGINS,
        ),
    }


# -- several runs ----------------------------------------------------------------------------------


def write_index(
    runs: Iterable[tuple[str, RunState | str]],
    path: PathLike,
    name: str,
    links: bool = True,
    refresh: int | None = None,
) -> None:
    """Write one row per run of a campaign.

    Parameters
    ----------
    runs : iterable of (name, RunState or str)
        A string says why a run cannot be read.
    path : path
    name : str
        Of the campaign.
    links : bool
        Whether each run's own report is in its folder, beside the index.
    refresh : int, optional
        Seconds after which a browser loads the file again.

    Raises
    ------
    RunFolderError
        If the file cannot be written.
    """
    states = dict(runs)
    known = {run for run, state in states.items() if isinstance(state, RunState)}
    rows = [
        (link(f"{run}/{REPORT}", run) if links and run in known else run, *_index_cells(state))
        for run, state in states.items()
    ]
    going_on = sum(isinstance(state, RunState) and state.going_on for state in states.values())
    write_text(Path(path), page("index.html", refresh, name=name, rows=rows, going_on=going_on))


def _index_cells(state: RunState | str) -> tuple[str, ...]:
    if isinstance(state, str):
        return state, *[_NO_NUMBER] * 6
    design, history, forces = state.design, state.design.history, forces_of(state.design)
    width = f"{design.relative_width:.4f}"
    far = worst_deviation(design.problem.control_points, forces or ())
    worst = _NO_NUMBER if far is None else signed_percent(far, 3)
    status = f"{state.status}: {state.reason}" if state.reason else state.status
    if history is None or not len(history):
        return status, _NO_NUMBER, _NO_NUMBER, width, worst, _NO_NUMBER, _NO_NUMBER
    left = time_left_text(history, state.asked) if state.evolving else _NO_NUMBER
    updates, dt = str(len(history) - 1), step(history.last().dt)
    return status, updates, dt, width, worst, duration(state.elapsed or 0.0), left


# -- while a run goes on ---------------------------------------------------------------------------


def _state_of(update: Update) -> RunState:
    checkpoint = update.checkpoint
    goal = None if checkpoint is None else checkpoint.goal
    return RunState(update.design, RUNNING, updated=time.time(), goal=goal)


class ReportWriter:
    """Observer for `ngspring.optimize` that keeps the report of the run up to date.

    Parameters
    ----------
    path : path
        File to write.
    interval : float
        Fewest seconds between two writings. Writing takes at most a fiftieth of the run's time,
        whatever the interval.

    Examples
    --------
    >>> writer = ReportWriter("runs/C7/report.html")  # doctest: +SKIP
    >>> ngspring.optimize(problem, observers=[writer])  # doctest: +SKIP
    """

    def __init__(self, path: PathLike, interval: float = REFRESH) -> None:
        self.path = Path(path)
        self.interval = interval
        self._next = 0.0

    def __call__(self, update: Update) -> None:
        """Take in a design update."""
        begin = time.monotonic()
        if not update.accepted or begin < self._next:
            return
        keep_report(lambda: _state_of(update), self.path)
        end = time.monotonic()
        self._next = end + max(self.interval, 50 * (end - begin))
