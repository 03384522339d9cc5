"""What every kinematics says about a spring."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Literal, TypeAlias

#: A number, an array or a coefficient function of NGSolve: only arithmetic is done with it.
Value: TypeAlias = Any


class Kinematics(ABC):
    """How displacements in the x-y plane deform a body in space, and what a place stands for.

    The plane carries the coordinates x, across the load from the left side of the full domain,
    and y, along the load. Formulas use arithmetic only, so that they serve numbers, arrays and
    NGSolve's coefficient functions alike.

    Attributes
    ----------
    name : str
        As in a problem's ``kinematics``.
    width_name : str
        Letter of the equivalent width.
    across, width_word : str
        What L is, and what the equivalent width is called, in words.
    larger : str
        What gives a full block more force, in words.
    thick : bool
        Whether the thickness T counts.
    axis : bool
        Whether x = L/2 is the axis of a body of revolution: only the half left of it is a place
        of the plane, and nothing can pass through the axis.
    sweep : {"extruded", "revolved"}
        What makes the solid out of the plane figure.
    """

    name: ClassVar[str]
    width_name: ClassVar[str]
    across: ClassVar[str]
    width_word: ClassVar[str]
    larger: ClassVar[str]
    thick: ClassVar[bool]
    axis: ClassVar[bool]
    sweep: ClassVar[Literal["extruded", "revolved"]]

    @abstractmethod
    def measure(self, x: Value, L: float, T: float) -> Value:
        """Volume of the body per area of the plane, in mm, at places x in mm.

        A number where it is the same everywhere.
        """

    @abstractmethod
    def F_33(self, u_x: Value, x: Value, L: float) -> Value:
        """Stretch out of the plane for a displacement u_x in mm at a place x in mm."""

    @abstractmethod
    def delta_F_33(self, v_x: Value, x: Value, L: float) -> Value | None:
        """Variation of `F_33` for a variation v_x of u_x; None if it is always zero."""

    @abstractmethod
    def top_area(self, L: float, T: float) -> float:
        """Area of the loaded top side in mm^2."""

    @abstractmethod
    def equivalent_width(self, volume: float, H: float, T: float) -> float:
        """Width or diameter in mm of the straight bar of this volume (mm^3) and height."""

    @abstractmethod
    def free_stretches(self, transverse: Value) -> tuple[Value, Value]:
        """Stretches in x and out of the plane of a uniform bar whose sides are free."""

    @abstractmethod
    def bending_stiffness(self, width: float, T: float, E: float, nu: float) -> float:
        """Bending stiffness in N mm^2 of a straight bar of this width or diameter in mm."""

    def volume(self, L: float, H: float, T: float) -> float:
        """Volume of the full domain in mm^3."""
        return self.top_area(L, T) * H
