# ---
# jupyter:
#   jupytext:
#     formats: py:percent,ipynb
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # 2. One functional, and its derivatives taken by the computer
#
# An optimiser usually consists of many formulas: equilibrium, adjoint equation, sensitivities, and
# the tangent of each. In the method of Bluhm, Sigmund and Poulios (2023) they all come from one
# functional, Eq. 5,
#
# $$C^* = \sum_j C_q^{(j)}(q^{(j)})
#   + \mathcal{R}^{(j)}\big(\chi, u^{(j)}, q^{(j)};\; \lambda^{(j)}, \mu^{(j)}\big)
#   + C_\chi(\chi) .$$
#
# Its stationary point is the optimal spring: the derivative with respect to the multipliers
# $(\lambda,\mu)$ is equilibrium (Eq. 4), that with respect to $(u,q)$ the adjoint equation (Eq. 7),
# that with respect to $\chi$ the optimality condition (Eq. 8). So $C^*$ is all that has to be
# written. NGSolve differentiates it, once for the residual and once more for Newton's matrix.
#
# This notebook writes sections 2.2 to 2.5 of the paper for one control point, checks the
# derivatives, and lets Newton's method loose on it.

# %%
# %matplotlib inline
import ngsolve as ng
import numpy as np
import scipy.sparse as sp
from ngsolve.meshes import MakeStructured2DMesh
from ngsolve.webgui import Draw

from ngspring import taylor_test
from ngspring.view.figure import new_figure

ng.SetNumThreads(1)  # a problem this small is slower on several threads

# %% [markdown]
# ## The unknowns
#
# One quarter of the spring, $[0, 50]\times[0, 50]$ mm, on a mesh of 8 x 8 squares. $\chi$ is the
# design (positive: solid), $u$ the displacement, $q$ the force. $\lambda$ and $\mu$ are their
# multipliers. The right side is a plane of symmetry and so is the top, whose mean displacement is
# prescribed through $q$; the bottom stands on the ground.

# %%
mesh = MakeStructured2DMesh(quads=True, nx=8, ny=8, mapping=lambda x, y: (50 * x, 50 * y))
design = ng.H1(mesh, order=2)
displacement = ng.VectorH1(mesh, order=2, dirichletx="right", dirichlety="bottom")
number = ng.NumberSpace(mesh)
V = ng.FESpace([design, displacement, displacement, number, number])
chi, u, lam, q, mu = V.TrialFunction()
chi_old, dt = ng.GridFunction(design), ng.Parameter(1e4)
print("unknowns:", V.ndof)

# %% [markdown]
# ## The functional
#
# The constants of Table 1 first; the mesh is coarse, so the interface width $l_i$ is 5 mm here.
# The one control point asks for $q_* = -2$ N at $d=-10$ mm (compression).

# %%
K, G, H, E_0, p, k_r = 5 / 3, 5 / 14, 100.0, 1e-6, 8, 1e-6
k_rho, k_i, n, k_H, l_i, l_t = 1e-8, 1e-2, 6, 1e-9, 5.0, 8.0
d, q_target = ng.Parameter(-10.0), -2.0

# %% [markdown]
# What follows is the method, from Eq. 2 to Eq. 19, line by line:
#
# | in the paper | |
# |---|---|
# | Eqs. 2, 3 | density $\rho = 1/(1+e^{-\chi})$, stiffness $\mathcal E = \mathcal E_0 + (1-\mathcal E_0)\,\rho/(1+p(1-\rho))$ |
# | Eq. 15 | void indicator $\mathcal I = 6t^5-15t^4+10t^3$, $t=\langle -5-\chi\rangle_{[0,1]}$ |
# | Eqs. 13, 14 | $\Psi = \mathcal E\big(\tfrac K2\ln^2\lvert F\rvert + \tfrac G2(\lvert F\rvert^{-2/3}\lVert F\rVert^2-3)\big) + \tfrac{k_r}2KH^2\,\mathcal I\,\mathbb Hu:\mathbb Hu$ |
# | Eq. 16 | $\Psi_{,u}(\chi,u;\lambda)$: the derivative of $\Psi$ in the direction $\lambda$ |
# | Eqs. 18, 19 | $\mathcal R = \int \Psi_{,u}(\chi,u;\lambda) - (\text{mean of }q\,\lambda_y+(u_y-d)\,\mu \text{ on the top})$ |
# | Eq. 9 | $C_q = \tfrac w2 (q-q_*)^2$ |
# | Eqs. 11, 12 | $C_\chi = \int k_\rho\rho + \tfrac{k_i}n\langle\lVert\nabla\chi\rVert-8/l_i\rangle^n + \tfrac{k_H}2\mathbb H\chi:\mathbb H\chi + \tfrac1{2\Delta t}\big((\chi-\chi^*)^2+l_t^2\lVert\nabla(\chi-\chi^*)\rVert^2\big)$ |
#
# `Diff` takes the derivative of Eq. 16, too: no stress tensor (Eq. 17) is written anywhere.

# %%
grad_u, Hu, Hlam = ng.Grad(u), u.Operator("hesse"), lam.Operator("hesse")
F = ng.Id(2) + grad_u
J = ng.Det(F)
rho = 1 / (1 + ng.exp(-chi))
E = E_0 + (1 - E_0) * rho / (1 + p * (1 - rho))
t = ng.IfPos(-5 - chi, ng.IfPos(-6 - chi, 1, -5 - chi), 0)
void = 6 * t**5 - 15 * t**4 + 10 * t**3
psi = K / 2 * ng.log(J) ** 2 + G / 2 * (J ** (-2 / 3) * (ng.InnerProduct(F, F) + 1) - 3)
work = E * psi.Diff(grad_u, ng.Grad(lam))
void_work = k_r * K * H**2 * void * ng.InnerProduct(Hu, Hlam)

change, grad_change = chi - chi_old, ng.grad(chi) - ng.grad(chi_old)
squared, limit = ng.InnerProduct(ng.grad(chi), ng.grad(chi)), 8 / l_i
slope = ng.sqrt(ng.IfPos(squared - limit**2, squared, limit**2))
curvature = ng.InnerProduct(chi.Operator("hesse"), chi.Operator("hesse"))
transient = (change**2 + l_t**2 * ng.InnerProduct(grad_change, grad_change)) / (2 * dt)
C_chi = k_rho * rho + k_i / n * (slope - limit) ** n + k_H / 2 * curvature + transient

C_star = ng.BilinearForm(V, symmetric=True)
for density in (work, void_work, C_chi):
    C_star += ng.Variation((4 * density).Compile() * ng.dx)  # 4 quarters
C_star += ng.Variation((q - q_target) ** 2 / 2 / 50**2 * ng.dx)  # per area of the quarter
C_star += ng.Variation(-(2 * q * lam[1] + (2 * u[1] - d) * mu) / 50 * ng.ds("top"))

# %% [markdown]
# ## Are the derivatives right?
#
# A Taylor test asks the functional itself. Take any state $x$ and any direction $y$, and compare
# $C^*(x+ty)$ with its Taylor expansions:
#
# $$\big|C^*(x+ty)-C^*(x)-t\,C^*_{,x}(x;y)\big| = O(t^2),\qquad
#   \big|\ldots-\tfrac{t^2}{2}C^*_{,x,x}(x;y;y)\big| = O(t^3).$$
#
# If a derivative is wrong by ever so little, the order drops to 1 (or 2). `ngspring.taylor_test`
# does it for any functional. The state is rough on purpose: random values in every field.

# %%
state = ng.GridFunction(V)
vector, result, direction = state.vec, state.vec.CreateVector(), state.vec.CreateVector()


def functional(x):
    vector.FV().NumPy()[:] = x
    return C_star.Energy(vector)


def gradient(x):
    vector.FV().NumPy()[:] = x
    C_star.Apply(vector, result)
    return result.FV().NumPy().copy()


def hessian(x, y):
    vector.FV().NumPy()[:] = x
    direction.FV().NumPy()[:] = y
    C_star.AssembleLinearization(vector)
    result.data = C_star.mat * direction
    return result.FV().NumPy().copy()


random = np.random.default_rng(0)
size = np.concatenate([np.full(design.ndof, 2.0), np.full(V.ndof - design.ndof, 0.3)])
x, y = size * random.uniform(-1, 1, (2, V.ndof))
test = taylor_test(functional, gradient, x, y, hessian, steps=0.5 ** np.arange(2, 9))
print(test)

# %%
figure = new_figure(5.2, 3.8)
axes = figure.subplots()
for remainder, line, label in (
    (test.first_remainders, "o-", "after the first derivative"),
    (test.second_remainders, "s-", "after the second"),
):
    axes.loglog(test.steps, remainder, "k" + line, markerfacecolor="white", label=label)
for order, remainder in ((2, test.first_remainders), (3, test.second_remainders)):
    guide = 0.4 * remainder[0] * (test.steps / test.steps[0]) ** order
    axes.loglog(test.steps, guide, "k:", linewidth=1)
    axes.annotate(f"slope {order}", (test.steps[3], 0.45 * guide[3]))
axes.set_xlabel("step t")
axes.set_ylabel("remainder of C*")
axes.grid(color="0.9")
axes.legend()
figure

# %% [markdown]
# Slopes 2 and 3: both derivatives are right. And a second derivative is symmetric, so Newton's
# matrix must be:

# %%
values, columns, rows = (np.array(part) for part in C_star.mat.CSR())
matrix = sp.csr_matrix((values, columns, rows.astype(int)))
asymmetry = abs(matrix - matrix.T).max() / abs(matrix).max()
print(f"largest difference between the matrix and its transpose: {asymmetry:.1e}")

figure = new_figure(4.8, 4.8)
axes = figure.subplots()
axes.spy(abs(matrix) > 0, markersize=0.25, color="black")
ends = np.cumsum([0, design.ndof, displacement.ndof, displacement.ndof])
for end in ends[1:]:
    axes.axhline(end - 0.5, color="0.6", linewidth=0.8)
    axes.axvline(end - 0.5, color="0.6", linewidth=0.8)
axes.set_xticks((ends[1:] + ends[:-1]) / 2, ["χ", "u", "λ"])
axes.set_yticks((ends[1:] + ends[:-1]) / 2, ["χ", "u", "λ"])
axes.set_title("Newton's matrix (the last rows: q, μ)", fontsize=10)
figure

# %% [markdown]
# The blocks can be read like a text. $(\lambda,u)$ is the ordinary tangent stiffness, $(\lambda,
# \chi)$ the sensitivity of equilibrium to the design. $(\lambda,\lambda)$ is empty because $C^*$ is
# linear in its multipliers: the stationary point is a saddle, and no method that minimises will
# find it. Newton's method does not mind.
#
# ## Newton's method on everything at once

# %%
free = V.FreeDofs()
fields = state.components


def newton(most=12):
    """Newton's method on C*; returns the largest change of chi and of u in each iteration."""
    sizes = []
    for _ in range(most):
        C_star.Apply(vector, result)
        C_star.AssembleLinearization(vector)
        if not np.isfinite(result.Norm()):
            break  # an element was turned inside out: the caller takes a smaller step
        direction.data = C_star.mat.Inverse(free, "umfpack") * result
        vector.data -= direction
        step = direction.FV().NumPy()
        sizes.append([abs(step[: design.ndof]).max(), abs(step[ends[1] : ends[2]]).max()])
        if max(sizes[-1]) < 1e-8:
            return np.array(sizes)
    return np.array([[np.inf, np.inf]])


# %% [markdown]
# Start from a column. While $\Delta t$ is tiny the design cannot move, and the same Newton's method
# is just the forward and adjoint analysis of the column; the load is applied in five steps.
# Then take $\Delta t = 100$ for a first design update: design, displacement, force and multipliers
# are solved for together.

# %%
across, along = 2 * np.pi * (ng.x / 100 - 0.5), 2 * np.pi * (ng.y / 100 - 0.5)
vector[:] = 0.0
fields[0].Set(3 * ng.cos(across) * (1 - ng.cos(along) / 2))
chi_old.vec.data = fields[0].vec
dt.Set(1e-6)
for load in np.linspace(-2, -10, 5):
    d.Set(load)
    sizes = newton()
    print(f"d = {load:5.1f} mm: q = {fields[3].vec[0]:.4f} N after {len(sizes)} iterations")

dt.Set(100.0)
sizes = newton()
print("iteration    change of chi    change of u [mm]")
for k, (of_chi, of_u) in enumerate(sizes, start=1):
    print(f"{k:6d} {of_chi:18.1e} {of_u:18.1e}")
error = ng.Integrate(2 * fields[2][1] / 50, mesh, definedon=mesh.Boundaries("top"))
print(f"q = {fields[3].vec[0]:.4f} N, q - q* = {fields[3].vec[0] - q_target:.4f} N")
print(f"twice the mean of lambda_y on the top: {error:.4f}")

# %% [markdown]
# The number of correct digits doubles with each iteration: that is what exact second derivatives
# buy. The multiplier has a meaning, too. By the first line of Eq. 7 its mean on the top is the
# error of the force, $q - q_*$ (twice the mean here, because the top of the quarter moves by $d/2$): the
# adjoint problem is the spring loaded by its own error.
#
# ## The whole evolution
#
# Let $\Delta t$ grow, always starting from the last design, as in section 2.4. Nothing else is
# needed for a (very coarse) topology optimisation.

# %%
path = [(0, dt.Get(), fields[3].vec[0])]
for update in range(1, 21):
    before = vector.CreateVector()
    before.data = vector
    chi_old.vec.data = fields[0].vec
    sizes = newton()
    if not max(sizes[-1]) < 1e-8:
        vector.data = before
        dt.Set(dt.Get() / 4)
        continue
    path.append((update, dt.Get(), fields[3].vec[0]))
    dt.Set(dt.Get() * (4 if len(sizes) < 6 else 1))
update, steps, force = np.array(path).T
print(f"after {len(path) - 1} updates: dt = {steps[-1]:.0e}, q = {force[-1]:.5f} N")

# %%
figure = new_figure(9.6, 3.4)
left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1, 1.25))
places = np.linspace(0.5, 99.5, 100)
points = [mesh(min(a, 100 - a), min(b, 100 - b)) for b in places for a in places]
start = 3 * np.cos(2 * np.pi * (places / 100 - 0.5))[None, :]
start = start * (1 - np.cos(2 * np.pi * (places / 100 - 0.5)) / 2)[:, None]
final = np.array([fields[0](point) for point in points]).reshape(100, 100)
for axes, values, title in ((left, start, "start"), (middle, final, "end")):
    density = 1 / (1 + np.exp(-values))
    axes.imshow(density, cmap="Greys", vmin=0, vmax=1, origin="lower", extent=(0, 100, 0, 100))
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("x [mm]")
left.set_ylabel("y [mm]")
right.semilogx(steps, force, "k.-")
right.axhline(q_target, color="0.6", linestyle="--")
right.annotate("target", (steps[0], q_target), xytext=(0, 4), textcoords="offset points")
right.set_xlabel("pseudo-time step Δt")
right.set_ylabel("force q [N]")
right.grid(color="0.9")
figure

# %%
scene = Draw(1 / (1 + ng.exp(-fields[0])), mesh, "density", deformation=fields[1], min=0, max=1)

# %% [markdown]
# The target is met. With a finite $\Delta t$ the design is not stationary yet, and on this mesh parts
# of it are grey; [notebook 3](03_design_your_own.ipynb) goes all the way to $\Delta t=\infty$.
#
# ngspring is this notebook with more care: $\chi$ in $C^1$ splines (`ngspring.fem.grid`), several
# control points with one block each (`ngspring.physics.lagrangian`), a fast linear solver
# (`ngspring.kkt.system`), and rules for $\Delta t$ (`ngspring.evolution.steprule`). The functional is
# the same.

# %%
orders = (test.first_order, test.second_order)
print(f"orders {orders[0]:.2f} and {orders[1]:.2f}; force {force[-1]:.4f} N")
