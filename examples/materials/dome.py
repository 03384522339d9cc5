"""The rubber dome of a keyboard's key: its start, its curves, its numbers and its picture.

The third medium's curve and that of the solid with real contact stand beside the measured one.
Numbers go to results/dome.json, the picture to figures/dome.png.

    python examples/materials/dome.py            # evaluates results/dome.npz: some minutes
    python examples/materials/dome.py --design   # designs it anew before that: some minutes more
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from evaluation import HERE, parsed, parser, write_numbers

from ngspring import NO_LADDER, Design, SpringProblem, TargetCurve, optimize, read_curve, verify
from ngspring.analysis.states import force_at, index_of
from ngspring.basics.arrays import FloatArray
from ngspring.basics.files import finite_or_none
from ngspring.solid.verification import Verification
from ngspring.view.curves import draw_frame, draw_line
from ngspring.view.design import draw_design
from ngspring.view.figure import SMALL, new_figure, save_figure
from ngspring.view.solid import draw_body

PROBLEM, STORED = HERE / "dome.toml", HERE / "results" / "dome.npz"
UPDATES = 12  # after these the control points are met to four digits


def measured(problem: SpringProblem) -> TargetCurve:
    """The measured curve, compression negative."""
    return read_curve(HERE / "dome.csv", problem.H, problem.top_area)


def dome(problem: SpringProblem) -> Design:
    """The start: two domes foot to foot, each a cap with a stopper and a wall that leans outwards.

    chi falls by 4 / l_i per mm at the surface, half of an established interface, from 6 to -6.
    """
    height = problem.H / 2

    def chi(x: FloatArray, y: FloatArray) -> FloatArray:
        r, z = np.abs(x - problem.L / 2), np.minimum(y, problem.H - y)
        cap = np.minimum(1.2 - r, 1.8 - z)
        stopper = np.minimum(0.7 - r, height - 1.87 - 0.4 * r**2 - z)
        wall = 0.14 - distance(r, z, (1.3, 1.6), (1.7, height - 0.2))
        foot = np.minimum(0.3 - np.abs(r - 1.7), z - (height - 0.2))
        inside = np.max(np.broadcast_arrays(cap, stopper, wall, foot), axis=0)
        return np.clip(4 * inside / problem.l_i, -6, 6)

    return Design.from_function(problem, chi)


def distance(
    r: FloatArray, z: FloatArray, begin: tuple[float, float], end: tuple[float, float]
) -> FloatArray:
    """From points to a straight line between two points."""
    (r_0, z_0), (r_1, z_1) = begin, end
    a, b = r_1 - r_0, z_1 - z_0
    along = np.clip(((r - r_0) * a + (z - z_0) * b) / (a**2 + b**2), 0, 1)
    return np.hypot(r - r_0 - along * a, z - z_0 - along * b)


def designed(threads: int | None = None) -> Design:
    """The design after the first updates; coarser meshes do not resolve the wall.

    It meets its targets, but is no stationary point: further updates take material away.
    """
    problem = SpringProblem.from_toml(PROBLEM)
    start = dome(problem)
    found = optimize(problem, start, max_updates=UPDATES, threads=threads, ladder=NO_LADDER)
    return found.design


def numbers(design: Design, found: Verification, curve: TargetCurve) -> dict[str, Any]:
    """The measured curve, the third medium's and the solid's, and what a maker wants to know."""
    told = found.to_dict()
    kept = (
        "contact_starts",
        "largest_stretch",
        "stretch_measure",
        "smallest_wall",
        "smallest_gap_at_rest",
        "complete",
        "message",
        "remarks",
    )
    return {
        "converged": bool(design.info.get("converged")),
        "D/H": design.relative_width,
        "volume": design.volume,
        "d": [float(d) for d in curve.d],
        "measured": [float(q) for q in curve.q],
        "third_medium": [finite_or_none(force_at(found.third_medium, d)) for d in curve.d],
        "solid": [finite_or_none(force_at(found.contact, d)) for d in curve.d],
        **{name: told[name] for name in kept},
        "jumps": {
            "third_medium": [jump.d for jump in found.third_medium.jumps],
            "solid": [jump.d for jump in found.contact.jumps],
        },
    }


def draw(design: Design, found: Verification, curve: TargetCurve, path: Path) -> None:
    """The design, its solid at rest and compressed, and the three curves."""
    problem = design.problem
    places = [index_of(found.contact, d) for d in (-1.0, -3.0, -4.1)]
    states = [k for k in places if k is not None]
    figure = new_figure(2.1 * (1 + len(states)), 7.0)
    above, below = figure.subfigures(2, 1, height_ratios=(1.2, 1.25))
    panels = above.subplots(1, 1 + len(states), sharey=True)
    draw_design(panels[0], design)
    panels[0].set_title("design", fontsize=SMALL + 1)
    panels[0].set_ylabel("y [mm]")
    for axes, k in zip(panels[1:], states, strict=True):
        d = float(found.contact.d[k])
        draw_body(axes, found.body, found.contact.u[k], d)
        axes.set_title(f"solid, d = {d:g} mm", fontsize=SMALL + 1)
        for y in (0.0, problem.H + d):
            axes.axhline(y, color="0.3", linewidth=0.8)
    for axes in panels:
        axes.set(xlim=(0, problem.L), ylim=(-0.02 * problem.H, 1.02 * problem.H), xlabel="x [mm]")
        axes.set_aspect("equal")
    axes = below.subplots()
    draw_frame(axes)
    draw_line(axes, found.third_medium, color="black", linewidth=1.3, label="third medium")
    draw_line(axes, found.contact, color="0.4", linestyle="--", label="solid, real contact")
    axes.plot(curve.d, curve.q, "ko", markerfacecolor="none", label="measured")
    points = problem.control_points
    axes.plot([p.d for p in points], [p.q for p in points], "k.", label="control points")
    axes.grid(color="0.92")
    axes.legend(fontsize=SMALL)
    save_figure(figure, path)


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    made = parser(__doc__)
    made.add_argument("--design", action="store_true", help="design it anew")
    given, results, figures = parsed(made, arguments)
    if given.design:
        design = designed(given.threads)
        design.save(results / STORED.name)
    else:
        design = Design.load(STORED)
    curve = measured(design.problem)
    # The measured displacements, and between them enough for a smooth line.
    wanted = np.union1d(curve.d, np.round(np.linspace(curve.d[0], 0.0, 42), 6))
    found = verify(design, wanted, threads=given.threads)
    known = numbers(design, found, curve)
    write_numbers(results / "dome.json", known)
    draw(design, found, curve, figures / "dome.png")
    return known


if __name__ == "__main__":
    main()
