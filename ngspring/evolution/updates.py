"""What `ngspring.optimize` tells its observers and its caller."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.design.history import History


@dataclass(frozen=True, eq=False)
class Update:
    """What an observer gets: one design update, accepted or not.

    Attributes
    ----------
    accepted : bool
    row : dict
        The new row of the history (accepted), or that of the last accepted update.
    dt : float
        Pseudo-time step that was tried.
    reason : str
        Why a rejected update failed.
    design : Design
        The last accepted design.
    """

    accepted: bool
    row: dict[str, float]
    dt: float
    reason: str
    design: Design


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
