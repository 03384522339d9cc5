"""What the gallery's runs over coarse meshes came to, beside what was stored before there were any.

    ngspring campaign examples/paper/gallery.toml --out runs
    python examples/paper/ladder_of_gallery.py runs

keeps the outcome of every run that ended in results/ladder.json. Stored designs stay mostly: Fig. 3
shows how the evolution on one mesh converges, and a design that is the same need not be newer.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from gallery_results import HERE, read

from ngspring import Design, gallery
from ngspring.basics.files import write_text
from ngspring.design.history import stages
from ngspring.evolution.folder import DESIGN


def outcome(design: Design, stored: Design) -> dict[str, Any]:
    """C, W/H, Newton iterations by mesh, and how far the densities are apart, at most."""
    assert design.history is not None
    return {
        "start": design.info["start"],
        "C": design.history.last().C,
        "width": design.relative_width,
        "iterations": {
            str(mesh[0].elements): sum(row.iterations for row in mesh)
            for mesh in stages(design.history.rows())
        },
        "density": largest_difference(design, stored),
    }


def largest_difference(a: Design, b: Design) -> float:
    """Of the densities, over the elements' middles."""
    h = a.problem.h_x
    middles = h * (np.arange(a.problem.elements) + 0.5)
    rho = [design.density(middles[:, None], middles[None, :]) for design in (a, b)]
    return float(np.abs(rho[0] - rho[1]).max())


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", type=Path, help="folder of the campaign")
    folder = parser.parse_args().runs
    known = read("ladder")
    for name, stored in gallery.items():
        path = folder / name / DESIGN
        if path.exists() and (design := Design.load(path)).info["converged"]:
            known[name] = outcome(design, stored)
            print(name, known[name])
    text = json.dumps(dict(sorted(known.items())), indent=1) + "\n"
    write_text(HERE / "results" / "ladder.json", text)


if __name__ == "__main__":
    main()
