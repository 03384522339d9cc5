"""Where a run stands, read from its folder while the run goes on or after it ended.

Every file of a run folder is replaced as a whole, so what is read is never half written; nothing
is written here.
"""

from __future__ import annotations

import csv
import io
import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ngspring.analysis.finished import Stored, responses_in, responses_in_gallery
from ngspring.analysis.states import Curve, index_of
from ngspring.basics.arrays import LARGEST, FloatArray
from ngspring.basics.errors import DesignFileError, RunFolderError
from ngspring.basics.files import LARGEST_TEXT, PathLike, read_bounded, read_text
from ngspring.design.design import Design
from ngspring.design.soundness import flaw
from ngspring.evolution.checkpoint import Checkpoint
from ngspring.evolution.folder import CHECKPOINT, DESIGN, in_use, in_use_since, last_checkpoint
from ngspring.problem.scaling import force_unit
from ngspring.problem.spring import SpringProblem

RUNNING, STALE, CONVERGED = "running", "stale", "converged"
STOPPED, FAILED = "stopped", "failed"
RESPONSE = "response.csv"
STATES = "design.png"

#: A run that is this many seconds behind its last design update ...
_STALE = 600.0
#: ... and this many times the longest update before may hang.
_LONGEST = 10.0
#: Forces of a curve that belongs to a design agree within this share of the largest target.
_SAME_FORCE = 1e-3


@dataclass(frozen=True, eq=False)
class StoredCurve:
    """A load-displacement curve from a file: d in mm, in increasing order, and q in N."""

    d: FloatArray
    q: FloatArray


@dataclass(frozen=True, eq=False)
class RunState:
    """What is known of a run.

    Attributes
    ----------
    design : Design
        The last accepted one, with its history and the forces ``info["q"]``, if it has them.
    status : str
        ``"running"``, ``"stale"`` (running, but without a design update for long),
        ``"converged"``, ``"stopped"`` or ``"failed"``.
    reason : str
        More about the status, in one line.
    updated : float or None
        When the last design update was written, or the run was resumed since, in seconds since
        1970.
    curve : Curve or None
        Load-displacement curve of this design, if it has been computed.
    states : bytes or None
        The picture design.png of this design (PNG), if it has been drawn.
    responses : mapping from eta to StoredResponse, or None
        The load path of this design, if it is stored: to draw that picture from.
    closing : bool
        Whether the run has converged, but its curve and pictures are still to come.
    goal : SpringProblem, optional
        What was asked for, where the design is still on a coarser mesh.
    """

    design: Design
    status: str
    reason: str = ""
    updated: float | None = None
    curve: Curve | None = None
    states: bytes | None = None
    closing: bool = False
    responses: Stored | None = None
    goal: SpringProblem | None = None

    @property
    def asked(self) -> SpringProblem:
        """The problem that was asked for."""
        return self.goal or self.design.problem

    @property
    def evolving(self) -> bool:
        """Whether more design updates may come."""
        return self.status in (RUNNING, STALE)

    @property
    def going_on(self) -> bool:
        """Whether anything may come."""
        return self.evolving or self.closing

    @property
    def forces(self) -> list[float] | None:
        """Forces in N at the control points."""
        return forces_of(self.design)

    @property
    def elapsed(self) -> float | None:
        """Seconds of computing, up to now for a run that goes on."""
        history = self.design.history
        if history is None or not len(history):
            return None
        since = time.time() - self.updated if self.evolving and self.updated else 0.0
        return history.last().seconds + max(0.0, since)


def forces_of(design: Design) -> list[float] | None:
    """Forces in N at the control points that came with a design; None without them."""
    return design.info.get("q")


def holds_run(folder: Path) -> bool:
    """Whether a folder holds a checkpoint or a design."""
    return os.path.isfile(folder / CHECKPOINT) or os.path.isfile(folder / DESIGN)


def campaign_runs(folder: Path) -> list[Path]:
    """The folders of a campaign's runs that have begun, by name."""
    try:
        return sorted(path for path in folder.iterdir() if holds_run(path))
    except OSError:
        return []


def read_run(folder: PathLike, ended: bool = False) -> RunState:
    """Read where the run in a folder stands.

    Parameters
    ----------
    folder : path
    ended : bool
        Known to have ended, although the folder may be in use.

    Raises
    ------
    RunFolderError
        If there is no such folder, or no run in it.
    DesignFileError
        If its checkpoint, or a design without one, cannot be read.
    """
    folder = Path(folder)
    if not os.path.isdir(folder):
        raise RunFolderError(f"there is no run folder {folder}")
    path = folder / CHECKPOINT
    if not os.path.isfile(path):
        if os.path.isfile(folder / DESIGN):
            return stored_state(Design.load(folder / DESIGN), folder)
        if in_use(folder):
            raise RunFolderError(f"the run in {folder} has no design yet: try again in a minute")
        raise RunFolderError(f"{folder} holds no run: neither {CHECKPOINT} nor {DESIGN} is there")
    try:
        # Before the file is read: what is written in between would only seem older.
        updated = path.stat().st_mtime
    except OSError as error:
        raise RunFolderError(f"cannot read {path}: {error.strerror}") from error
    # Asked for first: a run that ends in between has written everything by then.
    held = False if ended else in_use(folder)
    if held:
        # A run that was resumed after a pause takes its time for the first update, too.
        updated = max(updated, in_use_since(folder))
    checkpoint = last_checkpoint(folder)
    design = _design_of(checkpoint)
    status, reason = _status(design, folder, held, time.time() - updated)
    responses = responses_in(folder, design)
    curve = _curve(folder, design) if responses is None else responses[0.0]
    closing = status == CONVERGED and held is True and curve is None
    states = None if status in (RUNNING, STALE) or closing else _states(folder)
    return RunState(
        design, status, reason, updated, curve, states, closing, responses, checkpoint.goal
    )


def stored_state(design: Design, folder: Path | None = None) -> RunState:
    """The state of a finished design.

    With the curve and the picture of its folder or of the gallery, if there are any.
    """
    status, reason = _ended(design)
    responses = None if folder is None else responses_in(folder, design)
    picture = None if folder is None else _states(folder)
    if responses is None and (stored := responses_in_gallery(design)) is not None:
        # The folder is where somebody happens to be: its picture may be another design's.
        responses, picture = stored, None
    curve: Curve | None = None if responses is None else responses[0.0]
    if curve is None and folder is not None:
        curve = _curve(folder, design)
    return RunState(design, status, reason, None, curve, picture, responses=responses)


def _design_of(checkpoint: Checkpoint) -> Design:
    last, problem = checkpoint.history.last(), checkpoint.problem
    info = {"start": checkpoint.start, "converged": last.is_end, **checkpoint.notes}
    if len(last.q) == len(problem.control_points):
        info["q"] = list(last.q)
    chi = checkpoint.state.chi.reshape(problem.coefficient_shape)
    return Design(problem, chi, checkpoint.history, info)


def _status(design: Design, folder: Path, held: bool | None, since: float) -> tuple[str, str]:
    assert design.history is not None
    if design.info["converged"]:
        return CONVERGED, flaw(design)
    if held is False:
        return _ended(_with_end(design, folder))
    seconds = design.history["seconds"]
    longest = float(np.diff(seconds, prepend=0.0).max())
    if since > max(_STALE, _LONGEST * longest):
        return STALE, f"no design update for {since / 60:.0f} minutes"
    return RUNNING, ""


def _ended(design: Design) -> tuple[str, str]:
    info = design.info
    if info.get("converged") is True:
        return CONVERGED, flaw(design)
    if "failed" in info:
        return FAILED, str(info["failed"])
    return STOPPED, str(info.get("stopped", "interrupted before its end"))


def _with_end(design: Design, folder: Path) -> Design:
    """With the notes of design.npz, which is written at the end, if it is of this update."""
    try:
        written = Design.load(folder / DESIGN)
    except DesignFileError:
        return design
    same = np.array_equal(written.coefficients, design.coefficients)
    return written if same and written.problem.equals_but_for_name(design.problem) else design


def _curve(folder: Path, design: Design) -> StoredCurve | None:
    """The curve in response.csv, if it is that of this design."""
    try:
        text = read_text(str(folder / RESPONSE))
        table = csv.DictReader(io.StringIO(text, newline=""))
        rows = [(float(row["d"]), float(row["q"])) for row in table]
    except (KeyError, TypeError, ValueError, csv.Error):
        return None
    if len(rows) < 2 or not (np.abs(rows) < LARGEST).all():
        return None
    d, q = np.array(sorted(rows)).T
    curve = StoredCurve(d, q)
    return curve if _fits(curve, design) else None


def _fits(curve: Curve, design: Design) -> bool:
    """Whether a curve goes through the forces of a design, wherever it holds a control point."""
    forces, points = forces_of(design), design.problem.control_points
    if forces is None:
        return False
    size = max(max(map(abs, forces)), 1e-12 * force_unit(design.problem))
    found = [
        abs(float(curve.q[index]) - force) / size
        for force, point in zip(forces, points, strict=True)
        if point.own and (index := index_of(curve, point.d)) is not None
    ]
    return bool(found) and max(found) <= _SAME_FORCE


def _states(folder: Path) -> bytes | None:
    """The picture design.png, if it was drawn after the last design was written."""
    picture, design = folder / STATES, folder / DESIGN
    try:
        if picture.stat().st_mtime_ns < design.stat().st_mtime_ns:
            return None
        content = read_bounded(picture, LARGEST_TEXT)
    except OSError:
        return None
    return content if content.startswith(b"\x89PNG") else None
