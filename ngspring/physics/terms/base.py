"""What every term of the objective says."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from ngspring.physics.chi import CF
from ngspring.problem.spring import SpringProblem


@dataclass(frozen=True, eq=False)
class Fields:
    """What the density of a term may depend on, as expressions of NGSolve.

    Attributes
    ----------
    chi, grad_chi, hesse_chi : ngsolve.CoefficientFunction
        The design field; with the offset eta of a control point in a term of the displacements.
    u, grad_u : ngsolve.CoefficientFunction or None
        Displacements at a control point in mm; None for a term of the design alone.
    """

    chi: CF
    grad_chi: CF
    hesse_chi: CF
    u: CF | None = None
    grad_u: CF | None = None


class Term(ABC):
    """One term of C, the integral of a density over the whole spring.

    Attributes
    ----------
    name : str
        Column of the history.
    weight : str
        Field of `SpringProblem` that is its weight; the term is left out where that is zero and
        the term depends on u. The field knows its unit (`ngspring.problem.spring`).
    asked_by : str
        Field of `SpringProblem` that asks for the term, if its weight alone does not: the term is
        left out where that is zero.
    of_u : bool
        Whether the density depends on displacements: then it is integrated at every control
        point, and its derivative enters the adjoint equations (Eq. 7).
    quadratic : bool
        Whether it is quadratic in chi, so that its second derivative is assembled once.
    """

    name: ClassVar[str]
    weight: ClassVar[str]
    asked_by: ClassVar[str] = ""
    of_u: ClassVar[bool] = False
    quadratic: ClassVar[bool] = False

    @abstractmethod
    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        """Integrand, with its weight."""

    def active(self, problem: SpringProblem) -> bool:
        """Whether it is part of the objective."""
        if self.asked_by:
            return bool(getattr(problem, self.asked_by))
        return not self.of_u or bool(getattr(problem, self.weight))
