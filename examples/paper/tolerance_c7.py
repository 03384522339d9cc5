"""Manufacturing errors: C7 with its surfaces moved in and out by 0.1, 0.25 and 0.5 mm.

The paper names this as open. Each offset is a body-fitted solid of its own with real contact. Less
material makes the spring softer everywhere, and contact comes later: the narrow slots of C7 make
the force at -20 mm the most sensitive one (`ngspring.Tolerance.sensitivity`, N per mm of offset).
A few minutes on one core.
"""

from __future__ import annotations

from designs import Numbers, Options, load_designs, save

from ngspring.solid.tolerance import tolerance
from ngspring.view.tolerance import tolerance_figure


def draw(options: Options) -> Numbers:
    numbers: Numbers = {}
    for name, design in load_designs(options.only or ("C7",), options).items():
        if design is None:
            continue
        outcome = tolerance(design, points=min(options.points, 21), threads=options.threads)
        save(tolerance_figure(outcome), options, f"tolerance-{name}")
        numbers[name] = {
            f"dq/d(offset) at {point.d:g}": outcome.sensitivity(point.d) for point in outcome.points
        }
    return numbers
