"""Is the symmetric load path of each stored design stable? (Point of view of the full domain.)

For every design of the gallery the lowest eigenvalue of the full domain's tangent is computed at
the control points and along the path between them, see `ngspring.analysis.stability`. The outcome
goes to examples/results/stability.json, which the results page shows; where a path loses its
stability the critical state and its mode are drawn in examples/figures/stability-NAME.png.

Designs that have not changed since are skipped. One to five minutes for each on one core.

    python examples/stability_of_gallery.py [NAME ...] [--threads N]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ngspring import Design, gallery
from ngspring.analysis.stability import Critical, Stability, stability
from ngspring.basics.files import write_text
from ngspring.cli.stability import stability_lines
from ngspring.view.figure import save_figure
from ngspring.view.stability import stability_figure

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "stability.json"


def fingerprint(design: Design) -> str:
    """Tells one design from another of the same name."""
    return f"{design.volume:.9e}"


def critical_record(critical: Critical) -> dict[str, Any]:
    mode = critical.mode
    return {
        "d": round(critical.d, 4),
        "q": round(critical.q, 6),
        "kind": mode.kind,
        "symmetry": mode.symmetry_text,
        "in_solid": round(mode.shares[0], 3),
    }


def record(design: Design, outcome: Stability) -> dict[str, Any]:
    lowest = min(outcome.relative)
    return {
        "design": fingerprint(design),
        "range": [float(outcome.d.min()), float(outcome.d.max())],
        "lowest": round(float(lowest), 6),
        "complete": outcome.complete,
        "critical": [critical_record(critical) for critical in outcome.critical],
    }


def read() -> dict[str, Any]:
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these designs")
    parser.add_argument("--threads", type=int, help="threads to use")
    given = parser.parse_args(arguments)
    known = read()
    for name in given.names or gallery:
        design = gallery[name]
        if known.get(name, {}).get("design") == fingerprint(design):
            continue
        outcome = stability(design, threads=given.threads)
        known = read() | {name: record(design, outcome)}
        write_text(RESULTS, json.dumps(dict(sorted(known.items())), indent=1) + "\n")
        if not outcome.stable:
            save_figure(
                stability_figure(design, outcome), HERE / "figures" / f"stability-{name}.png"
            )
        print(f"{name}:", *stability_lines(outcome), sep="\n  ", flush=True)
    return known


if __name__ == "__main__":
    main()
