"""Is the symmetric load path of each stored design stable? (Point of view of the full domain.)

For every design of the gallery the lowest eigenvalue of the full domain's tangent is computed at
the control points and along the path between them, see `ngspring.analysis.stability`. The outcome
goes to results/stability.json, which the results page shows; where a path loses its stability the
critical state and its mode are drawn in figures/stability-NAME.png.

Designs that have not changed since are skipped. One to five minutes for each on one core.

    python examples/paper/stability_of_gallery.py [NAME ...] [--threads N]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gallery_results import PICTURES, evaluate

from ngspring import Design
from ngspring.analysis.stability import Critical, Stability, stability
from ngspring.cli.stability import stability_lines
from ngspring.view.figure import save_figure
from ngspring.view.stability import stability_figure


def critical_record(critical: Critical) -> dict[str, Any]:
    mode = critical.mode
    return {
        "d": round(critical.d, 4),
        "q": round(critical.q, 6),
        "kind": mode.kind,
        "symmetry": mode.symmetry_text,
        "in_solid": round(mode.shares[0], 3),
    }


def record(outcome: Stability) -> dict[str, Any]:
    lowest = min(outcome.relative)
    return {
        "range": [float(outcome.d.min()), float(outcome.d.max())],
        "lowest": round(float(lowest), 6),
        "complete": outcome.complete,
        "critical": [critical_record(critical) for critical in outcome.critical],
    }


def evaluation(name: str, design: Design, threads: int | None) -> dict[str, Any]:
    outcome = stability(design, threads=threads)
    if not outcome.stable:
        save_figure(stability_figure(design, outcome), PICTURES / f"stability-{name}.png")
    print(*stability_lines(outcome), sep="\n", flush=True)
    return record(outcome)


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    return evaluate("stability", __doc__, evaluation, arguments)


if __name__ == "__main__":
    main()
