"""What the plane picture of a spring stands for; a new kinematics is a file and a line here."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ngspring.problem.kinematics.axisymmetric import Axisymmetric
from ngspring.problem.kinematics.base import Kinematics
from ngspring.problem.kinematics.plane_strain import PlaneStrain

#: By name, the default first.
KINEMATICS: Mapping[str, Kinematics] = MappingProxyType(
    {kinematics.name: kinematics for kinematics in (PlaneStrain(), Axisymmetric())}
)
