"""Export of a design and its deformed states for ParaView."""

from __future__ import annotations

import meshio
import numpy as np

from ngspring.analysis.states import Responses, by_offset, full_displacement
from ngspring.basics.arrays import FloatArray
from ngspring.basics.files import PathLike, replacing
from ngspring.design.design import Design


def write_vtu(path: PathLike, design: Design, response: Responses) -> None:
    """Write the whole spring as a .vtu file: chi, rho and displacements as point data.

    The points are the vertices, edge middles and centres of the N x N mesh, joined by linear
    quadrilaterals. Each displacement of the response becomes a vector ``displacement_10mm`` (and
    ``displacement_20mm_eta2`` for an offset of chi), ready for ParaView's *Warp By Vector*.

    Parameters
    ----------
    path : path
        File to write, atomically.
    design : Design
    response : Response, or mapping from eta to Response
        Deformed states; one field per displacement other than 0.

    Raises
    ------
    RunFolderError
        If the file cannot be written.
    """
    problem = design.problem
    nodes = 2 * problem.elements + 1
    x, y = np.meshgrid(
        np.linspace(0, problem.L, nodes), np.linspace(0, problem.H, nodes), indexing="ij"
    )
    number = np.arange(nodes**2).reshape(nodes, nodes)
    quads = np.stack(
        [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1
    ).reshape(-1, 4)
    data: dict[str, FloatArray] = {
        "chi": design.chi(x, y).ravel(),
        "rho": design.density(x, y).ravel(),
    }
    for eta, reached in by_offset(response).items():
        for k, d in enumerate(reached.d):
            if d != 0.0:
                u = full_displacement(reached, k).reshape(2, -1)
                suffix = f"_eta{eta:g}" if eta else ""
                vectors = np.column_stack([u[0], u[1], np.zeros(nodes**2)])
                data[f"displacement_{d:g}mm{suffix}"] = vectors
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(nodes**2)])
    mesh = meshio.Mesh(points, [("quad", quads)], point_data=data)
    with replacing(path) as temporary:
        meshio.write(temporary, mesh, file_format="vtu")
