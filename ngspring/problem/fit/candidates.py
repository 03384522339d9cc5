"""The laws that can be fitted: their free parameters, where to begin, and between which bounds.

The parameters that are searched are few and of similar size. All of what lies between the bounds is
a law that can be made, so that the search never leaves what is valid.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ngspring.basics.arrays import FloatArray
from ngspring.problem.laws import ArrudaBoyce, Gent, MooneyRivlin, NeoHooke, Ogden, Yeoh
from ngspring.problem.laws.base import Law
from ngspring.problem.laws.ogden import LARGEST_EXPONENT

#: K while the change of shape is fitted, in units of the shear modulus: it does not matter.
_ANY_K = 1.0
#: Of zero and infinity, in units of what is searched; and a limit of stretch that is none.
_TINY, _HUGE, _FAR = 1e-6, 1e6, 1e3
#: Size of an exponent.
_LEAST = 0.05
#: Exponents to begin with, for one, two and three terms.
_EXPONENTS = (
    ((2.0,), (-2.0,)),
    ((2.0, -2.0), (1.3, 5.0), (1.0, 10.0)),
    ((1.3, 5.0, -2.0), (0.8, 2.0, 9.0)),
)


Bounds = tuple[Sequence[float], Sequence[float]]


@dataclass(frozen=True)
class Candidate:
    """A law with so many free parameters.

    Attributes
    ----------
    name : str
        As `ngspring.fit` takes it.
    law : callable
        The law of given parameters.
    starts : callable
        Where to begin, (starts, parameters), from the shear modulus and from the largest I_1 - 3 of
        the tests.
    bounds : callable
        Lower and upper bounds, from the same and from where to begin.
    """

    name: str
    law: Callable[[FloatArray], Law]
    starts: Callable[[float, float], Sequence[Sequence[float]]]
    bounds: Callable[[float, float, FloatArray], Bounds]


def _ogden_law(x: FloatArray) -> Law:
    """From exponents and the parts mu alpha / 2 of the shear modulus, all positive: then stable."""
    terms = len(x) // 2
    pairs = [(2 * g / alpha, alpha) for g, alpha in zip(x[:terms], x[terms:], strict=True)]
    values: dict[str, float] = {}
    for k, (mu, alpha) in enumerate(pairs, start=1):
        values |= {f"mu{k}": float(mu), f"alpha{k}": float(alpha)}
    return Ogden(_ANY_K, **values)


def _ogden_bounds(G: float, top: float, start: FloatArray) -> Bounds:
    """Exponents keep their sign, and away from zero, where mu would be infinite."""
    terms = len(start) // 2
    signs = [
        (_LEAST, LARGEST_EXPONENT) if a > 0 else (-LARGEST_EXPONENT, -_LEAST) for a in start[terms:]
    ]
    low, high = zip(*signs, strict=True)
    return [_TINY**2 * G] * terms + list(low), [_HUGE * G] * terms + list(high)


def _ogden(terms: int) -> Candidate:
    def starts(G: float, top: float) -> list[list[float]]:
        return [[G / terms] * terms + list(exponents) for exponents in _EXPONENTS[terms - 1]]

    return Candidate(f"ogden-{terms}", _ogden_law, starts, _ogden_bounds)


def _polynomial_bounds(G: float, top: float, start: FloatArray) -> Bounds:
    """The first one positive, the others free."""
    free = len(start) - 1
    return [_TINY * G, *[-np.inf] * free], [np.inf] * (1 + free)


_ALL = (
    Candidate(
        "neo-hooke",
        lambda x: NeoHooke(_ANY_K, x[0]),
        lambda G, top: [[G]],
        _polynomial_bounds,
    ),
    Candidate(  # from the shear modulus and the part of it that C01 has
        "mooney-rivlin",
        lambda x: MooneyRivlin(_ANY_K, x[0] / 2 * (1 - x[1]), x[0] / 2 * x[1]),
        lambda G, top: [[G, 0.1]],
        _polynomial_bounds,
    ),
    Candidate(
        "yeoh",
        lambda x: Yeoh(_ANY_K, *x),
        lambda G, top: [[G / 2, 0.0, 0.0]],
        _polynomial_bounds,
    ),
    *(_ogden(terms) for terms in (1, 2, 3)),
    Candidate(
        "gent",
        lambda x: Gent(_ANY_K, x[0], x[1]),
        lambda G, top: [[G, 1.1 * top], [G, 2 * top + 10], [G, 10 * top + 100]],
        lambda G, top, start: (
            [_TINY * G, (1 + _TINY) * top],
            [np.inf, _FAR * (1 + top)],
        ),
    ),
    Candidate(
        "arruda-boyce",
        lambda x: ArrudaBoyce(_ANY_K, x[0], x[1]),
        lambda G, top: [[G, 1.5], [G, 3.0], [G, 10.0]],
        lambda G, top, start: ([_TINY * G, 1 + _TINY], [np.inf, _FAR]),
    ),
)

#: By name, in the order of a comparison.
CANDIDATES: Mapping[str, Candidate] = MappingProxyType({each.name: each for each in _ALL})
