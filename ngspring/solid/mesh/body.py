"""The solid that a design stands for, as a body-fitted mesh (3.5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ngspring.problem.spring import SpringProblem

if TYPE_CHECKING:
    from ngspring.solid.mesh.quality import MeshQuality
    from ngspring.solid.mesh.triangles import TriangleMesh


@dataclass(frozen=True, eq=False)
class Body:
    """A body-fitted mesh of second-order curved triangles.

    The meshed part of the domain is that of `ngspring.fem.grid.Grid`: the lower left quarter
    ``[0, L/2] x [0, H/2]`` for ``problem.domain == "quarter"``; otherwise ``[0, L] x [0, H]``, and
    in the axisymmetric case its half left of the axis, ``[0, L/2] x [0, H]``.

    Attributes
    ----------
    problem : SpringProblem
        Material, size, kinematics and, in ``domain``, which part is meshed.
    mesh : ngsolve.Mesh
        In mm. `mesh_body` makes straight triangles whose second-order geometry is the mesh's
        deformation, ``mesh.deformation``. Its boundary pieces are named `SIDES` where the solid
        reaches a side of the meshed part (for the quarter "right" and "top" are the mirror lines,
        or the axis) and `SURFACE` elsewhere.
    level : float
        The solid is ``{chi > level}``.
    quality : MeshQuality, optional
        Measures of the mesh, if it was made by `ngspring.solid.mesh.mesh_body.mesh_body`.
    triangles : TriangleMesh, optional
        The same mesh as arrays: points, triangles of six nodes, boundary edges of three.
    """

    problem: SpringProblem
    mesh: Any
    level: float = 0.0
    quality: MeshQuality | None = None
    triangles: TriangleMesh | None = None
