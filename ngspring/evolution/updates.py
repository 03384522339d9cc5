"""What `ngspring.optimize` tells its observers and its caller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ngspring.basics.arrays import FloatArray
from ngspring.design.corrections import Correction
from ngspring.design.design import Design
from ngspring.design.history import History, Row
from ngspring.evolution.checkpoint import Checkpoint


@dataclass(frozen=True, eq=False)
class Update:
    """What an observer gets: one design update, accepted or not.

    Attributes
    ----------
    accepted : bool
    row : Row
        The new row of the history (accepted), or that of the last accepted update.
    dt : float
        Pseudo-time step that was tried.
    reason : str
        Why a rejected update failed, or a step of those that follow.
    design : Design
        The last accepted design.
    checkpoint : Checkpoint, optional
        All that is needed to continue from there, see `ngspring.evolve`; too much to be sent from
        a campaign's worker.
    resumed : bool
        Whether it only tells where a resumed run stands.
    correction : Correction, optional
        What the solid of this stationary design carries, if that is the news (`ngspring.realise`).
    followed : float, optional
        Share of the way to corrected targets that the stationary point was followed over, if that
        is the news; nothing is accepted before the end.
    """

    accepted: bool
    row: Row
    dt: float
    reason: str
    design: Design
    checkpoint: Checkpoint | None = None
    resumed: bool = False
    correction: Correction | None = None
    followed: float | None = None

    @property
    def rejected(self) -> bool:
        """Whether an attempt has failed."""
        return not self.accepted and self.followed is None


#: Called after every accepted or rejected update.
Observer = Callable[[Update], None]


@dataclass(frozen=True, eq=False)
class Result:
    """Outcome of `optimize`.

    Attributes
    ----------
    design : Design
        The last accepted design, with its history.
    history : History
    q : array
        Reaction forces at the control points in N.
    converged : bool
        Whether the final step without transient term was reached.
    message : str
        Why not, if not.
    """

    design: Design
    history: History
    q: FloatArray
    converged: bool
    message: str
