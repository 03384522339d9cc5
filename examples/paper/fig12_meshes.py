"""Fig. 12: body-fitted meshes of the lower left quarters of C1, C4, C7, T2, T3 and T6.

Second-order triangles whose edges follow chi = 0, at least four across every wall, finer where the
surface is strongly curved (`ngspring.solid.mesh.mesh_body`). The paper's meshes are Gmsh's, ours
Netgen's.

Numbers to expect: the area of each mesh is that of {chi > 0} within 0.01 %, and no element is
turned inside out.
"""

from __future__ import annotations

from designs import Numbers, Options, load_designs, save

from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.view.solid import meshes_figure

NAMES = ("C1", "C4", "C7", "T2", "T3", "T6")


def draw(options: Options) -> Numbers:
    designs = load_designs(NAMES, options)
    bodies = {name: None if d is None else mesh_body(d) for name, d in designs.items()}
    numbers: Numbers = {}
    for name, body in bodies.items():
        if body is None or body.quality is None:
            continue
        quality = body.quality
        numbers[name] = {
            "elements": quality.elements,
            "across": quality.elements_across,
            "smallest angle": quality.smallest_angle,
            "area error": quality.area_error,
        }
    save(meshes_figure(bodies), options, "fig12")
    return numbers
