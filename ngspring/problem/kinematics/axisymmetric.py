"""Axisymmetric deformation (section 3.4, Eq. 21): a body of revolution about x = L/2."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from ngspring.problem.kinematics.base import Kinematics, Value


class Axisymmetric(Kinematics):
    """A body of revolution of diameter L; the plane is its section left of the axis."""

    name: ClassVar[str] = "axisymmetric"
    width_name: ClassVar[str] = "D"
    across: ClassVar[str] = "diameter"
    width_word: ClassVar[str] = "diameter"
    larger: ClassVar[str] = "a larger diameter"
    thick: ClassVar[bool] = False
    axis: ClassVar[bool] = True
    sweep: ClassVar[Literal["extruded", "revolved"]] = "revolved"

    @staticmethod
    def radius(x: Value, L: float) -> Value:
        """r in mm; the plane lies left of the axis, so u_r = -u_x."""
        return L / 2 - x

    def measure(self, x: Value, L: float, T: float) -> Value:
        """2 pi r (Eq. 24)."""
        return 2 * math.pi * self.radius(x, L)

    def F_33(self, u_x: Value, x: Value, L: float) -> Value:
        """1 + u_r / r (Eq. 21)."""
        return 1 - u_x / self.radius(x, L)

    def delta_F_33(self, v_x: Value, x: Value, L: float) -> Value | None:
        """v_r / r."""
        return -(v_x / self.radius(x, L))

    def top_area(self, L: float, T: float) -> float:
        """pi L^2 / 4."""
        return math.pi * L**2 / 4

    def equivalent_width(self, volume: float, H: float, T: float) -> float:
        """D of Eq. 25."""
        return math.sqrt(4 * volume / (math.pi * H))

    def free_stretches(self, transverse: Value) -> tuple[Value, Value]:
        """Free in both transverse directions."""
        return transverse, transverse

    def bending_stiffness(self, width: float, T: float, E: float, nu: float) -> float:
        """Of a rod on the axis."""
        return E * math.pi / 64 * width**4
