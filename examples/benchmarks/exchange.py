"""A state of the coupled system as nodal values, for a code that shares nothing but the paper.

The other code reads sizes, constants, control points, spline coefficients of chi, and u and lam at
the nodes of the Q2 elements, ``(2 nx + 1) x (2 ny + 1)`` of them; it hands back residuals and
updates in the same form. Neither side learns how the other numbers its unknowns.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from ngspring.kkt.state import State
from ngspring.kkt.system import CoupledSystem, Residual
from ngspring.problem.spring import SpringProblem

CONSTANTS = (
    "L", "H", "T", "K", "G", "E_0", "k_r", "p", "k_rho", "k_i", "n", "k_H", "l_i", "l_t",
)  # fmt: skip


def _values_on_a_line(cells: int) -> sp.csr_matrix:
    """Values at vertices and middles <- vertex values and heights of the bubbles."""
    matrix = sp.lil_matrix((2 * cells + 1, 2 * cells + 1))
    matrix.setdiag(1.0)
    middle = np.arange(1, 2 * cells, 2)
    matrix[middle, middle - 1] = matrix[middle, middle + 1] = 0.5
    return matrix.tocsr()


def nodal_values(system: CoupledSystem) -> sp.csr_matrix:
    """Nodal values of both components, C order, <- independent displacements, u_Ty last."""
    scalar = system.scalar
    nx, ny = system.grid.cells
    place = scalar.node[:, 0] * (2 * ny + 1) + scalar.node[:, 1]
    heights = sp.csr_matrix(
        (scalar.bubble_value, (place, np.arange(scalar.ndof))), shape=(scalar.ndof, scalar.ndof)
    )
    component = sp.kron(_values_on_a_line(nx), _values_on_a_line(ny)) @ heights
    return sp.csr_matrix(sp.block_diag((component, component)) @ system.images[0].copies[0].matrix)


def parameters(problem: SpringProblem, dt: float) -> dict[str, object]:
    """Everything but fields: the numbers of Table 1 and the control points."""
    nx, ny = problem.sector.cells(problem.elements)
    return {
        **{name: getattr(problem, name) for name in CONSTANTS},
        "cells": [nx, ny],
        "elements": problem.elements,
        "dt": dt,
        "points": [
            {"d": p.d, "q": p.q, "w": p.weight, "eta": p.eta} for p in problem.control_points
        ],
    }


def write_state(
    path: Path, system: CoupledSystem, state: State, chi_old: np.ndarray, dt: float
) -> None:
    """The file that the other code reads."""
    problem = system.problem
    if problem.domain != "quarter" or problem.sector.rotation or problem.material is not None:
        raise SystemExit("only plane strain, the paper's law and the quarter are compared")
    nodal = nodal_values(system)
    nx, ny = system.grid.cells
    shape = (len(system.points), 2, 2 * nx + 1, 2 * ny + 1)
    top = np.array([[point.d] for point in system.points])
    u = (nodal @ np.hstack([state.u, top]).T).T.reshape(shape)
    lam = (nodal @ state.lam.T).T.reshape(shape)
    text = json.dumps(parameters(problem, dt))
    grid = problem.coefficient_shape
    np.savez(
        path,
        parameters=np.array(text),
        chi=state.chi.reshape(grid),
        chi_old=chi_old.reshape(grid),
        u=u,
        lam=lam,
    )


def read_residual(path: Path, system: CoupledSystem) -> Residual:
    """Their residual on our unknowns: forces at master nodes, summed by the transposed map."""
    nodal = nodal_values(system)
    with np.load(path) as file:
        chi = file["residual_chi"].ravel()
        points = len(system.points)
        u = (nodal.T @ file["residual_u"].reshape(points, -1).T).T[:, :-1]
        lam = (nodal.T @ file["residual_lam"].reshape(points, -1).T).T
    return Residual(chi, u, lam, {})


def update_distances(path: Path, system: CoupledSystem, update: State) -> dict[str, float]:
    """Largest difference between their Newton update and ours, relative to the largest entry."""
    nodal = nodal_values(system)
    top = np.zeros((len(system.points), 1))
    ours = {
        "chi": update.chi,
        "u": (nodal @ np.hstack([update.u, top]).T).T,
        "lam": (nodal @ update.lam.T).T,
    }
    with np.load(path) as file:
        theirs = {name: file[f"update_{name}"].reshape(ours[name].shape) for name in ours}
    return {
        name: float(np.abs(ours[name] - theirs[name]).max() / np.abs(ours[name]).max())
        for name in ours
    }


def residual_distances(theirs: Residual, ours: Residual) -> dict[str, float]:
    """Norm of the difference of each block, relative to the block's own terms.

    Eq. 8's terms nearly cancel near the optimum: against the largest of them.
    """
    chi = np.linalg.norm(theirs.chi - ours.chi) / max(ours.chi_terms.values())
    return {
        "chi": float(chi),
        "u": float(np.linalg.norm(theirs.u - ours.u) / np.linalg.norm(ours.u)),
        "lam": float(np.linalg.norm(theirs.lam - ours.lam) / np.linalg.norm(ours.lam)),
    }
