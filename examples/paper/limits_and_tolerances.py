"""What stretch_limit, robust, wall and gap change: from the campaign limits.toml.

Of every run's solid, computed with real contact: the stretch that a thousandth of its volume
exceeds at the control points, its smallest wall and gap at rest. Of the runs with `robust`, and of
the plain ones beside them, also how far the force at each control point moves when all surfaces lie
0.2 mm further in or out. Numbers go to results/limits.json, which the results page shows as tables,
and W/H over the limit is drawn in figures/limits.png.

Runs that have not changed are skipped; a minute or two for each on one core.

    ngspring campaign examples/paper/limits.toml --out limits
    python examples/paper/limits_and_tolerances.py limits [--threads N]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gallery_results import HERE, PICTURES, fingerprint, read

from ngspring import Design
from ngspring.basics.errors import NgspringError
from ngspring.basics.files import finite_or_none, write_text
from ngspring.evolution.folder import DESIGN
from ngspring.problem.point import worst_deviation
from ngspring.solid.contact.response import ContactResponse, contact_load_displacement
from ngspring.solid.mesh.body import Body
from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.solid.tolerance import tolerance
from ngspring.view.figure import save_figure
from ngspring.view.limits import LimitedDesign, limits_figure

#: Surfaces are moved by this many mm in and out.
OFFSET = 0.2
#: A design whose forces are further from its targets, as a share, is another spring.
MET = 1e-3
#: What else a design may be asked for.
ASKED = ("limit", "wall", "gap")
#: The cases with a run with `robust`; a design without a limit is the plain one beside it.
ROBUST = ("C4", "C7", "T3", "A3")


def outcome(design: Design) -> dict[str, Any]:
    """What is known of a run without computing anything."""
    problem, history = design.problem, design.history
    offsets = {round(p.eta * problem.l_i / 8, 6) for p in problem.control_points if not p.own}
    return {
        "case": problem.name,
        "limit": problem.stretch_limit or None,
        "wall": problem.wall or None,
        "gap": problem.gap or None,
        "offsets": sorted(offsets),
        "converged": bool(design.info.get("converged", False)),
        "updates": 0 if history is None else len(history) - 1,
        "deviation": worst_deviation(problem.control_points, design.info["q"]),
        "width": round(design.relative_width, 6),
    }


def strains(curve: ContactResponse | None) -> dict[str, Any]:
    """Stretches of a solid over its control points; nothing if it did not reach them."""
    if curve is None or not curve.complete:
        return {"stretch_measure": None, "largest_stretch": None}
    return {
        "stretch_measure": float(curve.stretch_measure.max()),
        "largest_stretch": float(curve.largest_stretch.max()),
    }


def walls(body: Body) -> dict[str, Any]:
    """Smallest wall and gap of the undeformed solid in mm, as `ngspring verify` tells them."""
    quality = body.quality
    assert quality is not None  # the mesh was made here
    return {
        "smallest_wall": finite_or_none(quality.thinnest_wall),
        "smallest_gap_at_rest": finite_or_none(quality.narrowest_gap),
    }


def with_bands(design: Design, threads: int | None) -> dict[str, Any]:
    """Stretches, and the force at each control point with surfaces further in, as is and out."""
    found = tolerance(design, (OFFSET,), points=2, threads=threads)
    forces = [
        [point.d, *(finite_or_none(curve.q(point.d)) for curve in found.curves)]
        for point in found.points
    ]
    return {**strains(found.nominal.contact), "forces": forces}


def computed(design: Design, known: Mapping[str, Any], threads: int | None) -> dict[str, Any]:
    """What takes the solid of a run of which this `outcome` is known."""
    body, offsets = mesh_body(design), set(known["offsets"])
    bare = not any(known[key] for key in ASKED)
    if known["case"] in ROBUST and bare and offsets <= {-OFFSET, OFFSET}:
        return {**walls(body), **with_bands(design, threads)}
    controls = [point.d for point in design.problem.control_points if point.own]
    curve = contact_load_displacement(body, controls, threads=threads)
    return {**walls(body), **strains(curve)}


def evaluated(folder: Path, threads: int | None) -> dict[str, Any] | None:
    """What is known of a run, None if it has no design or its design is no solid."""
    try:
        design = Design.load(folder / DESIGN)
        mark = {"design": fingerprint(design), **outcome(design)}
        known: dict[str, Any] = read("limits").get(folder.name, {})
        if known.get("design") == mark["design"]:
            return known | mark
        print(f"{folder.name}:", flush=True)
        return mark | computed(design, mark, threads)
    except NgspringError as error:
        print(f"{folder.name}: {error}")
        return None


def by_case(known: dict[str, Any]) -> dict[str, list[LimitedDesign]]:
    """The designs of every case that has one with a limit, of those that can be compared.

    That is: which converged, and meet their targets.
    """
    cases: dict[str, list[LimitedDesign]] = {}
    for found in known.values():
        met = found["converged"] and abs(found["deviation"]) < MET
        of_limit = not (found["offsets"] or found["wall"] or found["gap"])
        if met and found["stretch_measure"] and of_limit:
            design = LimitedDesign(found["limit"], found["stretch_measure"], found["width"])
            cases.setdefault(found["case"], []).append(design)
    return {case: designs for case, designs in cases.items() if any(d.limit for d in designs)}


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="of the campaign")
    parser.add_argument("--threads", type=int, default=1, help="threads to use (default: 1)")
    given = parser.parse_args(arguments)
    for folder in sorted(path for path in given.folder.iterdir() if (path / DESIGN).is_file()):
        found = evaluated(folder, given.threads)
        if found is not None:
            known = read("limits") | {folder.name: found}
            text = json.dumps(dict(sorted(known.items())), indent=1) + "\n"
            write_text(HERE / "results" / "limits.json", text)
    save_figure(limits_figure(by_case(read("limits"))), PICTURES / "limits.png")
    return read("limits")


if __name__ == "__main__":
    main()
