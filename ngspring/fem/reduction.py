"""From values on finite element dofs to values on independent unknowns, by precomputed maps.

``P^T K P`` with fixed extraction matrices and a fixed pattern of K is a fixed linear map from the
stored values of K to those of the product. It is built once as a sparse matrix; a new K then costs
one sparse matrix-vector product, and explicit zeros never change the pattern.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Pattern:
    """Sorted places (row, column) of a sparse matrix, as keys ``row * columns + column``."""

    keys: IntArray
    shape: tuple[int, int]

    @property
    def rows(self) -> IntArray:
        """Row of each entry."""
        return np.asarray(self.keys // self.shape[1])

    @property
    def columns(self) -> IntArray:
        """Column of each entry."""
        return np.asarray(self.keys % self.shape[1])

    @property
    def lower(self) -> Pattern:
        """The places of the lower triangle."""
        return Pattern(self.keys[self.columns <= self.rows], self.shape)

    def matrix(self, values: FloatArray) -> sp.csr_matrix:
        """The sparse matrix with these values."""
        offsets = np.searchsorted(self.keys, np.arange(self.shape[0] + 1) * self.shape[1])
        return sp.csr_matrix((values, self.columns, offsets), shape=self.shape)


def product_pattern(
    rows: IntArray, columns: IntArray, left: sp.csr_matrix, right: sp.csr_matrix
) -> Pattern:
    """Pattern of ``left^T A right`` for A with entries at (rows, columns)."""
    entries = sp.csr_matrix(
        (np.ones(len(rows)), (rows, columns)), shape=(left.shape[0], right.shape[0])
    )
    product = sp.csr_matrix(abs(left).T @ entries @ abs(right)).tocoo()
    shape = (left.shape[1], right.shape[1])
    keys = product.row.astype(np.int64) * shape[1] + product.col
    return Pattern(np.sort(keys), shape)


def united(patterns: Iterable[Pattern]) -> Pattern:
    """The places of all of these patterns, which have one shape."""
    first, *others = patterns
    keys = first.keys
    for pattern in others:
        keys = np.union1d(keys, pattern.keys)
    return Pattern(keys, first.shape)


def product_map(
    rows: IntArray,
    columns: IntArray,
    left: sp.csr_matrix,
    right: sp.csr_matrix,
    pattern: Pattern,
) -> sp.csr_matrix:
    """The matrix that maps the values of A's entries to those of ``left^T A right`` on a pattern.

    Entries of A may be listed more than once; their values add up. Places of the product that are
    not in the pattern are left out.
    """
    pieces = []
    # In chunks: the expanded lists are many times longer than the entries.
    for begin in range(0, len(rows), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        pieces.append(_expanded(rows[part], columns[part], begin, left, right, pattern))
    place, entry, weights = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    shape = (len(pattern.keys), len(rows))
    return sp.csr_matrix((weights, (place, entry)), shape=shape)


_CHUNK = 10_000


def _expanded(
    rows: IntArray,
    columns: IntArray,
    begin: int,
    left: sp.csr_matrix,
    right: sp.csr_matrix,
    pattern: Pattern,
) -> tuple[NDArray[np.int32], NDArray[np.int32], FloatArray]:
    """Place in the product, entry of A, and weight of each contribution."""
    count_right = np.diff(right.indptr)[columns]
    count = np.diff(left.indptr)[rows] * count_right
    entry = np.repeat(np.arange(len(rows)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    of_left = left.indptr[rows[entry]] + within // count_right[entry]
    of_right = right.indptr[columns[entry]] + within % count_right[entry]
    keys = left.indices[of_left].astype(np.int64) * pattern.shape[1] + right.indices[of_right]
    place = np.minimum(np.searchsorted(pattern.keys, keys), len(pattern.keys) - 1)
    kept = pattern.keys[place] == keys
    weights = left.data[of_left] * right.data[of_right]
    return place[kept].astype(np.int32), (entry[kept] + begin).astype(np.int32), weights[kept]


def scatter_map(
    rows: IntArray,
    columns: IntArray,
    width: int,
    entry_rows: IntArray,
    entry_columns: IntArray,
) -> sp.csr_matrix:
    """The matrix that adds up listed entries on the stored entries of a matrix.

    Parameters
    ----------
    rows, columns : arrays
        Places of the stored entries, in storage order.
    width : int
        Number of columns.
    entry_rows, entry_columns : arrays
        Places of the entries to add, each of them stored.
    """
    stored = rows * width + columns
    order = np.argsort(stored, kind="stable")
    place = order[np.searchsorted(stored[order], entry_rows * width + entry_columns)]
    shape = (len(rows), len(entry_rows))
    entry = np.arange(len(entry_rows), dtype=np.int32)
    ones = np.ones(len(entry_rows))
    return sp.csr_matrix((ones, (place.astype(np.int32), entry)), shape=shape)


def form_matrix(form: ng.BilinearForm) -> sp.csr_matrix:
    """An assembled form as a scipy matrix (a copy)."""
    values, columns, offsets = (np.array(part) for part in form.mat.CSR())
    shape = (form.mat.height, form.mat.width)
    return sp.csr_matrix((values, columns, offsets.astype(np.int64)), shape=shape)


def stored_values(form: ng.BilinearForm) -> FloatArray:
    """Values of an assembled form in storage order (no copy)."""
    return np.asarray(form.mat.AsVector().FV().NumPy())


def csr_pattern(form: ng.BilinearForm) -> tuple[IntArray, IntArray]:
    """Rows and columns of the stored entries of an assembled form, in storage order."""
    _, columns, offsets = form.mat.CSR()
    offsets = np.asarray(offsets).astype(np.int64)
    rows = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    return rows, np.asarray(columns).astype(np.int64)
