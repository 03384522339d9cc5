"""The paper's coupled system in GetFEM, written from its equations alone (no ngspring here).

Run by the Python that has GetFEM (Debian: ``apt-get install python3-getfem``, /usr/bin/python3)::

    python3 getfem_code.py STATE.npz

It takes commands from standard input, a line of JSON each, and answers each with another one
(`COMMANDS`). ``run.py`` sends them.

As in 2.7 everything is one monolithic model of GetFEM: chi in C1 quadratic B-splines, and u, q and
their adjoints for each control point on Q2 elements with nine Gauss points. GetFEM gets the
augmented functional C* of Eq. 5 as a potential; its first variation (Eqs. 4, 7, 8) and its second
one are GetFEM's own automatic derivatives. Debian's version has no B-splines yet: they are a
reduction of Q2, as the displacements' spaces are.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable

import getfem as gf
import numpy as np
import scipy.sparse as sp
from scipy.io import mmwrite

# Letters as in the paper. The quarter stands for four; its top moves by half of d.
MACROS = {
    "rho(c)": "(1/(1+exp(-(c))))",  # Eq. 2
    "stiff(c)": "(E_0+(1-E_0)*rho(c)/(1+p*(1-rho(c))))",  # Eq. 3
    "F(u)": "(Id(2)+Grad_u)",  # Eq. 13, in the plane
    # Eq. 17, in the plane: the third stretch is 1.
    "P(u)": "(K*log(Det(F(u)))*Inv(F(u))'"
    "+G*pow(Det(F(u)),-2/3)*(F(u)-(Norm_sqr(F(u))+1)/3*Inv(F(u))'))",
    "HH(u,v)": "(Hess_u(1,:,:):Hess_v(1,:,:)+Hess_u(2,:,:):Hess_v(2,:,:))",
}
RAMP = "min(1,max(0,-5-t))"
#: Eq. 15 with its derivatives: GetFEM cannot differentiate a Heaviside function.
FUNCTIONS = {
    "d_void": (f"-30*sqr({RAMP})*sqr(1-{RAMP})", f"60*{RAMP}*(1-{RAMP})*(1-2*{RAMP})"),
    "void": (f"pow({RAMP},3)*(10+{RAMP}*(6*{RAMP}-15))", "d_void(t)"),
}
#: Eq. 11; <t>^n = (2 half_sqr_pos_part(t))^(n/2), whose second derivative GetFEM knows.
DESIGN = (
    "4*T*(k_rho*rho(chi)"
    "+k_i/n*pow(2*half_sqr_pos_part(Norm(Grad_chi)-8/l_i),n/2)"
    "+k_H/2*Norm_sqr(Hess_chi)"
    "+rate/2*(sqr(chi-chi_old)+l_t*l_t*Norm_sqr(Grad_chi-Grad_chi_old)))"
)
#: Eq. 16 with the adjoint displacement as the test function: first part of Eq. 19.
WORK = "4*T*(stiff(chi+eta{j})*(P(u{j}):Grad_l{j})+k_r*K*H*H*void(chi+eta{j})*HH(u{j},l{j}))"
#: Second part of Eq. 19, and Eq. 9, per length of the top side.
TOP = "(w{j}/2*sqr(q{j}-target{j})-(q{j}*2*l{j}(2)+(2*u{j}(2)-d{j})*m{j}))/width"
TOP_SIDE = 1
#: One full Newton step with MUMPS (symmetric, since the model is), no line search: any ratio of
#: the residuals is accepted.
NEWTON = (
    "max_iter", 1, "max_res", 0.0, "lsolver", "mumps", "lsearch", "simplest",
    "alpha min", 1.0, "alpha max ratio", 1e300,
)  # fmt: skip
CONSTANTS = ("T", "K", "G", "H", "E_0", "k_r", "p", "k_rho", "k_i", "n", "k_H", "l_i", "l_t")


def spmat(matrix: sp.spmatrix) -> gf.Spmat:
    """A sparse matrix of GetFEM, whose Python interface takes whole ones from files only."""
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/matrix.mtx"
        mmwrite(path, matrix, precision=17)
        return gf.Spmat("load", "mm", path)


def spline_line(cells: int, ghost: bool) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Values at the 2 cells + 1 nodes of a line <- coefficients of C1 quadratic B-splines (2.7).

    Symmetric about the far end; at the near one nothing (``ghost``) or no slope. The second matrix
    gives the coefficients back.
    """
    values = sp.lil_matrix((2 * cells + 1, cells + 2))
    back = sp.lil_matrix((cells + 1, 2 * cells + 1))
    for i in range(cells + 1):
        values[2 * i, i] = values[2 * i, i + 1] = 0.5
    for i in range(cells):
        values[2 * i + 1, i : i + 3] = [0.125, 0.75, 0.125]
        back[i + 1, 2 * i : 2 * i + 3] = [-0.5, 2.0, -0.5]
    back[0, :3] = [2.5, -2.0, 0.5]
    fold = np.arange(cells + 2)
    fold[-1] = fold[-2]
    if not ghost:
        fold = np.maximum(fold, 1) - 1
    columns = sp.csr_matrix((np.ones(cells + 2), (np.arange(cells + 2), fold)))
    return sp.csr_matrix(values.tocsr() @ columns), back.tocsr()[0 if ghost else 1 :]


class Quarter:
    """Mesh, and the reduced spaces of 2.5 and 2.7 on Q2 elements."""

    def __init__(self, cells: tuple[int, int], L: float, H: float) -> None:
        self.cells = nx, ny = cells
        self.size = width, height = L / 2, H / 2
        x, y = np.linspace(0, width, nx + 1), np.linspace(0, height, ny + 1)
        self.mesh = gf.Mesh("cartesian", x, y)
        top = self.mesh.outer_faces_in_box([-width, height * (1 - 1e-9)], [2 * width, 2 * height])
        self.mesh.set_region(TOP_SIDE, top)
        self.integration = gf.MeshIm(self.mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(2,5)"))
        scalar = self._space(1)
        self.place = self._places(scalar.basic_dof_nodes())
        self.chi = self._space(1)
        self._reduce_chi()
        self.u = self._space(2)
        self._reduce_u()

    def _space(self, components: int) -> gf.MeshFem:
        space = gf.MeshFem(self.mesh, components)
        space.set_fem(gf.Fem("FEM_QK(2,2)"))
        return space

    def _places(self, nodes: np.ndarray) -> np.ndarray:
        """Number of each dof's node in the C order of the (2 nx + 1) x (2 ny + 1) grid."""
        steps = [2 * n / s for n, s in zip(self.cells, self.size, strict=True)]
        i, j = (np.rint(nodes[k] * steps[k]).astype(int) for k in (0, 1))
        return i * (2 * self.cells[1] + 1) + j

    def _reduce_chi(self) -> None:
        nx, ny = self.cells
        (in_x, back_x), (in_y, back_y) = spline_line(nx, True), spline_line(ny, False)
        splines = sp.kron(in_x, in_y, format="csr")[self.place]
        back = sp.kron(back_x, back_y, format="csc")[:, self.place]
        self.chi.reduction_matrices(spmat(back), spmat(splines))

    def _reduce_u(self) -> None:
        """u_x is one value on the left and 0 on the right; u_y is 0 below and one value on top."""
        nx, ny = self.cells
        i, j = np.divmod(self.place, 2 * ny + 1)
        n = len(i)
        master = np.arange(2 * n)
        x, y = 2 * np.arange(n), 2 * np.arange(n) + 1
        left, top = i == 0, j == 2 * ny
        master[x[left]] = x[left][0]
        master[y[top]] = y[top][0]
        master[x[i == 2 * nx]] = -1
        master[y[j == 0]] = -1
        used = np.flatnonzero(master >= 0)
        self.masters, column = np.unique(master[used], return_inverse=True)
        ones = np.ones(len(used))
        self.extension = sp.csr_matrix((ones, (used, column)), shape=(2 * n, len(self.masters)))
        choose = (np.ones(len(self.masters)), (np.arange(len(self.masters)), self.masters))
        restriction = sp.csr_matrix(choose, shape=(len(self.masters), 2 * n))
        self.top = int(np.flatnonzero(self.masters == y[top][0])[0])
        self.u.reduction_matrices(spmat(restriction), spmat(self.extension))

    def from_nodes(self, nodal: np.ndarray) -> np.ndarray:
        """Reduced dofs of a displacement given at all nodes, (2, nodes, nodes)."""
        values = nodal.reshape(2, -1)[:, self.place].T.ravel()
        return values[self.masters]

    def to_nodes(self, reduced: np.ndarray) -> np.ndarray:
        return self._on_grid(self.extension @ reduced)

    def forces_to_nodes(self, reduced: np.ndarray) -> np.ndarray:
        """Forces at the nodes of the masters, zero elsewhere."""
        basic = np.zeros(2 * len(self.place))
        basic[self.masters] = reduced
        return self._on_grid(basic)

    def _on_grid(self, basic: np.ndarray) -> np.ndarray:
        nodal = np.empty((2, len(self.place)))
        nodal[:, self.place] = basic.reshape(-1, 2).T
        nx, ny = self.cells
        return nodal.reshape(2, 2 * nx + 1, 2 * ny + 1)


class Springs:
    """One monolithic model of chi, and u, q and their adjoints l, m at every point (2.7)."""

    def __init__(self, given: dict) -> None:
        self.given, self.points = given, given["points"]
        self.quarter = Quarter(tuple(given["cells"]), given["L"], given["H"])
        self.model = model = gf.Model("real")
        for name, (function, derivative) in FUNCTIONS.items():
            gf.asm_define_function(name, 1, function, derivative)
        for name, text in MACROS.items():
            model.add_macro(name, text)
        for name in CONSTANTS:
            model.add_initialized_data(name, [float(given[name])])
        model.add_initialized_data("width", [self.quarter.size[0]])
        model.add_initialized_data("rate", [0.0])
        model.add_fem_variable("chi", self.quarter.chi)
        model.add_fem_data("chi_old", self.quarter.chi)
        self._add(DESIGN)
        for j, point in enumerate(self.points):
            self._add_point(j, point)

    def _add_point(self, j: int, point: dict) -> None:
        for name in "ul":
            self.model.add_fem_variable(f"{name}{j}", self.quarter.u)
        for name in "qm":
            self.model.add_variable(f"{name}{j}", 1)
        for name, key in (("d", "d"), ("target", "q"), ("w", "w"), ("eta", "eta")):
            self.model.add_initialized_data(f"{name}{j}", [float(point[key])])
        self._add(WORK.format(j=j))
        self._add(TOP.format(j=j), TOP_SIDE)

    def _add(self, potential: str, region: int = -1) -> None:
        self.model.add_nonlinear_term(self.quarter.integration, potential, region, True, False)

    def load(self, state: dict[str, np.ndarray], dt: float) -> None:
        """Take in a state; q and the multipliers of q follow from Eqs. 4 and 7."""
        model, quarter = self.model, self.quarter
        model.set_variable("chi", state["chi"].ravel())
        model.set_variable("chi_old", state["chi_old"].ravel())
        model.set_variable("rate", [1 / dt])
        for j, point in enumerate(self.points):
            u, adjoint = (quarter.from_nodes(state[name][j]) for name in ("u", "lam"))
            model.set_variable(f"u{j}", u)
            model.set_variable(f"l{j}", adjoint)
            model.set_variable(f"q{j}", [point["q"] + 2 * adjoint[quarter.top] / point["w"]])
            model.set_variable(f"m{j}", [0.0])
        residual = self.residual()
        for j in range(len(self.points)):
            model.set_variable(f"m{j}", [residual[f"u{j}"][quarter.top] / 2])

    def parts(self, vector: np.ndarray) -> dict[str, np.ndarray]:
        """A vector of all unknowns, by variable."""
        names = ["chi", *(f"{name}{j}" for j in range(len(self.points)) for name in "ulqm")]
        parts = {}
        for name in names:
            first, size = self.model.interval_of_variable(name)
            parts[name] = vector[first : first + size]
        return parts

    def stacked(self, parts: dict[str, np.ndarray], name: str, to_nodes: Callable) -> np.ndarray:
        """One field of all control points, at the nodes."""
        return np.array([to_nodes(parts[f"{name}{j}"]) for j in range(len(self.points))])

    def residual(self) -> dict[str, np.ndarray]:
        self.model.assembly("build_rhs")
        return self.parts(-self.model.rhs())

    def newton_step(self) -> np.ndarray:
        """GetFEM's own: residual, matrix, MUMPS, and the residual at the new state; the update."""
        before = self.model.from_variables()
        self.model.solve(*NEWTON)
        return self.model.from_variables() - before

    @property
    def width(self) -> float:
        """W/H of Eq. 20."""
        volume = gf.asm_generic(self.quarter.integration, 0, "4*T*rho(chi)", -1, self.model)
        return float(np.ravel(volume)[0]) / (self.given["H"] ** 2 * self.given["T"])


# -- the paper's evolution -------------------------------------------------------------------------

#: As in ngspring: largest changes of chi and of u / H, and force out of balance over its target.
CHI, U, FORCE = 1e-3, 1e-6, 1e-6
MOST, FEW, END, SMALLEST = 10, 6, 1e20, 1e-8


class NotConvergedError(ArithmeticError):
    """A Newton iteration that does not converge."""


def design_update(springs: Springs, dt: float) -> int:
    """Backward Euler over dt: how many Newton iterations it took (2.7).

    Raises
    ------
    NotConvergedError
        With the number of iterations.
    """
    model, height = springs.model, springs.given["H"]
    model.set_variable("chi_old", model.variable("chi"))
    model.set_variable("rate", [0.0 if np.isinf(dt) else 1 / dt])
    previous = np.inf
    for iteration in range(1, MOST + 1):
        try:
            update = springs.parts(springs.newton_step())
        except RuntimeError as error:
            raise NotConvergedError(iteration) from error
        change = max(np.abs(update["chi"]).max(), 0.0)
        residual = springs.parts(-model.rhs())
        finite = all(np.isfinite(part).all() for part in residual.values())
        if not finite or not change < 1e3 or (iteration > 1 and change > max(previous, 2.0)):
            raise NotConvergedError(iteration)
        previous = change
        moved = max(np.abs(update[f"u{j}"]).max() for j in range(len(springs.points))) / height
        force = max(
            np.linalg.norm(residual[f"l{j}"]) / abs(point["q"])
            for j, point in enumerate(springs.points)
        )
        if change <= CHI and moved <= U and force <= FORCE:
            return iteration
    raise NotConvergedError(MOST)


def evolve(springs: Springs, dt: float, seconds: float, most_updates: int) -> dict[str, object]:
    """From the present state to the stationary point by the paper's rule for dt."""
    start = time.perf_counter()
    counts = dict.fromkeys(("updates", "rejected", "iterations", "rejected_iterations"), 0)
    message = ""
    while not message:
        dt = np.inf if dt > END else dt
        before = springs.model.from_variables()
        try:
            iterations = design_update(springs, dt)
        except NotConvergedError as failure:
            springs.model.to_variables(before)
            counts["rejected"] += 1
            counts["rejected_iterations"] += failure.args[0]
            dt = END / 4 if np.isinf(dt) else dt / 4
            message = "" if dt > SMALLEST else "dt fell below its bound"
        else:
            counts["updates"] += 1
            counts["iterations"] += iterations
            message = "converged" if np.isinf(dt) else ""
            dt = 2 * dt if iterations < FEW else dt
        if not message and time.perf_counter() - start > seconds:
            message = "out of time"
        if not message and counts["updates"] >= most_updates:
            message = "stopped as asked"
    passed = time.perf_counter() - start
    q = [float(springs.model.variable(f"q{j}")[0]) for j in range(len(springs.points))]
    return {"seconds": passed, **counts, "message": message, "q": q, "width": springs.width}


# -- commands --------------------------------------------------------------------------------------


def peak_memory() -> float:
    """Of this process, in GB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def compare(springs: Springs, given: dict, out: str) -> dict[str, object]:
    """Write the residual and the Newton update at the state that was read."""
    springs.load(given, springs.given["dt"])
    quarter = springs.quarter
    residual = springs.residual()
    update = springs.parts(springs.newton_step())
    np.savez(
        out,
        residual_chi=residual["chi"],
        residual_u=springs.stacked(residual, "u", quarter.forces_to_nodes),
        residual_lam=springs.stacked(residual, "l", quarter.forces_to_nodes),
        update_chi=update["chi"],
        update_u=springs.stacked(update, "u", quarter.to_nodes),
        update_lam=springs.stacked(update, "l", quarter.to_nodes),
    )
    return {"out": out}


def iterate(springs: Springs, given: dict) -> dict[str, object]:
    """Time one coupled Newton iteration from the state that was read.

    GetFEM's step takes the residual before and after it; an iteration within its loop has one.
    """
    springs.load(given, springs.given["dt"])
    marks = [(time.perf_counter(), time.process_time())]
    for option in ("build_rhs", "build_matrix", None):
        if option is None:
            springs.newton_step()
        else:
            springs.model.assembly(option)
        marks.append((time.perf_counter(), time.process_time()))
    (residual, residual_cpu), (assembly, _), (step, step_cpu) = np.diff(marks, axis=0)
    return {
        "iteration": step - residual,
        "cpu": step_cpu - residual_cpu,
        "assembly": assembly,
        "linear": step - 2 * residual - assembly,
        "residual": residual,
        "unknowns": int(springs.model.nbdof()),
        "memory": peak_memory(),
    }


def run(
    springs: Springs, given: dict, seconds: float, dt: float, most_updates: int
) -> dict[str, object]:
    """A whole run from the state that was read; without the second residual of each step."""
    springs.load(given, dt)
    residuals = []
    for _ in range(5):
        start = time.perf_counter()
        springs.residual()
        residuals.append(time.perf_counter() - start)
    outcome = evolve(springs, dt, seconds, most_updates)
    twice = statistics.median(residuals) * (outcome["iterations"] + outcome["rejected_iterations"])
    return {**outcome, "seconds": outcome["seconds"] - twice, "memory": peak_memory()}


COMMANDS = {"compare": compare, "iterate": iterate, "run": run}


def answer(springs: Springs, given: dict, line: str) -> dict[str, object]:
    """What a command gives, or what went wrong."""
    command = json.loads(line)
    try:
        return COMMANDS[command.pop("do")](springs, given, **command)
    except RuntimeError as error:
        return {"error": str(error).strip().splitlines()[-1]}


def main(path: str) -> None:
    # Whatever GetFEM and MUMPS print goes to standard error.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    gf.util_trace_level(0)
    with np.load(path) as file:
        given = {name: file[name] for name in file.files}
    springs = Springs(json.loads(str(given["parameters"])))
    print(json.dumps({"ready": True}), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(answer(springs, given, line)), file=answers, flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
