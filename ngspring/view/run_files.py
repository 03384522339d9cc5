"""What a run leaves in its folder besides its numbers: pictures, a report, a ParaView file."""

from __future__ import annotations

from pathlib import Path

from ngspring.analysis.response import response_csv
from ngspring.analysis.states import at_control_points, control_point_responses, curve_displacements
from ngspring.basics.files import write_text
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

    Returns
    -------
    list of str
        Lines for the user: where a curve is incomplete, and which files are there.

    Raises
    ------
    RunFolderError
        If a file cannot be written.
    """
    design, problem = result.design, result.design.problem
    save_figure(convergence_figure(result.history, problem), folder / CONVERGENCE_PICTURE)
    # The symmetric path is the same on the full domain, at ten times the cost.
    responses = control_point_responses(
        design, curve_displacements(design), domain="quarter", threads=threads
    )
    save_figure(design_figure(design, responses, responses[0.0]), folder / DESIGN_PICTURE)
    write_vtu(folder / DESIGN_VTU, design, at_control_points(responses, problem))
    write_text(folder / RESPONSE, response_csv(responses[0.0]))
    write_report(read_run(folder, ended=True), folder / REPORT)
    lines = [f"incomplete: {r.message}" for r in responses.values() if not r.complete]
    names = (DESIGN, HISTORY, RESPONSE, CONVERGENCE_PICTURE, DESIGN_PICTURE, DESIGN_VTU, REPORT)
    return [*lines, f"files in {folder}: {', '.join(names)}"]
