"""What a limit of strains costs, and what robust = 0.2 changes: from the campaign limits.toml.

For every run with a `stretch_limit` the solid's own measure (the stretch that a thousandth of its
volume exceeds, by real contact at the control points) stands beside the limit, and W/H over the
limit is drawn in figures/limits.png. For C4, C7, T3 and A3 the largest change of force per mm of
offset at a control point, with and without `robust`. Both go to results/limits.json.
Runs that have not changed are skipped; a minute for each on one core.

    ngspring campaign examples/paper/limits.toml --out limits
    python examples/paper/limits_and_tolerances.py limits [--threads N]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gallery_results import HERE, PICTURES, fingerprint, read

from ngspring import Design
from ngspring.basics.errors import DesignFileError
from ngspring.basics.files import write_text
from ngspring.evolution.folder import DESIGN
from ngspring.solid.contact.response import contact_load_displacement
from ngspring.solid.mesh.mesh_body import mesh_body
from ngspring.solid.tolerance import tolerance
from ngspring.view.figure import save_figure
from ngspring.view.limits import limits_figure

#: Surfaces are moved by this many mm in and out.
OFFSET = 0.2


def strains(design: Design, threads: int | None) -> dict[str, Any]:
    """The limit of a design, and what its solid has."""
    controls = [point.d for point in design.problem.control_points if point.own]
    curve = contact_load_displacement(mesh_body(design), controls, threads=threads)
    return {
        "limit": design.problem.stretch_limit or None,
        "stretch_measure": float(curve.stretch_measure.max()) if curve.complete else None,
        "largest_stretch": float(curve.largest_stretch.max()) if curve.complete else None,
    }


def bands(design: Design, threads: int | None) -> dict[str, Any]:
    """How much the force at each control point changes with an offset, in N."""
    found = tolerance(design, (OFFSET,), points=2, threads=threads)
    widths = [high - low for low, high in zip(*found.band(OFFSET), strict=True)]
    by_place = dict(zip(map(float, found.displacements), widths, strict=True))
    return {"bands": [[point.d, float(by_place[point.d])] for point in found.points]}


def evaluated(folder: Path, threads: int | None) -> dict[str, Any] | None:
    """What is known of a run, None if it is not finished."""
    try:
        design = Design.load(folder / DESIGN)
    except DesignFileError as error:
        print(f"{folder.name}: {error}")
        return None
    if not design.info.get("converged", False):
        print(f"{folder.name}: not converged")
        return None
    mark = {"design": fingerprint(design), "width": round(design.relative_width, 6)}
    known: dict[str, Any] = read("limits").get(folder.name, {})
    if known.get("design") == mark["design"]:
        return known
    found = {} if "-robust" in folder.name else strains(design, threads)
    plain = "robust" in folder.name or "plain" in folder.name or folder.name.endswith("=0.0")
    if plain and not folder.name.startswith(("T6", "CT5")):
        found |= bands(design, threads)
    return mark | found


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="of the campaign")
    parser.add_argument("--threads", type=int, default=1, help="threads to use (default: 1)")
    given = parser.parse_args(arguments)
    for folder in sorted(path for path in given.folder.iterdir() if path.is_dir()):
        print(f"{folder.name}:", flush=True)
        found = evaluated(folder, given.threads)
        if found is not None:
            known = read("limits") | {folder.name: found}
            text = json.dumps(dict(sorted(known.items())), indent=1) + "\n"
            write_text(HERE / "results" / "limits.json", text)
    save_figure(limits_figure(by_case(read("limits"))), PICTURES / "limits.png")
    return read("limits")


def by_case(known: dict[str, Any]) -> dict[str, list[tuple[float | None, float, float]]]:
    """Limit (None for none), W/H and the solid's measure by case, from the loosest limit on."""
    cases: dict[str, list[tuple[float | None, float, float]]] = {}
    for name, found in known.items():
        if found.get("stretch_measure") and "-limit" in name:
            point = (found["limit"], found["width"], found["stretch_measure"])
            cases.setdefault(name.split("-")[0], []).append(point)
    return {name: sorted(points, key=lambda p: -(p[0] or 1e9)) for name, points in cases.items()}


if __name__ == "__main__":
    main()
