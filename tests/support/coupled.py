"""The coupled system as functions of one vector."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.design.design import Design
from ngspring.fem.constraints import stretched
from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem, Residual

FIELDS = ("chi", "u", "lam")


class Flat:
    """The coupled system as functions of one vector (chi, u_1, u_2, ..., lam_1, lam_2, ...).

    Its state is rough in every field, far from equilibrium, with no element inverted.
    """

    dt = 3e3

    def __init__(self, design: Design, domain: str = "quarter", solver: str = "auto") -> None:
        self.problem = design.problem.replace(domain=domain)
        self.system = system = CoupledSystem(self.problem, solver)
        points, n = system.points, system.free
        self.shapes = ((system.coefficients,), (len(points), n), (len(points), n + 1))
        random = np.random.default_rng(5)
        unit = system.images[0].restrict(stretched(system.scalar))
        u = [p.d * unit + 0.4 * random.uniform(-1, 1, n) for p in points]
        size = 0.3 * np.array([abs(p.q) * p.weight for p in points])[:, None]
        lam = size * random.uniform(-1, 1, self.shapes[2])
        self.x = self.vector(State(design.coefficients.ravel(), np.array(u), lam))
        self.chi_old = design.coefficients.ravel() + random.uniform(-1, 1, system.coefficients)

    @staticmethod
    def vector(of: State | Residual) -> FloatArray:
        return np.concatenate([of.chi, of.u.ravel(), of.lam.ravel()])

    def field(self, name: str) -> slice:
        """Where a field stands in the vector; "all" for all of them."""
        if name == "all":
            return slice(None)
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in self.shapes)])
        i = FIELDS.index(name)
        return slice(ends[i], ends[i + 1])

    def state(self, x: FloatArray) -> State:
        parts = (x[self.field(name)].copy() for name in FIELDS)
        return State(*(p.reshape(shape) for p, shape in zip(parts, self.shapes, strict=True)))

    def residual(self, x: FloatArray) -> FloatArray:
        return self.vector(self.system.residual(self.state(x), self.chi_old, self.dt))

    def derivative(self, d: FloatArray, h: float = 1e-4) -> FloatArray:
        """Of the residual in a direction, by fourth-order differences."""
        near = self.residual(self.x + h * d) - self.residual(self.x - h * d)
        far = self.residual(self.x + 2 * h * d) - self.residual(self.x - 2 * h * d)
        return np.asarray((8 * near - far) / (12 * h))

    def as_residual(self, r: FloatArray) -> Residual:
        state = self.state(r)
        return Residual(state.chi, state.u, state.lam, {})

    def matrix(self, x: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Product with the Newton matrix at x."""
        self.system.assemble(self.state(x), self.dt)
        return lambda d: self.vector(self.system.product(self.state(d)))

    def direction(self, field: str, seed: int = 0) -> FloatArray:
        d = np.zeros_like(self.x)
        part = self.field(field)
        d[part] = np.random.default_rng(seed).uniform(-1, 1, d[part].shape)
        return d


def orders(values: FloatArray, steps: FloatArray) -> FloatArray:
    """Powers of the step with which values vanish, from one step to the next."""
    return np.asarray(np.diff(np.log(np.abs(values))) / np.diff(np.log(steps)))
