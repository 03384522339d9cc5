"""Offsets of chi (2.6) as an expression of NGSolve whose numbers can be changed."""

from __future__ import annotations

from collections.abc import Iterable

import ngsolve as ng

from ngspring.physics.chi import CF
from ngspring.problem.imperfection import Offset, odd_pattern
from ngspring.problem.spring import SpringProblem


class OffsetField:
    """An `Offset` that enters forms as a coefficient.

    Parameters
    ----------
    problem : SpringProblem
    odd_in : iterable of str
        The kinds of patterns that will be set, see `ngspring.problem.imperfection.ODD_IN`.

    Attributes
    ----------
    value : ngsolve.CoefficientFunction
    """

    def __init__(self, problem: SpringProblem, odd_in: Iterable[str] = ()) -> None:
        self._eta = ng.Parameter(0.0)
        self._odd = {kind: ng.Parameter(0.0) for kind in dict.fromkeys(odd_in)}
        self.value: CF = self._eta
        for kind, factor in self._odd.items():
            pattern = odd_pattern(ng.x, ng.y, problem.L, problem.H, kind, ng.sin)
            self.value = self.value + factor * pattern

    def set(self, offset: Offset) -> None:
        """Give it the numbers of an offset."""
        self._eta.Set(offset.eta)
        for kind, factor in self._odd.items():
            factor.Set(offset.odd if kind == offset.odd_in else 0.0)
