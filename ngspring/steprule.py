"""How the pseudo-time step of the evolution changes (2.7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ngspring.problem import SpringProblem


@dataclass(frozen=True)
class StepRule:
    """How dt changes (2.7).

    Parameters
    ----------
    few : int
        Fewer Newton iterations than this make dt grow.
    growth : float
        By this factor (the paper's 2) ...
    easy_growth : float
        ... and by this one after ``easy`` iterations or fewer.
    easy : int
        See above; 0 for the paper's rule.
    shrink : float
        A failed update is repeated with dt divided by this.
    end : float
        The transient term is removed when dt exceeds this.
    smallest : float
        Give up below this dt. Both in units of the paper's domain, see `time_unit`.
    """

    few: int = 6
    growth: float = 2.0
    easy_growth: float = 5.0
    easy: int = 3
    shrink: float = 4.0
    end: float = 1e20
    smallest: float = 1e-8

    def grown(self, dt: float, iterations: int, rejected: int = 0) -> float:
        """Next dt after an accepted update that took so many Newton iterations.

        Right after ``rejected`` attempts with a larger dt there is no easy growth: the limit is
        near.
        """
        if iterations <= self.easy and not rejected:
            return dt * self.easy_growth
        return dt * self.growth if iterations < self.few else dt


PAPER_RULE = StepRule(easy=0)


def time_unit(problem: SpringProblem) -> float:
    """Size of the domain's volume relative to the paper's 10^4 mm^3; pseudo-time scales with it."""
    if problem.axisymmetric:
        return float(np.pi * (problem.L / 2) ** 2 * problem.H / 1e4)
    return problem.L * problem.H * problem.T / 1e4
