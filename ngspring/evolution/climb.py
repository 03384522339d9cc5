"""From a coarser mesh to the next one: the design's state there, unless it went astray."""

from __future__ import annotations

import logging

from ngspring.basics.errors import ConvergenceError
from ngspring.design.design import Design
from ngspring.evolution.ladder import Ladder
from ngspring.kkt.start import initial_state
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem
from ngspring.problem.point import worst_deviation

logger = logging.getLogger(__name__)


def carried(
    system: CoupledSystem, design: Design, start: Design, ladder: Ladder
) -> tuple[State, bool]:
    """The state of a coarser mesh's design on this one, loaded from rest.

    Where its path cannot be followed, or its forces are far off, it is weighed against a start.

    Parameters
    ----------
    system : CoupledSystem
        On the finer mesh.
    design, start : Design
        The coarser mesh's, and the run's own start on this one.
    ladder : Ladder

    Returns
    -------
    State
    bool
        Whether it is that of the design, not of the start.

    Raises
    ------
    ConvergenceError
        If neither can be loaded.
    """
    place = system.problem
    found, why = None, ""
    try:
        found = initial_state(system, design.with_problem(place))
    except ConvergenceError as error:
        why = str(error)
    else:
        far = worst_deviation(place.control_points, found.forces(place)) or 0.0
        if abs(far) <= ladder.astray:
            return found, True
        why = f"its forces deviate by {far:.0%}"
    anew = initial_state(system, start)
    if found is not None and system.terms(found)["C"] <= system.terms(anew)["C"]:
        return found, True
    logger.warning(
        "the design on %d elements led astray (%s): %d elements begin from the start",
        design.problem.elements,
        why,
        place.elements,
    )
    return anew, False
