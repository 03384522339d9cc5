"""Plane strain (Eq. 13): a prism of thickness T that cannot move out of the plane."""

from __future__ import annotations

from typing import ClassVar, Literal

from ngspring.problem.kinematics.base import Kinematics, Value


class PlaneStrain(Kinematics):
    """A prism between two rigid, frictionless walls."""

    name: ClassVar[str] = "plane strain"
    width_name: ClassVar[str] = "W"
    across: ClassVar[str] = "length across the load"
    width_word: ClassVar[str] = "width"
    larger: ClassVar[str] = "a larger T or L"
    thick: ClassVar[bool] = True
    axis: ClassVar[bool] = False
    sweep: ClassVar[Literal["extruded", "revolved"]] = "extruded"

    def measure(self, x: Value, L: float, T: float) -> Value:
        """The thickness T, everywhere."""
        return T

    def F_33(self, u_x: Value, x: Value, L: float) -> Value:
        """1 (Eq. 13)."""
        return 1.0

    def delta_F_33(self, v_x: Value, x: Value, L: float) -> Value | None:
        """None."""
        return None

    def top_area(self, L: float, T: float) -> float:
        """L T."""
        return L * T

    def equivalent_width(self, volume: float, H: float, T: float) -> float:
        """W of Eq. 20."""
        return volume / (H * T)

    def free_stretches(self, transverse: Value) -> tuple[Value, Value]:
        """Free in x only."""
        return transverse, 1.0

    def bending_stiffness(self, width: float, T: float, E: float, nu: float) -> float:
        """Of a plate."""
        return E / (1 - nu**2) * T * width**3 / 12
