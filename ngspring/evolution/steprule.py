"""How the pseudo-time step of the evolution changes (2.7), and when it leaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ngspring.design.history import Row

Rows = Sequence[Row]


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
        A failed update is repeated with dt divided by this ...
    search : bool
        ... and where the end has failed, by its second, third, ... power: nothing tells how far
        below the end the largest possible dt is.
    end : float
        The transient term is removed when dt exceeds this ...
    rest : float
        ... or this, after an update of at most ``still`` Newton iterations: nothing moves any more.
    still : int
        See above.
    smallest : float
        Give up below this dt. All three in units of the paper's domain, see `time_unit`.
    """

    few: int = 6
    growth: float = 2.0
    easy_growth: float = 5.0
    easy: int = 3
    shrink: float = 4.0
    search: bool = True
    end: float = 1e20
    rest: float = 1e14
    still: int = 2
    smallest: float = 1e-8

    def at_rest(self, dt: float, iterations: int, rejected: int = 0) -> bool:
        """Whether nothing moves any more, after an accepted update (dt in `time_unit`)."""
        return iterations <= self.still and dt >= self.rest and not rejected

    def end_is_due(self, dt: float, iterations: int, rejected: int = 0) -> bool:
        """Whether the transient term is removed after an accepted update (dt in `time_unit`)."""
        later = self.grown(dt, iterations, rejected)
        return self.at_rest(dt, iterations, rejected) or later > self.end

    def grown(self, dt: float, iterations: int, rejected: int = 0) -> float:
        """Next dt after an accepted update that took so many Newton iterations.

        Right after ``rejected`` attempts with a larger dt there is no easy growth: the limit is
        near.
        """
        if iterations <= self.easy and not rejected:
            return dt * self.easy_growth
        return dt * self.growth if iterations < self.few else dt

    def shrunk(self, dt: float, searches: int = 0) -> float:
        """Next dt after a failed update, the n-th since the end failed; 0 if it has not."""
        return dt / self.shrink ** (max(1, searches) if self.search else 1)


PAPER_RULE = StepRule(easy=0, rest=np.inf, search=False)


@dataclass(frozen=True)
class LeapRule:
    """How dt and the leaps (`ngspring.evolution.leaps`) change.

    Updates are converged ones, dt as in `StepRule`, as long as it grows. Where it has not reached a
    new largest value for some time, it is not raised to what failed lately, and a leap comes
    before every second update.

    Parameters
    ----------
    converged : StepRule
    patience : int
        Updates in a row without a new largest dt before leaps begin.
    memory : int
        For so many updates a dt that failed is not tried again.
    first : float
        Length of the first leap, in multiples of dt.
    growth : float
        By this factor the next one is longer after a leap that was good; half as long after
        another.
    largest : float
        Longest leap. Where the next one would be longer, dt grows instead.
    smallest : float
        After a leap shorter than this failed, there is none for ``patience`` updates.
    iterations : int
        More Newton iterations than these after a leap are a failed one.
    """

    converged: StepRule = StepRule()
    patience: int = 10
    memory: int = 20
    first: float = 2.0
    growth: float = 1.4
    largest: float = 10.0
    smallest: float = 0.5
    iterations: int = 7

    def creeping(self, rows: Rows) -> bool:
        """Whether dt has stopped growing."""
        steps = [row.dt for row in rows]
        return len(steps) - 1 - int(np.argmax(steps)) >= self.patience

    def factor(self, rows: Rows) -> float:
        """Length of the leap that is due in multiples of dt; 0 if none is."""
        last = rows[-1]
        if not self.creeping(rows) or not last.dt > 0.0 or last.leap != 0.0:
            return 0.0
        for row in rows[: -self.patience - 1 : -1]:
            if row.leap:
                tried = row.dt * self.converged.shrink**row.failed
                factor = abs(row.leap) / tried * (self.growth if row.leapt else 0.5)
                return min(factor, self.largest) if factor >= self.smallest else 0.0
        return self.first

    def held(self, rows: Rows, dt: float, grown: float) -> float:
        """Next dt after a converged update, if ``grown`` is what its iterations allow."""
        if not self.creeping(rows):
            return grown
        failed = [row.dt * self.converged.shrink for row in rows[-self.memory :] if row.failed]
        return grown if grown < min(failed, default=np.inf) else dt


Rule = StepRule | LeapRule
