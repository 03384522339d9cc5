"""C4 and A3 of solids with nu = 0.4 to 0.499 and one Young's modulus, beside each other.

From the campaign incompressible.toml. Each design is remodelled as a solid with real contact, whose
forces are compared with the targets. Numbers go to results/incompressible.json, the picture to
figures/incompressible.png. A minute for each on one core.

    ngspring campaign examples/materials/incompressible.toml --out incompressible
    python examples/materials/incompressible.py incompressible [--threads N]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evaluation import parsed, parser, write_numbers

from ngspring import Design
from ngspring.basics.errors import DesignFileError
from ngspring.evolution.folder import DESIGN
from ngspring.problem.material import young_and_poisson
from ngspring.solid.contact.response import contact_load_displacement
from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.view.design import draw_design
from ngspring.view.figure import SMALL, new_figure, save_figure
from ngspring.view.text import width_symbol

CASES, RATIOS = ("C4", "A3"), ("0.4", "0.45", "0.49", "0.499")


def load(folder: Path, name: str) -> Design | None:
    """The design of a run, None if there is none."""
    try:
        return Design.load(folder / name / DESIGN)
    except DesignFileError as error:
        print(error)
        return None


def evaluated(design: Design, threads: int | None) -> dict[str, Any]:
    """W/H and the forces of the solid at the control points."""
    points = design.problem.control_points
    curve = contact_load_displacement(mesh_body(design), [p.d for p in points], threads=threads)
    forces = dict(zip(map(float, curve.d), map(float, curve.q), strict=True))
    return {
        "nu": round(young_and_poisson(design.problem.K, design.problem.G)[1], 6),
        "width": round(design.relative_width, 6),
        "d": [point.d for point in points],
        "target": [point.q for point in points],
        "solid": [forces.get(point.d) for point in points],
    }


def draw(designs: dict[str, Design | None], known: dict[str, Any], path: Path) -> None:
    """A row for each case, a column for each Poisson's ratio."""
    cases = [case for case in CASES if any(name.startswith(case) for name in known)]
    figure = new_figure(2.3 * len(RATIOS), 2.8 * len(cases))
    panels = figure.subplots(len(cases), len(RATIOS), squeeze=False)
    for row, case in zip(panels, cases, strict=True):
        for axes, nu in zip(row, RATIOS, strict=True):
            design = designs[f"{case}-nu{nu}"]
            axes.set_axis_off()
            if design is None:
                axes.set_title(f"{case}, ν = {nu}: not computed", fontsize=SMALL)
                continue
            draw_design(axes, design)
            ratio = f"{width_symbol(design.problem)} = {design.relative_width:.3f}"
            found = known[f"{case}-nu{nu}"]
            solid = ", ".join(
                "-" if q is None else f"{100 * (q / target - 1):+.1f} %"
                for q, target in zip(found["solid"], found["target"], strict=True)
            )
            axes.set_title(f"{case}, ν = {nu}, {ratio}\nsolid: {solid}", fontsize=SMALL)
    save_figure(figure, path)


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    made = parser(__doc__)
    made.add_argument("folder", type=Path, help="of the campaign")
    given, results, figures = parsed(made, arguments)
    names = [f"{case}-nu{nu}" for case in CASES for nu in RATIOS]
    designs = {name: load(given.folder, name) for name in names}
    known = {
        name: evaluated(design, given.threads)
        for name, design in designs.items()
        if design is not None
    }
    write_numbers(results / "incompressible.json", known)
    draw(designs, known, figures / "incompressible.png")
    return known


if __name__ == "__main__":
    main()
