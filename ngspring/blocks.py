"""From NGSolve's stored values to the lower triangle of the coupled Newton matrix.

All patterns and index maps of a mesh, built once: an iteration only multiplies with them.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ngspring.lagrangian import ControlPointForm, DesignForm, csr_pattern
from ngspring.reduction import Pattern, product_map, product_pattern, scatter_map
from ngspring.splines import FloatArray, IntArray
from ngspring.void import VoidBlocks


class BlockMaps:
    """Patterns and index maps of the blocks of one control point, and of the whole.

    Parameters
    ----------
    form, design : ControlPointForm, DesignForm
        Assembled at least once, so that their patterns exist.
    extraction_chi, extraction_u : sparse matrices
        Dofs <- unknowns; the last column of the second one is u_Ty.
    points : int
        Number of control points.
    """

    def __init__(
        self,
        form: ControlPointForm,
        design: DesignForm,
        extraction_chi: sp.csr_matrix,
        extraction_u: sp.csr_matrix,
        points: int,
    ) -> None:
        chi, u = extraction_chi, extraction_u
        n = chi.shape[0]
        free = u.shape[1] - 1
        inner_u = u[:, :free].tocsr()
        rows, columns = csr_pattern(form.form)
        block_row = np.searchsorted([n, 3 * n], rows, side="right").astype(np.int8)
        block_column = np.searchsorted([n, 3 * n], columns, side="right").astype(np.int8)
        table = form.void.table.dofs
        void_rows, void_columns = np.repeat(table, 9, axis=1).ravel(), np.tile(table, 9).ravel()
        both_rows = np.concatenate([void_rows, void_rows + n])
        both_columns = np.concatenate([void_columns, void_columns + n])
        chi_rows = np.concatenate([void_rows, void_rows])

        self._entries: dict[str, IntArray] = {}
        self._maps: dict[str, sp.csr_matrix] = {}
        self._void_maps: dict[str, sp.csr_matrix] = {}
        self.patterns: dict[str, Pattern] = {}
        first = (0, n, 3 * n)

        def add(
            name: str,
            blocks: tuple[int, int],
            left: sp.csr_matrix,
            right: sp.csr_matrix,
            void_entries: tuple[IntArray, IntArray] | None,
        ) -> None:
            entries = np.flatnonzero((block_row == blocks[0]) & (block_column == blocks[1]))
            r = rows[entries] - first[blocks[0]]
            c = columns[entries] - first[blocks[1]]
            pattern = product_pattern(r, c, left, right)
            self.patterns[name] = pattern
            self._entries[name] = entries.astype(np.int32)
            self._maps[name] = product_map(r, c, left, right, pattern)
            if void_entries is not None:
                self._void_maps[name] = scatter_map(r, c, right.shape[0], *void_entries)

        add("chi_chi", (0, 0), chi, chi, (void_rows, void_columns))
        add("chi_u", (0, 1), chi, inner_u, (chi_rows, both_columns))
        add("chi_lam", (0, 2), chi, u, (chi_rows, both_columns))
        add("u_u", (1, 1), inner_u, inner_u, None)
        add("u_lam", (1, 2), u, u, (both_rows, both_columns))

        # The forms of C_chi live on the same pattern as the chi-chi block.
        chi_entries = self._entries["chi_chi"]
        for form_of_chi in (design.nonlinear, design.transient, design.terms["curvature"]):
            r, c = csr_pattern(form_of_chi)
            if not (
                np.array_equal(r, rows[chi_entries]) and np.array_equal(c, columns[chi_entries])
            ):
                raise AssertionError("the patterns of the forms of chi differ")
        reduction = self._maps["chi_chi"]
        self._transient = reduction @ design.transient.mat.AsVector().FV().NumPy()
        self._curvature = reduction @ design.terms["curvature"].mat.AsVector().FV().NumPy()
        self._arrange(chi.shape[1], free, points)

    def _arrange(self, nc: int, free: int, points: int) -> None:
        """Where each block's values go in the lower triangle of the whole."""
        top_column = self.patterns["chi_lam"].columns == free
        self.chi_top = np.flatnonzero(top_column)
        chi_inner = np.flatnonzero(~top_column)
        chi_u, chi_lam = self.patterns["chi_u"], self.patterns["chi_lam"]
        if not (
            np.array_equal(chi_lam.rows[chi_inner], chi_u.rows)
            and np.array_equal(chi_lam.columns[chi_inner], chi_u.columns)
        ):
            raise AssertionError("the patterns of u and lam differ")
        self.chi_inner = chi_inner
        uu, ul = self.patterns["u_u"], self.patterns["u_lam"]
        self.inner = np.flatnonzero((ul.rows < free) & (ul.columns < free))
        self.inner_lower = np.flatnonzero(uu.columns <= uu.rows)
        self.top = np.flatnonzero((ul.rows == free) & (ul.columns < free))
        cc = self.patterns["chi_chi"]
        self.chi_diagonal = np.flatnonzero(cc.columns == cc.rows)
        self.chi_lower = np.flatnonzero(cc.columns <= cc.rows)

        rows = [cc.rows[self.chi_lower]]
        columns = [cc.columns[self.chi_lower]]
        for j in range(points):
            a = nc + j * (2 * free + 1)
            b, top = a + free, a + 2 * free
            lower = self.inner_lower
            top_only = np.full(len(self.top), top)
            rows += [chi_u.columns + a, chi_u.columns + b, uu.rows[lower] + a, uu.rows + b]
            columns += [chi_u.rows, chi_u.rows, uu.columns[lower] + a, uu.columns + a]
            rows += [uu.rows[lower] + b, np.full(len(self.chi_top), top), top_only, top_only]
            columns += [uu.columns[lower] + b, chi_lam.rows[self.chi_top]]
            columns += [ul.columns[self.top] + a, ul.columns[self.top] + b]
            rows.append(np.array([top]))
            columns.append(np.array([top]))
        size = nc + points * (2 * free + 1)
        keys = np.concatenate(rows).astype(np.int64) * size + np.concatenate(columns)
        order = np.argsort(keys, kind="stable")
        #: where in ``lower.data`` each value goes, block after block
        self.place = np.empty(len(order), np.int32)
        self.place[order] = np.arange(len(order), dtype=np.int32)
        pattern = Pattern(keys[order], (size, size))
        self.lower = pattern.matrix(np.ones(len(keys)))
        self._diagonal = self.lower.indptr[1:] - 1
        if not np.array_equal(self.lower.indices[self._diagonal], np.arange(size)):
            raise AssertionError("the Newton matrix lacks a diagonal entry")

    def diagonal(self) -> FloatArray:
        """Diagonal of the assembled matrix."""
        return np.asarray(self.lower.data[self._diagonal])

    def design(self, form: DesignForm, chi: FloatArray, dt: float) -> FloatArray:
        """Second derivative of C_chi on the chi-chi pattern."""
        values = self._maps["chi_chi"] @ form.tangent_nonlinear(chi) + self._curvature
        return np.asarray(values + self._transient / dt if np.isfinite(dt) else values)

    def reduce(self, values: FloatArray, void: VoidBlocks) -> dict[str, FloatArray]:
        """Blocks of one control point on the independent unknowns."""
        stiffness = void.stiffness.ravel()
        element = {
            "chi_chi": void.chi_chi.ravel(),
            "chi_u": void.chi_u.ravel(),
            "chi_lam": void.chi_lam.ravel(),
            "u_lam": np.concatenate([stiffness, stiffness]),
        }
        block = {}
        for name, reduction in self._maps.items():
            stored = values[self._entries[name]]
            if name in element:
                stored += self._void_maps[name] @ element[name]
            block[name] = reduction @ stored
        return block
