"""Names of the boundary pieces of a body's mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass


#: Names of the boundary pieces of a body's mesh on the sides of the meshed part of the domain.
SIDES = ("left", "right", "bottom", "top")


#: Name of all other boundary pieces: the free surface, the zero contour of chi.
SURFACE = "surface"
