"""Direct solution of sparse symmetric systems whose pattern stays the same (design notes, 5).

Two backends with one interface: NGSolve's own ``sparsecholesky`` (an L D L^T without pivoting; the
default, no further dependency), and MKL PARDISO through `pypardiso` (installed with the extra
``fast``), about twice as fast. Both keep their symbolic analysis while values change. The
Newton matrix is handed over in quasi-definite form (`ngspring.kkt`), which needs no pivoting.
"""

from __future__ import annotations

import importlib.util
import sys
from typing import Any, Protocol

import ngsolve as ng
import numpy as np
import scipy.sparse as sp

from ngspring.errors import ProblemError
from ngspring.splines import FloatArray
from ngspring.threads import tasks

BACKENDS = ("auto", "sparsecholesky", "pardiso")


class Factorization(Protocol):
    """What a backend does with the lower triangle of a symmetric matrix."""

    def factorize(self, values: FloatArray) -> None:
        """Numeric factorisation for new values on the pattern given at construction."""

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solution with the last factors, not refined."""

    @property
    def negative_eigenvalues(self) -> int | None:
        """How many eigenvalues of the last matrix are negative; None if not known."""


class SparseCholesky:
    """NGSolve's sparse L D L^T factorisation; reads the lower triangle only."""

    def __init__(self, lower: sp.csr_matrix) -> None:
        self._pattern = lower
        self._matrix: Any = None
        self._inverse: Any = None

    def factorize(self, values: FloatArray) -> None:
        """See `Factorization`."""
        if self._matrix is None:
            lower = self._pattern
            rows = np.repeat(np.arange(lower.shape[0], dtype=np.int32), np.diff(lower.indptr))
            self._matrix = ng.la.SparseMatrixd.CreateFromCOO(
                rows, lower.indices.astype(np.int32), values, *lower.shape
            )
            with tasks():
                self._inverse = self._matrix.Inverse(inverse="sparsecholesky")
            self._rhs = self._matrix.CreateColVector()
            self._solution = self._matrix.CreateColVector()
            return
        self._matrix.AsVector().FV().NumPy()[:] = values
        with tasks():
            self._inverse.Update()

    def solve(self, rhs: FloatArray) -> FloatArray:
        """See `Factorization`."""
        self._rhs.FV().NumPy()[:] = rhs
        with tasks():
            self._solution.data = self._inverse * self._rhs
        return np.array(self._solution.FV().NumPy())

    @property
    def negative_eigenvalues(self) -> int | None:
        """Not known."""
        return None


class Pardiso:
    """MKL PARDISO, symmetric indefinite (mtype -2), through pypardiso."""

    def __init__(self, lower: sp.csr_matrix, threads: int) -> None:
        from pypardiso import PyPardisoSolver

        self._solver = PyPardisoSolver(mtype=-2)
        self._solver.libmkl.MKL_Set_Num_Threads(threads)
        for index, value in ((1, 1), (2, 2), (10, 13), (11, 0), (13, 0), (8, 0), (24, 0)):
            # Own parameters, METIS, tiny pivot bound 1e-13, no scaling, no matching, no refinement
            # (we refine block by block), classic factorisation.
            self._solver.set_iparm(index, value)
        index_of = sp.csr_matrix(
            (np.arange(1, lower.nnz + 1), lower.indices, lower.indptr), shape=lower.shape
        ).T.tocsr()
        index_of.sort_indices()
        self._gather = (index_of.data - 1).astype(np.int32)
        self._upper = sp.csr_matrix(
            (np.ones(lower.nnz), index_of.indices, index_of.indptr), shape=lower.shape
        )
        self._analysed = False
        self._nothing = np.zeros((lower.shape[0], 1), order="F")

    def factorize(self, values: FloatArray) -> None:
        """See `Factorization`."""
        self._upper.data[:] = values[self._gather]
        self._solver.set_phase(22 if self._analysed else 12)
        self._solver._call_pardiso(self._upper, self._nothing)
        self._analysed = True

    def solve(self, rhs: FloatArray) -> FloatArray:
        """See `Factorization`."""
        # PARDISO reads n doubles from the pointer, whatever the array holds.
        column = np.ascontiguousarray(rhs, dtype=np.float64).reshape(self._upper.shape[0], 1)
        self._solver.set_phase(33)
        return np.asarray(self._solver._call_pardiso(self._upper, column)).ravel()

    @property
    def negative_eigenvalues(self) -> int | None:
        """See `Factorization`."""
        return int(self._solver.iparm[22])

    def __del__(self) -> None:
        # PARDISO keeps its factors outside Python's memory.
        solver = getattr(self, "_solver", None)
        if solver is not None and not sys.is_finalizing():
            solver.free_memory(everything=True)


def make_factorization(
    lower: sp.csr_matrix, backend: str = "auto", threads: int = 1
) -> Factorization:
    """A factorisation for the pattern of ``lower`` (sorted CSR, full diagonal).

    Raises
    ------
    ProblemError
        For an unknown backend, or "pardiso" when pypardiso is not installed.
    """
    if backend not in BACKENDS:
        raise ProblemError(f"unknown linear solver {backend!r}: use one of {', '.join(BACKENDS)}")
    installed = importlib.util.find_spec("pypardiso") is not None
    if backend == "pardiso" and not installed:
        raise ProblemError(
            "the linear solver 'pardiso' needs pypardiso: pip install 'ngspring[fast]'"
        )
    if backend == "pardiso" or (backend == "auto" and installed):
        return Pardiso(lower, threads)
    return SparseCholesky(lower)
