"""Every stored part beside the design that it was made from: what it took to make the solid fit.

Of both the solid is computed with real contact: forces at the targets, the stretch that a
thousandth of the volume exceeds, the smallest wall and gap at rest, W/H; where the path loses its
stability. Of a part that was designed with an imperfection its full solid is computed with one,
too. The outcome goes to results/parts.json, which the results page shows as tables, and
figures/parts.png draws the curves: targets, third medium and solid.

Parts that have not changed since are skipped. A few minutes for each on one core.

    python examples/paper/evaluation_of_parts.py [NAME ...] [--threads N]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gallery_results import PICTURES, evaluate
from stability_of_gallery import record

from ngspring import Design, gallery, parts
from ngspring.analysis.stability import stability
from ngspring.solid.contact.response import ContactResponse
from ngspring.solid.imperfection import imperfection
from ngspring.solid.verification import verify
from ngspring.view.figure import save_figure
from ngspring.view.parts import PartCurves, parts_figure

#: Largest distance in mm by which the surfaces of a part are moved that is not to buckle.
MOVED_BY = 0.2


def described(design: Design, threads: int | None) -> dict[str, Any]:
    """What is compared of a design and a part."""
    verification = verify(design, threads=threads)
    found = verification.to_dict()
    kept = ("control_points", "stretch_measure", "smallest_wall", "smallest_gap_at_rest", "curve")
    described = {
        "width": round(design.relative_width, 6),
        "stability": record(stability(design, threads=threads)),
        **{name: found[name] for name in kept},
    }
    if any(point.eta_odd for point in design.problem.control_points):
        described["imperfect"] = moved(design, verification.contact, threads)
    return described


def moved(design: Design, perfect: ContactResponse, threads: int | None) -> dict[str, Any]:
    """How far the full solid with an imperfection is off."""
    found = imperfection(design, MOVED_BY, threads=threads, perfect=perfect).to_dict()
    kept = ("size", "odd_in", "stable", "complete", "largest_deviation", "leaves", "jumps")
    return {name: found[name] for name in kept}


def evaluation(name: str, part: Design, threads: int | None) -> dict[str, Any]:
    case = part.problem.name
    return {
        "case": case,
        "before": described(gallery[case], threads),
        "after": described(part, threads),
    }


def curves(name: str, found: dict[str, Any]) -> PartCurves:
    after = found["after"]
    curve = after["curve"]
    targets = [(point["d"], point["q_target"]) for point in after["control_points"]]
    return PartCurves(name, targets, curve["d"], curve["q_third_medium"], curve["q_contact"])


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    known = evaluate("parts", __doc__, evaluation, arguments, parts)
    save_figure(parts_figure([curves(name, known[name]) for name in known]), PICTURES / "parts.png")
    return known


if __name__ == "__main__":
    main()
