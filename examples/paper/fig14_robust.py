"""Fig. 14: softening tension springs T1 and T2 with and without the robust formulation.

Per row: the robust design, then the one without the control point of the dilated design,
undeformed and at d = 10 and 20 mm, and the curves of both. Without it strain localises in
intermediate density (Appendix A), which is not physical.

Numbers to expect: both meet q(10) = 2 N and q(20) = 3 N (T1) or 3.5 N (T2) within 0.1 %; the grey
part of the solid (rho between 0.2 and 0.8, as a fraction of the volume) is 1.3 % (T1) and 1.5 %
(T2) in the robust designs, that of their interfaces alone, and 3.2 % and 3.0 % without. The line
across T1's neck (rho = 0.82) does not count as grey here; README.md tells about it.
"""

from __future__ import annotations

import numpy as np
from designs import Numbers, Options, compute_curves, load_designs, save

from ngspring import Design
from ngspring.view.rows import robust_figure

CASES = ("T1", "T2")
NAMES = tuple(name for case in CASES for name in (case, f"{case}-not-robust"))


def grey_fraction(design: Design) -> float:
    """Volume of material with rho between 0.2 and 0.8, over the whole volume."""
    x, y = (np.linspace(0, size, 801) for size in (design.problem.L, design.problem.H))
    rho = design.density((x[1:] + x[:-1])[:, None] / 2, (y[1:] + y[:-1])[None, :] / 2)
    return float(rho[(rho > 0.2) & (rho < 0.8)].sum() / rho.sum())


def draw(options: Options) -> Numbers:
    designs = load_designs(NAMES, options)
    curves, numbers = compute_curves(designs, options)
    pairs = {case: (case, f"{case}-not-robust") for case in CASES}
    figure = robust_figure(
        {case: (designs[robust], designs[plain]) for case, (robust, plain) in pairs.items()},
        {case: (curves.get(robust), curves.get(plain)) for case, (robust, plain) in pairs.items()},
    )
    save(figure, options, "fig14")
    for name, design in designs.items():
        if design is not None:
            numbers[name]["grey"] = grey_fraction(design)
    return numbers
