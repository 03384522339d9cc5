"""From a design to a part: real contact in place of the third medium, then files for a workshop.

    python examples/from_a_design_to_a_part.py

A minute; writes C7.step and C7.svg.
"""

from collections.abc import Iterable
from pathlib import Path

import ngspring


def main(
    name: str = "C7", displacements: Iterable[float] | None = None, out: Path = Path()
) -> ngspring.Verification:
    design = ngspring.gallery[name]  # or ngspring.Design.load("runs/mine/design.npz")
    outcome = ngspring.verify(design, displacements)
    print(f"smallest wall: {outcome.smallest_wall:.1f} mm", *outcome.remarks, sep="\n")
    for suffix in ("step", "svg"):
        exported = ngspring.export_body(design, out / f"{name}.{suffix}")
        print(f"{exported.path}: {exported.measure:.0f} mm^{3 if suffix == 'step' else 2}")
    return outcome


if __name__ == "__main__":
    main()
