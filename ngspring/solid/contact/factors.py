"""The tangent of a solid in contact, and its factors.

The solid's part of the tangent has its entries in the same places always, contact adds others
wherever something touches. Factors keep all places that contact has ever used: the order of
elimination is found anew only where new ones come up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.basics.errors import ConvergenceError
from ngspring.fem.linear import (
    Factorization,
    inertia,
    make_factorization,
    multiply,
    symmetric,
    wants_upper,
)
from ngspring.fem.reduction import Pattern
from ngspring.solid.contact.elasticity import Solid

#: Stiffness of the spring that holds a floating part in the linear systems, as a share of the
#: diagonal: far below that of a contact that begins, which alone may hold the part.
_HOLD = 1e-6


@dataclass(frozen=True, eq=False)
class Tangent:
    """Second derivative of the energy by the free unknowns and d (last row and column).

    Attributes
    ----------
    solid : array (entries,)
        Of the strain energy, on `Solid.pattern`.
    contact : sparse (free + 1, free + 1)
        Of the contact energy.
    """

    solid: FloatArray
    contact: sp.csr_matrix

    def of_d(self, pattern: Pattern) -> tuple[FloatArray, float]:
        """Its column of d on the free unknowns, and the corner."""
        n = pattern.shape[0] - 1
        begin = int(np.searchsorted(pattern.keys, n * pattern.shape[1]))
        last = self.contact[[n], :].toarray().ravel()
        last[pattern.keys[begin:] - n * pattern.shape[1]] += self.solid[begin:]
        return last[:n], float(last[n])


class Factors:
    """Factors of the free unknowns' part of a tangent.

    Parameters
    ----------
    solid : Solid
    solver, threads
        See `ngspring.fem.linear.make_factorization`.
    """

    def __init__(self, solid: Solid, solver: str = "auto", threads: int = 1) -> None:
        self._free = n = solid.free
        self._upper = wants_upper(solver)
        self._solver, self._threads = solver, threads
        rows, columns = solid.pattern.rows, solid.pattern.columns
        self._entries = np.flatnonzero(self._in_triangle(rows, columns))
        self._solid_keys = rows[self._entries] * n + columns[self._entries]
        self._at_rest = solid.diagonal_at_rest
        self._hold = np.zeros(n)
        self._hold[solid.floating] = _HOLD * self._at_rest[solid.floating]
        self._keys = np.zeros(0, np.int64)
        self._factorization: Factorization | None = None

    def _in_triangle(self, rows: IntArray, columns: IntArray) -> IntArray:
        low, high = (rows, columns) if self._upper else (columns, rows)
        return np.asarray((low <= high) & (high < self._free))

    def _prepare(self, keys: IntArray) -> Factorization:
        """The factorisation, its pattern extended by these places if need be."""
        places = np.searchsorted(self._keys, keys)
        known = places < len(self._keys)
        known[known] = self._keys[places[known]] == keys[known]
        if self._factorization is not None and known.all():
            return self._factorization
        n = self._free
        self._keys = np.unique(np.concatenate([self._keys, self._solid_keys, keys]))
        self._solid_places = np.searchsorted(self._keys, self._solid_keys)
        self._diagonal = np.searchsorted(self._keys, np.arange(n) * (n + 1))
        triangle = Pattern(self._keys, (n, n)).matrix(np.ones(len(self._keys)))
        if self._factorization is None:
            self._factorization = make_factorization(triangle, self._solver, self._threads)
        else:
            self._factorization.set_pattern(triangle)
        return self._factorization

    def factorize(
        self, tangent: Tangent, shift: float = 0.0, more: sp.csr_matrix | None = None
    ) -> int:
        """Factorise; returns how many eigenvalues are negative (0 if not known).

        Parameters
        ----------
        tangent : Tangent
        shift : float
            So many times the diagonal of the undeformed tangent is added.
        more : sparse (free, free), optional
            Added, too.

        Raises
        ------
        ConvergenceError
            If it fails.
        """
        n = self._free
        parts = [part.tocoo() for part in (tangent.contact, more) if part is not None]
        rows, columns = (
            np.concatenate([getattr(part, name) for part in parts]).astype(np.int64)
            for name in ("row", "col")
        )
        kept = self._in_triangle(rows, columns)
        keys = rows[kept] * n + columns[kept]
        factorization = self._prepare(keys)
        added = np.concatenate([part.data for part in parts])[kept]
        places = np.searchsorted(self._keys, keys)
        values = np.bincount(places, added, len(self._keys)).astype(float)
        values[self._solid_places] += tangent.solid[self._entries]
        values[self._diagonal] += shift * self._at_rest + self._hold
        factorization.matrix.data[:] = values
        try:
            factorization.factorize()
        except Exception as error:
            raise ConvergenceError(f"the factorisation failed: {error}") from error
        negative = factorization.negative_eigenvalues
        if negative is None:
            negative = inertia(symmetric(factorization.matrix))
        return negative or 0

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solution with the last matrix, refined once."""
        assert self._factorization is not None
        x = self._factorization.solve(rhs)
        residual = rhs - multiply(self._factorization.matrix, x)
        return np.asarray(x + self._factorization.solve(residual))

    def roughly(self, rhs: FloatArray) -> FloatArray:
        """The same, not refined: an update of an iteration."""
        assert self._factorization is not None
        return self._factorization.solve(rhs)
