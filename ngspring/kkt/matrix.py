"""From NGSolve's stored values to one triangle of the coupled Newton matrix.

All patterns and index maps of a mesh, built once: an iteration only multiplies with them.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.fem.reduction import (
    Pattern,
    csr_pattern,
    product_map,
    product_pattern,
    scatter_map,
    stored_values,
)
from ngspring.physics.lagrangian import ControlPointForm, DesignForm
from ngspring.physics.void import VoidBlocks

#: Name of a piece of the triangle, and the control point it belongs to.
Piece: TypeAlias = tuple[str, int]


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
    upper : bool
        Which triangle the linear solver wants.

    Attributes
    ----------
    triangle : scipy.sparse.csr_matrix
        Pattern of that triangle. Its values are those of the Newton matrix once it has been
        replaced by the factorisation's own.
    """

    def __init__(
        self,
        form: ControlPointForm,
        design: DesignForm,
        extraction_chi: sp.csr_matrix,
        extraction_u: sp.csr_matrix,
        points: int,
        upper: bool,
    ) -> None:
        self._lam_unit = form.lam_unit
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
        patterns: dict[str, Pattern] = {}
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
            if name == "chi_chi":
                # Symmetric, and the largest map by far: half of it is enough.
                pattern = pattern.lower
            patterns[name] = pattern
            self._entries[name] = entries.astype(np.int32)
            self._maps[name] = product_map(r, c, left, right, pattern)
            if void_entries is not None:
                self._void_maps[name] = scatter_map(r, c, right.shape[0], *void_entries)

        add("chi_chi", (0, 0), chi, chi, (void_rows, void_columns))
        add("chi_u", (0, 1), chi, inner_u, (chi_rows, both_columns))
        add("chi_lam", (0, 2), chi, u, (chi_rows, both_columns))
        add("u_lam", (1, 2), u, u, (both_rows, both_columns))
        # The u-u block has the pattern of the u-lam block, and goes through the same map.
        entries = np.flatnonzero((block_row == 1) & (block_column == 1))
        like = self._entries["u_lam"]
        if not (
            np.array_equal(rows[entries], rows[like])
            and np.array_equal(columns[entries], columns[like] - 2 * n)
        ):
            raise AssertionError("the stored patterns of u-u and u-lam differ")
        self._entries["u_u"] = entries.astype(np.int32)

        # The forms of C_chi live on the same pattern as the chi-chi block.
        chi_entries = self._entries["chi_chi"]
        for form_of_chi in (design.nonlinear, design.transient, *design.quadratic):
            r, c = csr_pattern(form_of_chi)
            if not (
                np.array_equal(r, rows[chi_entries]) and np.array_equal(c, columns[chi_entries])
            ):
                raise AssertionError("the patterns of the forms of chi differ")
        reduction = self._maps["chi_chi"]
        self._transient = reduction @ stored_values(design.transient)
        quadratic = [reduction @ stored_values(form) for form in design.quadratic]
        self._quadratic = sum(quadratic, np.zeros_like(self._transient))
        self._arrange(patterns, chi.shape[1], free, points, upper)

    def _arrange(
        self, patterns: dict[str, Pattern], nc: int, free: int, points: int, upper: bool
    ) -> None:
        """Where each block's values go in a triangle of the whole."""
        top_column = patterns["chi_lam"].columns == free
        self.chi_top = _places(top_column)
        chi_inner = _places(~top_column)
        chi_u, chi_lam = patterns["chi_u"], patterns["chi_lam"]
        if not (
            np.array_equal(chi_lam.rows[chi_inner], chi_u.rows)
            and np.array_equal(chi_lam.columns[chi_inner], chi_u.columns)
        ):
            raise AssertionError("the patterns of u and lam differ")
        self.chi_inner = chi_inner
        ul = patterns["u_lam"]
        self.inner = _places((ul.rows < free) & (ul.columns < free))
        uu_rows, uu_columns = ul.rows[self.inner], ul.columns[self.inner]
        self.inner_lower = _places(uu_columns <= uu_rows)
        self.top = _places((ul.rows == free) & (ul.columns < free))
        cc = patterns["chi_chi"]
        self.chi_diagonal = _places(cc.columns == cc.rows)

        self._place_pieces(patterns, nc, free, points, upper)

    def _place_pieces(
        self, patterns: dict[str, Pattern], nc: int, free: int, points: int, upper: bool
    ) -> None:
        """Rows and columns of every piece of the lower triangle, whose transpose has its values."""
        cc, ul = patterns["chi_chi"], patterns["u_lam"]
        chi_u, chi_lam = patterns["chi_u"], patterns["chi_lam"]
        uu_rows, uu_columns = ul.rows[self.inner], ul.columns[self.inner]
        lower_rows, lower_columns = uu_rows[self.inner_lower], uu_columns[self.inner_lower]
        of_top = ul.columns[self.top]
        pieces: dict[Piece, tuple[IntArray, IntArray]] = {("chi_chi", 0): (cc.rows, cc.columns)}
        for j in range(points):
            a = nc + j * (2 * free + 1)
            b, top = a + free, a + 2 * free

            def on_top(columns: IntArray, top: int = top) -> tuple[IntArray, IntArray]:
                return np.full(len(columns), top), columns

            pieces |= {
                ("a_chi", j): (chi_u.columns + a, chi_u.rows),
                ("b_chi", j): (chi_u.columns + b, chi_u.rows),
                ("a_a", j): (lower_rows + a, lower_columns + a),
                ("b_a", j): (uu_rows + b, uu_columns + a),
                ("b_b", j): (lower_rows + b, lower_columns + b),
                ("top_chi", j): on_top(chi_lam.rows[self.chi_top]),
                ("top_a", j): on_top(of_top + a),
                ("top_b", j): on_top(of_top + b),
                ("top_top", j): on_top(np.array([top])),
            }
        self._store(pieces, nc + points * (2 * free + 1), upper)

    def _store(
        self, pieces: dict[Piece, tuple[IntArray, IntArray]], size: int, upper: bool
    ) -> None:
        """The triangle's pattern, and where in it each piece goes."""
        row, column = (np.concatenate(part) for part in zip(*pieces.values(), strict=True))
        if upper:
            row, column = column, row
        keys = row.astype(np.int64) * size + column
        order = np.argsort(keys, kind="stable")
        place = np.empty(len(order), np.int32)
        place[order] = np.arange(len(order), dtype=np.int32)
        ends = np.cumsum([len(rows) for rows, _ in pieces.values()])
        self._place = dict(zip(pieces, np.split(place, ends[:-1]), strict=True))
        self.triangle = Pattern(keys[order], (size, size)).matrix(np.ones(len(keys)))
        self._diagonal = self.triangle.indptr[:-1] if upper else self.triangle.indptr[1:] - 1
        if not np.array_equal(self.triangle.indices[self._diagonal], np.arange(size)):
            raise AssertionError("the Newton matrix lacks a diagonal entry")

    def write(self, name: str, values: FloatArray, j: int = 0) -> None:
        """Write a piece of the triangle.

        Parameters
        ----------
        name : str
            "chi_chi"; or, of control point j, a row and a column out of a, b (``u = a + b``,
            ``lam = s (a - b)``) and top (``lam_Ty / r``): "a_chi", "b_chi", "a_a", "b_a", "b_b",
            "top_chi", "top_a", "top_b", "top_top". What is symmetric is its lower triangle.
        values : array
            In the order of the piece's pattern.
        j : int
        """
        self.triangle.data[self._place[name, j]] = values

    def write_control_point(
        self,
        j: int,
        stored: FloatArray,
        void: VoidBlocks,
        weight: float,
        scales: tuple[float, float, float],
    ) -> FloatArray:
        """Write the blocks of a control point, in the unknowns a and b.

        Parameters
        ----------
        j : int
        stored : array
            Stored values of the control point's form.
        void : VoidBlocks
        weight : float
            w of the control point.
        scales : tuple of float
            t, s and r, of chi, of lam and of lam_Ty.

        Returns
        -------
        array
            Its part of the chi-chi block, not scaled.
        """
        t, s, r = scales
        # One after the other, so that little is held at a time.
        chi_u, chi_lam = self.block("chi_u", stored, void), self.block("chi_lam", stored, void)
        self.write("top_chi", (r * t) * chi_lam[self.chi_top], j)
        chi_u *= t
        chi_lam = (t * s) * chi_lam[self.chi_inner]
        self.write("a_chi", chi_u + chi_lam, j)
        self.write("b_chi", chi_u - chi_lam, j)
        del chi_u, chi_lam
        bb, kk = self.block("u_u", stored, void), self.block("u_lam", stored, void)
        bb_lower = bb[self.inner_lower]
        kk_lower = (2 * s) * kk[self.inner][self.inner_lower]
        self.write("a_a", bb_lower + kk_lower, j)
        self.write("b_a", bb, j)
        self.write("b_b", bb_lower - kk_lower, j)
        self.write("top_a", r * kk[self.top], j)
        self.write("top_b", r * kk[self.top], j)
        self.write("top_top", np.array([-(r**2) / weight]), j)
        return self.block("chi_chi", stored, void)

    def diagonal(self) -> FloatArray:
        """Diagonal of the assembled matrix."""
        return np.asarray(self.triangle.data[self._diagonal])

    def design(self, form: DesignForm, chi: FloatArray, dt: float) -> FloatArray:
        """Second derivative of C_chi on the lower triangle's chi-chi pattern."""
        values = self._maps["chi_chi"] @ form.tangent_nonlinear(chi) + self._quadratic
        return np.asarray(values + self._transient / dt if np.isfinite(dt) else values)

    def block(self, name: str, values: FloatArray, void: VoidBlocks) -> FloatArray:
        """A block of one control point on the independent unknowns.

        Parameters
        ----------
        name : {"chi_chi", "chi_u", "chi_lam", "u_u", "u_lam"}
        values : array
            Stored values of the control point's form.
        void : VoidBlocks
        """
        if name == "u_u":
            b = self._maps["u_lam"] @ values[self._entries["u_u"]]
            return np.asarray(b[self.inner])
        stored = values[self._entries[name]]
        if name.endswith("_lam"):
            stored /= self._lam_unit
        if name == "u_lam":
            stiffness = void.stiffness.ravel()
            element = np.concatenate([stiffness, stiffness])
        else:
            element = getattr(void, name).ravel()
        stored += self._void_maps[name] @ element
        return np.asarray(self._maps[name] @ stored)


def _places(where: NDArray[np.bool_]) -> NDArray[np.int32]:
    return np.flatnonzero(where).astype(np.int32)
