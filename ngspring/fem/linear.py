"""Direct solution of sparse symmetric systems whose pattern stays the same (design notes, 5).

Two backends with one interface: NGSolve's own ``sparsecholesky`` (an L D L^T without pivoting; the
default, no further dependency), and MKL PARDISO through `pypardiso` (installed with the extra
``fast``), about twice as fast. Both keep their symbolic analysis while values change. The Newton
matrix is handed over in quasi-definite form (`ngspring.kkt.system`), which needs no pivoting.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import importlib.util
import os
import sys
from typing import Any, Protocol

import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ProblemError
from ngspring.fem.process import tasks

BACKENDS = ("auto", "sparsecholesky", "pardiso")


class Factorization(Protocol):
    """A symmetric matrix with a fixed pattern, its factors, and solutions with them.

    Attributes
    ----------
    matrix : scipy.sparse.csr_matrix
        One triangle, the only copy of the values: write into ``matrix.data`` (never replace it),
        then call `factorize`.
    """

    matrix: sp.csr_matrix

    def set_pattern(self, triangle: sp.csr_matrix) -> None:
        """Begin anew with another matrix."""

    def factorize(self) -> None:
        """Numeric factorisation for the present values of `matrix`."""

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solution with the last factors, not refined."""

    @property
    def negative_eigenvalues(self) -> int | None:
        """How many eigenvalues of the last matrix are negative; None if not known."""


class SparseCholesky:
    """NGSolve's sparse L D L^T factorisation; reads the lower triangle only."""

    def __init__(self, lower: sp.csr_matrix) -> None:
        self.set_pattern(lower)

    def set_pattern(self, triangle: sp.csr_matrix) -> None:
        """See `Factorization`."""
        lower = triangle
        rows = np.repeat(np.arange(lower.shape[0], dtype=np.int32), np.diff(lower.indptr))
        columns = lower.indices.astype(np.int32, copy=False)
        self._matrix = ng.la.SparseMatrixd.CreateFromCOO(rows, columns, lower.data, *lower.shape)
        # Views of NGSolve's own arrays.
        values, columns, offsets = (np.asarray(part) for part in self._matrix.CSR())
        self.matrix = sp.csr_matrix(
            (values, columns, offsets.astype(np.int32)), shape=lower.shape, copy=False
        )
        self._inverse: Any = None
        self._rhs = self._matrix.CreateColVector()
        self._solution = self._matrix.CreateColVector()

    def factorize(self) -> None:
        """See `Factorization`."""
        with tasks():
            if self._inverse is None:
                self._inverse = self._matrix.Inverse(inverse="sparsecholesky")
            else:
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


def _point_to_mkl() -> None:
    """Tell pypardiso where MKL is: each of its solvers would search the whole environment for it.

    As pip has noted it; where it has not (conda), pypardiso searches. An own choice stays.
    """
    if "PYPARDISO_MKL_RT" in os.environ:
        return
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        for file in importlib.metadata.files("mkl") or ():
            if file.name.startswith(("libmkl_rt", "mkl_rt")) and file.suffix != ".lib":
                os.environ["PYPARDISO_MKL_RT"] = str(file.locate())


class Pardiso:
    """MKL PARDISO, symmetric indefinite (mtype -2), through pypardiso; reads the upper triangle."""

    def __init__(self, upper: sp.csr_matrix, threads: int) -> None:
        # MKL's idle threads would spin for 200 ms after every call, and take the cores from
        # NGSolve's. Read by its OpenMP when that starts, which is at the first call.
        os.environ.setdefault("KMP_BLOCKTIME", "0")
        _point_to_mkl()
        from pypardiso import PyPardisoSolver

        self._solver = PyPardisoSolver(mtype=-2)
        self._solver.libmkl.MKL_Set_Num_Threads(threads)
        for index, value in ((1, 1), (2, 2), (10, 13), (11, 0), (13, 0), (8, 0), (24, 0)):
            # Own parameters, METIS, tiny pivot bound 1e-13, no scaling, no matching, no refinement
            # (we refine block by block), classic factorisation.
            self._solver.set_iparm(index, value)
        self.set_pattern(upper)

    def set_pattern(self, triangle: sp.csr_matrix) -> None:
        """See `Factorization`."""
        if hasattr(self, "matrix"):
            self._solver.free_memory(everything=True)
        self.matrix = triangle
        self._analysed = False
        self._nothing = np.zeros((triangle.shape[0], 1), order="F")

    def factorize(self) -> None:
        """See `Factorization`."""
        self._solver.set_phase(22 if self._analysed else 12)
        self._solver._call_pardiso(self.matrix, self._nothing)
        self._analysed = True

    def solve(self, rhs: FloatArray) -> FloatArray:
        """See `Factorization`."""
        # PARDISO reads n doubles from the pointer, whatever the array holds.
        column = np.ascontiguousarray(rhs, dtype=np.float64).reshape(self.matrix.shape[0], 1)
        self._solver.set_phase(33)
        return np.asarray(self._solver._call_pardiso(self.matrix, column)).ravel()

    @property
    def negative_eigenvalues(self) -> int | None:
        """See `Factorization`."""
        return int(self._solver.iparm[22])

    def __del__(self) -> None:
        # PARDISO keeps its factors outside Python's memory.
        solver = getattr(self, "_solver", None)
        if solver is not None and not sys.is_finalizing():
            solver.free_memory(everything=True)


def wants_upper(backend: str = "auto") -> bool:
    """Whether this backend reads the upper triangle (PARDISO) or the lower one.

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
    return backend == "pardiso" or (backend == "auto" and installed)


def make_factorization(
    triangle: sp.csr_matrix, backend: str = "auto", threads: int = 1
) -> Factorization:
    """A factorisation for a pattern.

    Parameters
    ----------
    triangle : scipy.sparse.csr_matrix
        The triangle that `wants_upper` asks for: sorted, with a full diagonal. Its values do not
        matter; from now on they belong to the factorisation.
    backend : str
        One of `BACKENDS`.
    threads : int
        Of PARDISO.

    Raises
    ------
    ProblemError
        See `wants_upper`.
    """
    return Pardiso(triangle, threads) if wants_upper(backend) else SparseCholesky(triangle)


def multiply(triangle: sp.csr_matrix, x: FloatArray) -> FloatArray:
    """Product of a symmetric matrix, given by one triangle, with a vector."""
    return np.asarray(triangle @ x + triangle.T @ x - triangle.diagonal() * x)


def symmetric(triangle: sp.csr_matrix) -> sp.csr_matrix:
    """Both triangles of a symmetric matrix from one of them."""
    transposed = triangle.T.tocsr()
    transposed.setdiag(0.0)
    return sp.csr_matrix(triangle + transposed)


def inertia(matrix: sp.csr_matrix) -> int | None:
    """Number of negative eigenvalues of a symmetric matrix, by scipy's LU factorisation.

    Rows and columns are ordered alike and pivots stay on the diagonal, so that the signs of U's
    diagonal are those of an L D L^T. None if a pivot had to be taken elsewhere.
    """
    factors = splu(
        matrix.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True, "Equil": False},
    )
    if not np.array_equal(factors.perm_r, factors.perm_c):
        return None
    return int((factors.U.diagonal() < 0).sum())
