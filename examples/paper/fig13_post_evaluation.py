"""Fig. 13: curves of the third medium (solid) and of the solids with real contact (dashed).

Left compression (C1, C4, C7), right tension (T2, T3, T6), as in the paper. Each design is
remodelled with a body-fitted mesh of {chi > 0} and frictionless contact of its surfaces.

Numbers to expect: the solids are stiffer, since the third medium's grey surfaces carry less than
the solid up to chi = 0. Largest deviations, of the third medium's force at the same displacement:
C1 17 %, C4 6 %, C7 3 %, T2 4 %, T3 8 %, T6 3 %; the form of the curves stays
(results/verification.json has them all). Half a minute to a few minutes for each design on one
core.
"""

from __future__ import annotations

from designs import Numbers, Options, load_designs, save

from ngspring.solid.verification import verify
from ngspring.view.solid import verifications_figure

GROUPS = {"compression": ("C1", "C4", "C7"), "tension": ("T2", "T3", "T6")}


def draw(options: Options) -> Numbers:
    designs = load_designs([name for names in GROUPS.values() for name in names], options)
    verified = {
        name: verify(design, points=options.points, threads=options.threads)
        for name, design in designs.items()
        if design is not None
    }
    groups = {
        title: {name: verified[name] for name in names if name in verified}
        for title, names in GROUPS.items()
        if any(name in verified for name in names)  # --only may leave a diagram without curves
    }
    save(verifications_figure(groups), options, "fig13")
    return {
        name: {f"q({verdict.point.d:g})": verdict.q_contact for verdict in outcome.points}
        | {"largest deviation": outcome.largest_deviation[2]}
        for name, outcome in verified.items()
    }
