"""A ladder of meshes: most of the way to a design is gone on coarse ones.

Which walls there are, where they touch and how much material they need is found with wide
interfaces on a coarse mesh, where an iteration costs a fraction; the mesh that was asked for only
sharpens them. Each coarse mesh (rung) is left as soon as dt says that its design has found its
shape. The next one starts from that design, loaded from rest, and decides by itself what becomes of
it: the end is a stationary point of the problem that was asked for, whatever led there.

A smallest wall or gap is asked for on the last mesh only, unless the start is a finished design.
What has no shape yet is all grey, which both push to one side or the other before the forces have
told them which.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

from ngspring.basics.errors import ProblemError
from ngspring.design.design import Design
from ngspring.kkt.start import Start
from ngspring.problem.scaling import on_mesh
from ngspring.problem.spring import SpringProblem


@dataclass(frozen=True)
class Ladder:
    """Which coarse meshes come first, and when they are left.

    Parameters
    ----------
    halvings : int
        Coarse meshes: N/2, N/4, ..., with l_i to suit (`ngspring.problem.scaling.on_mesh`); none
        for 0.
    smallest : int
        No mesh of fewer elements.
    leave : float
        A mesh has done its work when dt has come this far. With less the last mesh does the work,
        with more the coarse one is finished for nothing.
    dt : float
        First dt on the next mesh; both in units of the paper's domain, see `time_unit`.
    astray : float
        Where the forces of the carried design deviate from their targets by more than this,
        relative to them, it is weighed against the run's own start.
    """

    halvings: int = 2
    smallest: int = 20
    leave: float = 1e12
    dt: float = 1e6
    astray: float = 0.5

    def __post_init__(self) -> None:
        if self.halvings < 0 or self.smallest < 2 or not (self.leave > 0 < self.dt):
            raise ProblemError(f"{self} is no ladder: halvings >= 0, leave and dt positive")

    def rungs(
        self, problem: SpringProblem, start: Start | None = None
    ) -> tuple[SpringProblem, ...]:
        """The problem on every mesh of the way, the coarsest first.

        A start that came out of an evolution has its details already: no mesh is coarser than its
        own, and none is needed before one that is no finer.

        Parameters
        ----------
        problem : SpringProblem
        start : Design or function, optional

        Returns
        -------
        tuple of SpringProblem
            The last one is ``problem``.
        """
        finished = isinstance(start, Design) and start.history is not None
        above = start.problem.elements if isinstance(start, Design) and finished else 0
        smallest = max(self.smallest, above + 1)
        # The symmetry axes are mesh lines: even numbers only.
        counts = (2 * round(problem.elements / 2 ** (k + 1)) for k in range(1, self.halvings + 1))
        coarse = itertools.takewhile(lambda count: count >= smallest, counts)
        anyhow = problem if finished else problem.replace(wall=0.0, gap=0.0, k_w=0.0)
        return (*(on_mesh(anyhow, count)[0] for count in reversed(list(coarse))), problem)


#: No coarse meshes: the paper's way.
NO_LADDER = Ladder(halvings=0)
