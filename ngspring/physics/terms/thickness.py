"""Walls and gaps that can be made: thicknesses of solid and void, measured by chi itself.

The slope of chi is at most 8 / l_i (Eq. 11). Where chi is 4 w / l_i the surface is w/2 away at
least, and a disc of diameter w fits in the solid. On the middle line of a wall chi has no slope
across it: there it is held beyond that number, and on the middle lines of gaps on the other side.
So nothing is asked of surfaces and corners, nor of equilibria. Where walls and gaps are thick
enough, and neither is grey, the terms are zero; grey at the end of a slit or in a pocket is a thin
wall and a thin gap to them.

Bounds on middle lines, found by their small slope, are an idea of Zhou, Lazarov, Wang and Sigmund
(2015), Comput. Methods Appl. Mech. Engrg. 293, 266-282, there in terms of filtered densities.
"""

from __future__ import annotations

from typing import ClassVar

import ngsolve as ng

from ngspring.physics.brackets import bracket, power
from ngspring.physics.chi import CF, smooth_step
from ngspring.physics.terms.base import Fields, Term
from ngspring.problem.spring import SpringProblem

#: With this share of its largest slope chi is on no middle line any more. So the tip of a wedge of
#: more than 60 degrees is a corner, and nothing that is too thin.
_MIDDLE = 0.5
#: A middle line whose chi is this far on the other side is none: its grey has a density of 0.27.
_FAINT = 1.0


def _too_thin(chi: CF, fields: Fields, size: float, problem: SpringProblem) -> CF:
    """k_w M <1 - (2 |grad chi| l_i/8)^2>^3 (1 - S(chi l_i / (4 size))), with smooth steps S and M.

    M is 0 where chi < -1, which is the other side, and 1 where chi > 0.
    """
    steepest = 8 / problem.l_i
    slope = ng.InnerProduct(fields.grad_chi, fields.grad_chi) / (_MIDDLE * steepest) ** 2
    on_middle = power(bracket(1 - slope), 3)
    here, thick = smooth_step(1 + chi / _FAINT), smooth_step(chi / (steepest * size / 2))
    return problem.k_w * on_middle * here * (1 - thick)


class ThinWalls(Term):
    """Middle lines of the solid where chi is less than 4 wall / l_i."""

    name: ClassVar[str] = "walls"
    weight: ClassVar[str] = "k_w"
    asked_by: ClassVar[str] = "wall"

    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        """Integrand, of chi."""
        return _too_thin(fields.chi, fields, problem.wall, problem)


class ThinGaps(Term):
    """Middle lines of the void where -chi is less than 4 gap / l_i."""

    name: ClassVar[str] = "gaps"
    weight: ClassVar[str] = "k_w"
    asked_by: ClassVar[str] = "gap"

    def density(self, fields: Fields, problem: SpringProblem) -> CF:
        """The same of -chi."""
        return _too_thin(-fields.chi, fields, problem.gap, problem)
