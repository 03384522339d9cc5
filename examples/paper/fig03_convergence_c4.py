"""Fig. 3: how the optimisation of C4 (linear in compression) converges.

From above: pseudo-time step, objective, its three contributions C_q, and the volume as W/H, against
design updates. The last update has dt = infinity: an exact saddle point.

Numbers to expect: C never grows; the stored run ends after 65 design updates (with the last one)
and 285 Newton iterations with W/H = 0.2189 (the paper: 115 + 1 updates with its step rule). All C_q
are close to zero after 17 updates (paper: fewer than 20), the rest saves material, and after update
36 dt does not fall any more (paper: about 85).
"""

from __future__ import annotations

import numpy as np
from designs import Numbers, Options, load_designs, save

from ngspring.view.run import convergence_figure


def draw(options: Options) -> Numbers:
    design = load_designs(["C4"], options)["C4"]
    assert design is not None
    assert design.history is not None
    history = design.history
    save(convergence_figure(history, design.problem), options, "fig03")
    misfit = sum(history[f"C_q{j}"] for j in (1, 2, 3))
    numbers = {
        "updates": float(len(history) - 1),
        "newton iterations": float(history.newton_iterations),
        "W/H": history.last().width,
        "last dt": history.last().dt,
        "largest growth of C": float(np.max(np.diff(history["C"]) / history["C"][:-1])),
        "misfit left after 17 updates": float(misfit[17] / misfit[0]),
        "misfit left after 20 updates": float(misfit[20] / misfit[0]),
        "last update with a smaller dt": float(np.flatnonzero(np.diff(history["dt"]) < 0)[-1] + 1),
    }
    return {"C4": numbers}
