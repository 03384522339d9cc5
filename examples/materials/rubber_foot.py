"""A rubber foot of 40 x 40 x 15 mm, from tests of the rubber to a part: what its solid does.

    ngspring fit treloar-uniaxial.csv --planar treloar-planar.csv --law ogden-1 --nu 0.49 \\
        --stretches 1.1,2.5 --write natural-rubber.toml
    ngspring targets rubber-foot.csv --length 40 --height 40 --thickness 15 --elements 40 \\
        --material natural-rubber.toml --write rubber-foot.toml
    # more in that file: stretch_limit, imperfection, and two dilated control points
    ngspring optimize rubber-foot.toml --part --initial rubber-foot-start.npz --ladder off
    python rubber_foot.py runs/rubber-foot-part

The last line computes the solid with real contact, perfect and with surfaces moved by 0.15 mm, and
where its symmetric path loses its stability. The design, its report, the part as a STEP file and
the numbers go to results/, a picture to figures/.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evaluation import parsed, parser, write_numbers

from ngspring import (
    Design,
    Imperfection,
    Stability,
    Verification,
    export_body,
    imperfection,
    stability,
    verify,
)
from ngspring.analysis.states import index_of
from ngspring.evolution.folder import DESIGN
from ngspring.view.curves import draw_frame, draw_line
from ngspring.view.figure import SMALL, new_figure, save_figure
from ngspring.view.report import write_report
from ngspring.view.solid import draw_body, draw_pressure, edge_pressure

NAME = "rubber-foot"
#: How far surfaces are moved, in mm: as much as the design was made for.
SIZE = 0.15


def numbers(found: Verification, moved: Imperfection, paths: Stability) -> dict[str, Any]:
    """What is told of the part: forces, strain, walls and gaps, imperfection and stability."""
    told = found.to_dict()
    own = [point for point in found.design.problem.control_points if point.own]
    measures = ("stretch_measure", "smallest_wall", "smallest_gap_at_rest", "contact_starts")
    return {
        "width": round(found.design.relative_width, 6),
        "d": [point.d for point in own],
        "target": [point.q for point in own],
        "aim": [point.q_star for point in own],
        "solid": [verdict.q_contact for verdict in found.points],
        **{name: told[name] for name in measures},
        "imperfection": moved.to_dict(),
        "lowest_eigenvalue": float(min(paths.relative)),
        "loses_stability_at": [critical.d for critical in paths.critical],
        "curve": told["curve"],
    }


def draw(found: Verification, moved: Imperfection, path: Path) -> None:
    """The solid at rest and in its deepest state, and its curves."""
    problem, contact = found.design.problem, found.contact
    figure = new_figure(10.2, 3.6)
    rest, pressed, curves = figure.subplots(1, 3, width_ratios=[1, 1, 1.2])
    draw_body(rest, found.body)
    rest.set_title("at rest", fontsize=SMALL + 1)
    deepest = min(point.d for point in problem.control_points)
    k = index_of(contact, deepest)
    if k is not None:
        draw_body(pressed, found.body, contact.u[k], deepest)
        if largest := float(edge_pressure(contact).max(initial=0.0)):
            draw_pressure(pressed, contact, k, largest)
    pressed.set_title(f"d = {deepest:g} mm, with contact pressure", fontsize=SMALL + 1)
    for axes in (rest, pressed):
        axes.set_xlim(-0.05 * problem.L, 1.05 * problem.L)
        axes.set_ylim(-0.05 * problem.H, 1.05 * problem.H)
        axes.set_xlabel("mm", fontsize=SMALL)
        axes.tick_params(labelsize=SMALL - 1)
    draw_frame(curves)
    draw_line(curves, found.third_medium, color="0.55", linestyle="--", label="third medium")
    draw_line(curves, contact, color="black", label="solid, real contact")
    label = f"the same, surfaces moved by up to {moved.size:g} mm"
    draw_line(curves, moved.imperfect, color="0.35", linestyle=":", linewidth=2.2, label=label)
    own = [point for point in problem.control_points if point.own]
    curves.plot(
        [p.d for p in own], [p.q for p in own], "o", color="black", mfc="none", label="wanted"
    )
    curves.legend(fontsize=SMALL, loc="lower right")
    save_figure(figure, path)


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    made = parser(__doc__)
    made.add_argument("folder", type=Path, help="of the finished run")
    given, results, figures = parsed(made, arguments)
    part = Design.load(given.folder / DESIGN)
    part.save(results / f"{NAME}.npz")
    export_body(part, results / f"{NAME}.step")
    write_report(part, results / f"{NAME}.html")
    found = verify(part, threads=given.threads)
    moved = imperfection(part, SIZE, perfect=found.contact, threads=given.threads)
    paths = stability(part, threads=given.threads)
    known = numbers(found, moved, paths)
    write_numbers(results / f"{NAME}.json", known)
    draw(found, moved, figures / f"{NAME}.png")
    return known


if __name__ == "__main__":
    main()
