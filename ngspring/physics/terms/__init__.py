"""The terms of the objective C beside the control points'; a new one is a file and a line here."""

from __future__ import annotations

from ngspring.physics.terms.base import Term
from ngspring.physics.terms.curvature import Curvature
from ngspring.physics.terms.energy_limit import EnergyLimit
from ngspring.physics.terms.interface import Interface
from ngspring.physics.terms.stretch_limit import StretchLimit
from ngspring.physics.terms.thickness import ThinGaps, ThinWalls
from ngspring.physics.terms.volume import Volume

#: In the order of Eq. 11, which is that of the history's columns; then what is not in the paper.
TERMS: tuple[Term, ...] = (
    Volume(),
    Interface(),
    Curvature(),
    ThinWalls(),
    ThinGaps(),
    StretchLimit(),
    EnergyLimit(),
)
