"""How the pseudo-time step of the evolution changes (2.7), for either kind of step."""

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


@dataclass(frozen=True)
class MixedRule:
    """How dt changes where single iterations (`ngspring.descent`) help out.

    Updates with dt below ``follow`` are converged ones: they follow the flow of the design, which
    decides to which of several optima it leads. A rejected attempt is repeated as a single
    iteration, which must be ``good``, then with a smaller dt, and so on; after a single iteration
    the order is the other one. Above ``follow`` two attempts of three are single iterations, with
    a smaller dt each, and need only bring the ``least``; the third is a converged one.

    Parameters
    ----------
    converged : StepRule
        For the updates that are iterated to convergence; with ``end``, ``smallest``, ``shrink``.
    follow : float
        See above; in units of the paper's domain.
    good : tuple of float
        Decreases of C over the expected one between which the quadratic model is good. Then dt
        grows: by ``growth[k]`` after k updates in a row that were accepted at once, by the last of
        them after more.
    growth : tuple of float
        See above.
    least : float
        See above.
    fair : float
        Where the model is not good, dt stays as it is, but below this ratio it is halved.
    settled : float
        Relative residual of Eq. 8 from which on, if the model is good, the transient term is left
        out and the system iterated to the end.
    """

    converged: StepRule = StepRule()
    follow: float = 1e10
    good: tuple[float, float] = (0.8, 1.25)
    growth: tuple[float, ...] = (1.0, 1.5, 2.0, 5.0)
    least: float = 0.2
    fair: float = 0.4
    settled: float = 1e-4

    def grown(self, dt: float, ratio: float, optimality: float, calm: int) -> float:
        """Next dt after an accepted single iteration; infinite if the final update is due.

        Parameters
        ----------
        dt, ratio, optimality : float
        calm : int
            How many updates in a row, this one included, were accepted at once.
        """
        if not self.good[0] < ratio < self.good[1]:
            return dt if ratio > self.fair else dt / 2
        if calm and optimality < self.settled:
            return np.inf
        return dt * self.growth[min(calm, len(self.growth) - 1)]


def time_unit(problem: SpringProblem) -> float:
    """Size of the domain's volume relative to the paper's 10^4 mm^3; pseudo-time scales with it."""
    if problem.axisymmetric:
        return float(np.pi * (problem.L / 2) ** 2 * problem.H / 1e4)
    return problem.L * problem.H * problem.T / 1e4
