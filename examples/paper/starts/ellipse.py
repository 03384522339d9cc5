"""The start of T1 in ../gallery.toml: a solid ellipse that ends in a neck.

Its semi-axis in y, 51 mm, is a little longer than the quarter is high: where the quarter ends, in
the middle of the spring, a neck is left. On the axis y = 0 chi falls by 8/l_i per mm at the wall,
as on an established interface (2.6). Run by hand, it writes T1-ellipse.npz.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ngspring import Design, SpringProblem, cases
from ngspring.basics.arrays import FloatArray

FILE = Path(__file__).with_name("T1-ellipse.npz")


def ellipse(problem: SpringProblem, a: float = 18.0, b: float = 51.0) -> Design:
    """A design that is solid inside an ellipse around the middle of the lower side.

    Parameters
    ----------
    problem : SpringProblem
    a, b : float
        Semi-axes in x and y in mm.
    """

    def chi(x: FloatArray, y: FloatArray) -> FloatArray:
        g = np.hypot((x - problem.L / 2) / a, y / b)
        return 4 * a / problem.l_i * np.where(g < 1, 1 - g**2, 2 * (1 - g))

    return Design.from_function(problem, chi)


if __name__ == "__main__":
    ellipse(cases["T1"]).save(FILE)
