"""From NGSolve's stored values to one triangle of the coupled Newton matrix.

All patterns and index maps of a mesh, built once: an iteration only multiplies with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ngspring.basics.arrays import FloatArray, IntArray
from ngspring.fem.images import Images
from ngspring.fem.reduction import (
    Pattern,
    csr_pattern,
    product_map,
    product_pattern,
    scatter_map,
    stored_values,
    united,
)
from ngspring.physics.lagrangian import ControlPointForm, DesignForm
from ngspring.physics.pressure import PressureBlocks
from ngspring.physics.void import VoidBlocks

#: Name of a piece of the triangle, and the control point it belongs to.
Piece: TypeAlias = tuple[str, int]


@dataclass(frozen=True)
class StoredEntries:
    """Places of the stored values of a control point's form, block by block.

    Attributes
    ----------
    entries : dict
        Name of a block, and which stored values it consists of.
    places : dict
        Rows and columns of these, within the block.
    void : dict
        Rows and columns of the entries of the void's element matrices.
    pressure : tuple of arrays, optional
        Those of the pressure field's by two displacements, if there is one.
    lam_unit : float
        Unit of lam of the form's values.
    """

    entries: dict[str, IntArray]
    places: dict[str, tuple[IntArray, IntArray]]
    void: dict[str, tuple[IntArray, IntArray]]
    pressure: tuple[IntArray, IntArray] | None
    lam_unit: float

    @classmethod
    def of(cls, form: ControlPointForm) -> StoredEntries:
        """Those of an assembled form."""
        n = form.ndof
        rows, columns = csr_pattern(form.form)
        block_row = np.searchsorted([n, 3 * n], rows, side="right").astype(np.int8)
        block_column = np.searchsorted([n, 3 * n], columns, side="right").astype(np.int8)
        first = (0, n, 3 * n)
        entries: dict[str, IntArray] = {}
        places: dict[str, tuple[IntArray, IntArray]] = {}
        for name, (i, j) in _BLOCKS.items():
            found = np.flatnonzero((block_row == i) & (block_column == j))
            entries[name] = found.astype(np.int32)
            places[name] = rows[found] - first[i], columns[found] - first[j]
        if not all(map(np.array_equal, places["u_u"], places["u_lam"])):
            raise AssertionError("the stored patterns of u-u and u-lam differ")
        r, c = form.void.table.pairs
        twice, both = np.concatenate([r, r]), np.concatenate([c, c + n])
        of_u = np.concatenate([r, r + n]), both
        void = {"chi_chi": (r, c), "chi_u": (twice, both), "chi_lam": (twice, both), "u_lam": of_u}
        pressure = None if form.pressure is None else form.pressure.places
        return cls(entries, places, void, pressure, form.lam_unit)


#: Blocks of the form's own matrix by chi, u and lam.
_BLOCKS = {"chi_chi": (0, 0), "chi_u": (0, 1), "chi_lam": (0, 2), "u_lam": (1, 2), "u_u": (1, 1)}


class PointMaps:
    """Patterns and index maps of the blocks of control points that analyse the same copies.

    Parameters
    ----------
    stored : StoredEntries
    chi : scipy.sparse.csr_matrix
        Dofs <- spline coefficients.
    copies : Images
    """

    def __init__(self, stored: StoredEntries, chi: sp.csr_matrix, copies: Images) -> None:
        self._stored = stored
        self.free = free = copies.free
        self.patterns: dict[str, Pattern] = {}
        self._maps: dict[str, list[sp.csr_matrix]] = {}
        self._void_maps: dict[str, sp.csr_matrix] = {}
        matrices = [copy.matrix for copy in copies.copies]
        inner = [P[:, :free].tocsr() for P in matrices]
        self._share = [copy.share for copy in copies.copies]
        for name, left, right in (
            ("chi_u", [chi] * len(inner), inner),
            ("chi_lam", [chi] * len(inner), matrices),
            # The u-u block has the pattern of the u-lam block, and goes through the same map.
            ("u_lam", matrices, matrices),
        ):
            r, c = stored.places[name]
            pairs = list(zip(left, right, strict=True))
            pattern = united(product_pattern(r, c, *pair) for pair in pairs)
            self.patterns[name] = pattern
            self._maps[name] = [product_map(r, c, *pair, pattern) for pair in pairs]
            self._void_maps[name] = scatter_map(r, c, right[0].shape[0], *stored.void[name])
        if stored.pressure is not None:
            r, c = stored.places["u_lam"]
            self._pressure_map = scatter_map(r, c, matrices[0].shape[0], *stored.pressure)
        self._arrange()

    def _arrange(self) -> None:
        """Which values of the blocks are those of u_Ty, and of the lower triangle."""
        free = self.free
        chi_u, chi_lam, ul = (self.patterns[name] for name in ("chi_u", "chi_lam", "u_lam"))
        top_column = chi_lam.columns == free
        self.chi_top, self.chi_inner = _places(top_column), _places(~top_column)
        if not (
            np.array_equal(chi_lam.rows[self.chi_inner], chi_u.rows)
            and np.array_equal(chi_lam.columns[self.chi_inner], chi_u.columns)
        ):
            raise AssertionError("the patterns of u and lam differ")
        self.inner = _places((ul.rows < free) & (ul.columns < free))
        self.inner_lower = _places(ul.columns[self.inner] <= ul.rows[self.inner])
        self.top = _places((ul.rows == free) & (ul.columns < free))

    def pieces(self, start: int) -> dict[str, tuple[IntArray, IntArray]]:
        """Rows and columns in the lower triangle of the whole, for a point that starts at a row."""
        chi_u, chi_lam, ul = (self.patterns[name] for name in ("chi_u", "chi_lam", "u_lam"))
        rows, columns = ul.rows[self.inner], ul.columns[self.inner]
        lower_rows, lower_columns = rows[self.inner_lower], columns[self.inner_lower]
        of_top = ul.columns[self.top]
        a, b, top = start, start + self.free, start + 2 * self.free

        def on_top(columns: IntArray) -> tuple[IntArray, IntArray]:
            return np.full(len(columns), top), columns

        return {
            "a_chi": (chi_u.columns + a, chi_u.rows),
            "b_chi": (chi_u.columns + b, chi_u.rows),
            "a_a": (lower_rows + a, lower_columns + a),
            "b_a": (rows + b, columns + a),
            "b_b": (lower_rows + b, lower_columns + b),
            "top_chi": on_top(chi_lam.rows[self.chi_top]),
            "top_a": on_top(of_top + a),
            "top_b": on_top(of_top + b),
            "top_top": on_top(np.array([top])),
        }

    def block(
        self,
        name: str,
        k: int,
        values: FloatArray,
        void: VoidBlocks,
        pressure: PressureBlocks | None,
    ) -> FloatArray:
        """The part of copy k in a block, on the independent unknowns.

        Parameters
        ----------
        name : {"chi_u", "chi_lam", "u_u", "u_lam"}
        k : int
        values : array
            Stored values of the control point's form.
        void : VoidBlocks
        pressure : PressureBlocks or None
        """
        share = self._share[k]
        stored = values[self._stored.entries[name]]
        if name.endswith("_lam"):
            stored /= self._stored.lam_unit
        if name in self._void_maps:
            stored += self._void_maps[name] @ _of_elements(name, void, pressure)
        if pressure is not None and name in ("u_u", "u_lam"):
            stored += self._pressure_map @ getattr(pressure, name).ravel()
        if name == "u_u":
            return np.asarray(share * (self._maps["u_lam"][k] @ stored)[self.inner])
        return np.asarray(share * (self._maps[name][k] @ stored))

    def share(self, k: int) -> float:
        """Part of the measure that copy k stands for."""
        return self._share[k]


def _of_elements(name: str, void: VoidBlocks, pressure: PressureBlocks | None) -> FloatArray:
    """Element matrices in the order of the void's map."""
    if name == "u_lam":
        stiffness = void.stiffness.ravel()
        return np.concatenate([stiffness, stiffness])
    element: FloatArray = getattr(void, name)
    if pressure is not None:
        element = element + getattr(pressure, name)
    return element.ravel()


class BlockMaps:
    """From the values of forms to a triangle of the coupled matrix.

    Parameters
    ----------
    form, design : ControlPointForm, DesignForm
        Assembled at least once, so that their patterns exist.
    extraction_chi : sparse matrix
        Dofs <- unknowns.
    copies : sequence of Images
        Of every control point.
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
        copies: Sequence[Images],
        upper: bool,
    ) -> None:
        chi = extraction_chi
        self._stored = stored = StoredEntries.of(form)
        r, c = stored.places["chi_chi"]
        # Symmetric, and the largest map by far: half of it is enough.
        self._pattern = pattern = product_pattern(r, c, chi, chi).lower
        self._map = product_map(r, c, chi, chi, pattern)
        self._void_map = scatter_map(r, c, chi.shape[0], *stored.void["chi_chi"])
        self.chi_diagonal = _places(pattern.columns == pattern.rows)
        self._take_design(design)
        maps = {kind: PointMaps(stored, chi, kind) for kind in dict.fromkeys(copies)}
        self._points = [maps[kind] for kind in copies]
        self._place_pieces(chi.shape[1], upper)

    def _take_design(self, design: DesignForm) -> None:
        """What of C_chi never changes; its forms live on the pattern of the chi-chi block."""
        for form in (design.nonlinear, design.transient, *design.quadratic):
            if not all(map(np.array_equal, csr_pattern(form), self._stored.places["chi_chi"])):
                raise AssertionError("the patterns of the forms of chi differ")
        self._transient = self._map @ stored_values(design.transient)
        quadratic = [self._map @ stored_values(form) for form in design.quadratic]
        self._quadratic = sum(quadratic, np.zeros_like(self._transient))

    def _place_pieces(self, coefficients: int, upper: bool) -> None:
        """Rows and columns of every piece of the lower triangle, whose transpose has its values."""
        pieces: dict[Piece, tuple[IntArray, IntArray]] = {
            ("chi_chi", 0): (self._pattern.rows, self._pattern.columns)
        }
        start = coefficients
        for j, maps in enumerate(self._points):
            pieces |= {(name, j): places for name, places in maps.pieces(start).items()}
            start += 2 * maps.free + 1
        self._store(pieces, start, upper)

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

    def add(self, name: str, values: FloatArray, j: int) -> None:
        """Add to a piece of the triangle, see `write`."""
        self.triangle.data[self._place[name, j]] += values

    def write_control_point(
        self,
        copy: tuple[int, int],
        stored: FloatArray,
        void: VoidBlocks,
        pressure: PressureBlocks | None,
        weight: float,
        scales: tuple[float, float, float],
    ) -> FloatArray:
        """Write the blocks of a control point, in the unknowns a and b.

        Parameters
        ----------
        copy : tuple of int
            Which control point, and which of the copies that it analyses: the first one is
            written, others are added.
        stored : array
            Stored values of the control point's form.
        void : VoidBlocks
        pressure : PressureBlocks or None
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
        j, k = copy
        maps = self._points[j]

        def put(name: str, values: FloatArray) -> None:
            (self.add if k else self.write)(name, values, j)

        def block(name: str) -> FloatArray:
            return maps.block(name, k, stored, void, pressure)

        # One after the other, so that little is held at a time.
        chi_u, chi_lam = block("chi_u"), block("chi_lam")
        put("top_chi", (r * t) * chi_lam[maps.chi_top])
        chi_u *= t
        chi_lam = (t * s) * chi_lam[maps.chi_inner]
        put("a_chi", chi_u + chi_lam)
        put("b_chi", chi_u - chi_lam)
        del chi_u, chi_lam
        bb, kk = block("u_u"), block("u_lam")
        bb_lower = bb[maps.inner_lower]
        kk_lower = (2 * s) * kk[maps.inner][maps.inner_lower]
        put("a_a", bb_lower + kk_lower)
        put("b_a", bb)
        put("b_b", bb_lower - kk_lower)
        put("top_a", r * kk[maps.top])
        put("top_b", r * kk[maps.top])
        # q is eliminated once, and not for every copy.
        self.write("top_top", np.array([-(r**2) / weight]), j)
        own = stored[self._stored.entries["chi_chi"]]
        own += self._void_map @ _of_elements("chi_chi", void, pressure)
        return np.asarray(maps.share(k) * (self._map @ own))

    def diagonal(self) -> FloatArray:
        """Diagonal of the assembled matrix."""
        return np.asarray(self.triangle.data[self._diagonal])

    def design(self, form: DesignForm, chi: FloatArray, dt: float) -> FloatArray:
        """Second derivative of C_chi on the lower triangle's chi-chi pattern."""
        values = self._map @ form.tangent_nonlinear(chi) + self._quadratic
        return np.asarray(values + self._transient / dt if np.isfinite(dt) else values)


def _places(where: NDArray[np.bool_]) -> NDArray[np.int32]:
    return np.flatnonzero(where).astype(np.int32)
