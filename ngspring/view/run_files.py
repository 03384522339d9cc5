"""What a run leaves in its folder besides its numbers: pictures, a report, a ParaView file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ngspring.analysis.finished import STATES_FILE, computed_responses, responses_in
from ngspring.analysis.response import response_csv
from ngspring.analysis.states import States, at_control_points
from ngspring.analysis.stored import StoredStates
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
#: What takes a load path.
COMPUTED = (STATES_FILE, RESPONSE, DESIGN_VTU)


def write_pictures(result: Result, folder: Path, threads: int | None = None) -> list[str]:
    """Write states.npz, response.csv, design.vtu, convergence.png, design.png and report.html.

    One that cannot be written costs neither the others nor the run: why is logged. The first three
    are what is computed; where they are those of this design already, they stay.

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

    responses: Mapping[float, States] | None = None
    if all((folder / name).is_file() for name in COMPUTED):
        responses = responses_in(folder, design)
    if responses is None:
        responses = computed = computed_responses(design, threads)
        at_points = at_control_points(computed, problem)
        tried(STATES_FILE, lambda path: StoredStates.of(design, computed).save(path))
        tried(RESPONSE, lambda path: write_text(path, response_csv(computed[0.0])))
        tried(DESIGN_VTU, lambda path: write_vtu(path, design, at_points))
    else:
        written += COMPUTED
    lines += [f"incomplete: {r.message}" for r in responses.values() if not r.complete]
    curve = responses[0.0]
    tried(
        CONVERGENCE_PICTURE,
        lambda path: save_figure(convergence_figure(result.history, problem), path),
    )
    tried(DESIGN_PICTURE, lambda path: save_figure(design_figure(design, responses, curve), path))
    tried(REPORT, lambda path: write_report(read_run(folder, ended=True), path))
    return [*lines, f"files in {folder}: {', '.join(written)}"]
