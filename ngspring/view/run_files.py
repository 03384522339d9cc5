"""What a run leaves in its folder besides its numbers: pictures, a report, a ParaView file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ngspring.analysis.response import response_csv
from ngspring.analysis.states import at_control_points, control_point_responses, curve_displacements
from ngspring.basics.files import attempt, write_text
from ngspring.evolution.folder import DESIGN, HISTORY
from ngspring.evolution.runstate import RESPONSE, STATES, read_run
from ngspring.evolution.updates import Result
from ngspring.view.figure import save_figure
from ngspring.view.report import REPORT, write_report
from ngspring.view.rows import design_figure
from ngspring.view.run import convergence_figure
from ngspring.view.vtu import write_vtu

CONVERGENCE_PICTURE = "convergence.png"
DESIGN_PICTURE = STATES
DESIGN_VTU = "design.vtu"


def write_pictures(result: Result, folder: Path, threads: int | None = None) -> list[str]:
    """Write convergence.png, design.png, design.vtu, response.csv and report.html.

    One that cannot be written costs neither the others nor the run: why is logged.

    Returns
    -------
    list of str
        Lines for the user: where a curve is incomplete, and which files are there or are not.
    """
    design, problem = result.design, result.design.problem
    written, lines = [DESIGN, HISTORY], []

    def tried(name: str, write: Callable[[Path], object]) -> None:
        reason = attempt(folder / name, write)
        if reason:
            lines.append(reason)
        else:
            written.append(name)

    # The symmetric path is the same on the full domain, at ten times the cost.
    responses = control_point_responses(
        design, curve_displacements(design), domain="quarter", threads=threads
    )
    lines += [f"incomplete: {r.message}" for r in responses.values() if not r.complete]
    curve = responses[0.0]
    tried(RESPONSE, lambda path: write_text(path, response_csv(curve)))
    tried(
        CONVERGENCE_PICTURE,
        lambda path: save_figure(convergence_figure(result.history, problem), path),
    )
    tried(DESIGN_PICTURE, lambda path: save_figure(design_figure(design, responses, curve), path))
    at_points = at_control_points(responses, problem)
    tried(DESIGN_VTU, lambda path: write_vtu(path, design, at_points))
    tried(REPORT, lambda path: write_report(read_run(folder, ended=True), path))
    return [*lines, f"files in {folder}: {', '.join(written)}"]
