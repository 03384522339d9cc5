"""What became of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ngspring.basics.errors import DesignFileError
from ngspring.campaign.plan import Run
from ngspring.design.corrections import without_aims
from ngspring.design.design import Design
from ngspring.design.soundness import flaw
from ngspring.evolution.folder import DESIGN
from ngspring.part.realisation import is_settled
from ngspring.problem.point import worst_deviation

CONVERGED, NOT_CONVERGED = "converged", "not converged"
FAILED, SKIPPED, INTERRUPTED = "failed", "skipped", "interrupted"


@dataclass(frozen=True)
class Outcome:
    """What became of a run.

    Attributes
    ----------
    run : Run
    status : str
        ``"converged"``, ``"not converged"``, ``"failed"`` (an error) or ``"skipped"`` (it
        should have continued from a run that failed); ``"interrupted"`` only on the way.
    message : str
        Why it did not converge, in one line.
    start : str
        Start of the design; empty, as what follows, where there is no design.
    q : tuple of float
        Reached forces in N; those of the solid, if they are known.
    width : float or None
        W/H (Eq. 20) or D/H (Eq. 25).
    updates, newton_iterations : int or None
    seconds : float or None
        Time the design took, interrupted pieces included.
    flaw : str
        Why a converged design is no part, see `ngspring.design.soundness`.
    """

    run: Run
    status: str
    message: str = ""
    start: str = ""
    q: tuple[float, ...] = ()
    width: float | None = None
    updates: int | None = None
    newton_iterations: int | None = None
    seconds: float | None = None
    flaw: str = ""

    @property
    def converged(self) -> bool:
        """Whether the design is a stationary point at dt = infinity."""
        return self.status == CONVERGED

    @property
    def has_design(self) -> bool:
        """Whether a run may continue from this one."""
        return self.status in (CONVERGED, NOT_CONVERGED)

    @property
    def worst_deviation(self) -> float | None:
        """Largest relative deviation of a force from its target, for points without eta."""
        return worst_deviation(self.run.problem.control_points, self.q)

    @classmethod
    def of_design(cls, run: Run, design: Design, status: str, message: str) -> Outcome:
        """Outcome of a run that ended with a design."""
        start = str(design.info.get("start", ""))
        if start != run.start_name:
            # Only a finished design is taken over from another start.
            message = f"begun from {start or 'an unknown start'}, not from {run.start_name}"
        history = design.history
        reason = flaw(design) if status == CONVERGED else ""
        return cls(
            run,
            status,
            # A converged run that misses its targets as a part says so once.
            "" if message == reason else message,
            start,
            tuple(design.solid or design.info.get("q", ())),
            design.relative_width,
            None if history is None else len(history) - 1,
            None if history is None else history.newton_iterations,
            None if history is None else history.last().seconds,
            reason,
        )


def finished(run: Run, out: Path) -> Outcome | None:
    """The outcome of a run whose folder holds a converged design of its problem, or None."""
    try:
        design = Design.load(out / run.name / DESIGN)
    except DesignFileError:
        return None
    asked = without_aims(design.problem) if run.part else design.problem
    same = asked.equals_but_for_name(run.problem)
    if not same or design.info.get("converged") is not True:
        return None
    if run.part and not is_settled(design):
        return None
    return Outcome.of_design(run, design, CONVERGED, "")
