"""The row of a history that describes a state."""

from __future__ import annotations

from collections.abc import Mapping

from ngspring.design.history import Row
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem


def row_of(system: CoupledSystem, state: State, effort: Mapping[str, float]) -> Row:
    """The row of a state.

    Parameters
    ----------
    system : CoupledSystem
    state : State
    effort : mapping
        Columns that the state does not tell: ``update``, ``dt``, ``seconds``, iterations.

    Returns
    -------
    Row
    """
    problem, values = system.problem, system.terms(state)
    width = problem.equivalent_width(values["V"]) / problem.H
    return Row.from_columns(
        {"leap": 0.0, **values, "elements": problem.elements, "width": width} | dict(effort)
    )
