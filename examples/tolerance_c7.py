"""Manufacturing errors: C7 with its surfaces moved in and out by 0.1, 0.25 and 0.5 mm.

The paper names this as open. Each offset is a body-fitted solid of its own with real contact. Less
material makes the spring softer everywhere, and contact comes later: the narrow slots of C7 make
the force at -20 mm the most sensitive one (`ngspring.Tolerance.sensitivity`, N per mm of offset).

Writes figures/tolerance-C7.png. A few minutes on one core.

    python examples/tolerance_c7.py [--out DIR] [--points N] [--only NAME ...] [--threads N]
"""

from __future__ import annotations

from collections.abc import Sequence

from figures import load_designs, read_options, save

from ngspring.solid.tolerance import tolerance
from ngspring.view.tolerance import tolerance_figure


def main(arguments: Sequence[str] | None = None) -> dict[str, dict[str, float]]:
    options = read_options(__doc__, arguments)
    numbers = {}
    for name, design in load_designs(options.only or ("C7",), options).items():
        if design is None:
            continue
        outcome = tolerance(design, points=min(options.points, 21), threads=options.threads)
        save(tolerance_figure(outcome), options, f"tolerance-{name}")
        numbers[name] = {
            f"dq/d(offset) at {point.d:g}": outcome.sensitivity(point.d) for point in outcome.points
        }
    return numbers


if __name__ == "__main__":
    for name, values in main().items():
        print(name, values)
