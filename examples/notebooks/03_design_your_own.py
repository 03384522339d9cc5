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
# # 3. Design your own spring
#
# A spring is asked for by points of its load-displacement curve: so many newtons at so many
# millimetres. This notebook asks for one that is linear at first, 2 N at 10 mm in tension and in
# compression, but pushes back with 5.5 N at 20 mm of compression. (It is case C7 of the paper, so
# that there is something to compare with. Change the numbers and run it again: any curve that
# starts at zero and rises is worth a try.)
#
# The objective (Eqs. 1 and 9) is the distance to the targets plus a very small price on volume,
#
# $$C = \sum_j \frac{w_q^{(j)}}2\Big(q^{(j)}-q_*^{(j)}\Big)^2
#   + \int k_\rho\,\rho(\chi)\,\mathrm dV + \ldots$$
#
# so among all springs that hit the targets the lightest is wanted.

# %%
# %matplotlib inline
import numpy as np
from ngsolve.webgui import Draw

import ngspring
from ngspring import ControlPoint, SpringProblem
from ngspring.analysis.finished import responses_of
from ngspring.analysis.forward import control_point_responses
from ngspring.physics.chi import rho
from ngspring.view.curves import draw_curve
from ngspring.view.design import draw_design
from ngspring.view.fields import design_fields
from ngspring.view.figure import new_figure
from ngspring.view.rows import design_figure
from ngspring.view.run import convergence_figure

THREADS = 1  # more on a machine that has nothing else to do

# %% [markdown]
# ## Targets in
#
# Tension is positive. The mesh has 16 x 16 elements, so coarse that a run takes seconds; the
# interface between solid and void has to be as wide as 4/5 of an element, $l_i = 5$ mm. Everything
# that is not named has the paper's value (Table 1).

# %%
targets = [ControlPoint(d=10, q=2), ControlPoint(d=-10, q=-2), ControlPoint(d=-20, q=-5.5)]
problem = SpringProblem(targets, name="my spring", elements=16, l_i=5.0)
start = ngspring.Design.column(problem)
print(problem.to_toml())

# %% [markdown]
# ## Watch it
#
# `optimize` calls an observer after every design update. This one draws the design and the forces
# and replaces the last picture (in a notebook; as a script it prints a line instead).

# %%
try:
    from IPython import get_ipython
    from IPython.display import display

    in_notebook = get_ipython() is not None
except ImportError:
    in_notebook = False


class Watch:
    """Shows the design, the forces over their targets, and the volume as the run goes on."""

    def __init__(self, every):
        self.every, self.rows, self.handle = every, [], None

    def __call__(self, update):
        if not update.accepted:
            return
        self.rows.append(update.row)
        count = len(self.rows) - 1
        if count % self.every and np.isfinite(update.dt):
            return
        if not in_notebook:
            width = update.row["width"]
            print(f"update {count:3d}: dt = {update.dt:.0e}, W/H = {width:.4f}", flush=True)
            return
        picture = self.picture(update.design, count)
        if self.handle is None:
            self.handle = display(picture, display_id=True)
        else:
            self.handle.update(picture)

    def picture(self, design, count):
        figure = new_figure(9.0, 2.9)
        left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1.3, 1.3))
        draw_design(left, design)
        left.set_title(f"design update {count}", fontsize=10)
        for j, target in enumerate(targets):
            force = [row[f"q{j + 1}"] for row in self.rows]
            middle.plot(force, "k" + ("-", "--", "-.", ":")[j % 4])
            middle.axhline(target.q, color="0.6", linewidth=0.8)
        middle.set_ylabel("q [N] (grey: targets)")
        right.semilogy([row["C"] for row in self.rows], "k-", label="objective C")
        right.semilogy([row["volume"] for row in self.rows], "k--", label="its volume term")
        right.legend(fontsize=8)
        for axes in (middle, right):
            axes.set_xlabel("design update")
            axes.grid(color="0.92")
        return figure


watch = Watch(every=8)
result = ngspring.optimize(problem, observers=[watch], threads=THREADS)

# %% [markdown]
# There are three phases. First the forces move to their targets; the volume hardly matters. Then
# the targets are met and the objective *is* the volume term, which falls while the forces stay
# where they are. In the end nothing changes any more, the pseudo-time step grows without
# limit, and the last step is taken with $\Delta t=\infty$: the exact stationary point.

# %%
width = result.design.relative_width
print(f"converged: {result.converged}, {len(result.history) - 1} design updates,", end=" ")
print(f"{result.history.newton_iterations} Newton iterations")
for point, q in zip(targets, result.q, strict=True):
    print(f"d = {point.d:4g} mm: q = {q:8.5f} N, target {point.q:g} N")
print(f"volume as a straight column: W/H = {width:.4f}")
convergence_figure(result.history, problem)

# %% [markdown]
# ## Spring out
#
# The optimiser has looked at three points only. The curve between them is computed afterwards, by
# following the spring from rest.

# %%
between = np.linspace(-20, 10, 13)
responses = control_point_responses(result.design, between, threads=THREADS)
design_figure(result.design, responses, responses[0.0])

# %% [markdown]
# In tension and for small compression the curve is nearly straight. Then the hole closes, its
# walls bear on each other, and the spring stiffens. The slit that seems to stay open at $-20$ mm is
# the grey interface, which is squeezed but not to nothing; the paper says as much, "a small gap
# between the contact surfaces, of size in the order of $l_i$", and $l_i$ is 5 mm here. (The
# interactive picture is the quarter that is analysed, compressed by 20 mm.)

# %%
mesh, chi, u = design_fields(result.design, responses[0.0], -20.0)
scene = Draw(rho(chi), mesh, "density", deformation=u, min=0, max=1)

# %% [markdown]
# ## The same spring at the paper's resolution
#
# The gallery of the package holds C7 on 80 x 80 elements with $l_i=1$ mm, fully converged. It
# took minutes instead of seconds. Its targets are the same and so are its forces; what resolution
# buys is material: a wide grey interface is paid for in volume and carries little.

# %%
fine = ngspring.gallery["C7"]
recorded = fine.info["q"]
fine_width = fine.relative_width
print("C7 at 80 x 80: q =", ", ".join(f"{q:.4f} N" for q in recorded))
print(f"W/H = {fine_width:.4f} at 80 x 80 against {width:.4f} at 16 x 16 (paper: 0.2539)")

# %%
fine_response = responses_of(fine)[0.0]  # stored with the design
figure = new_figure(9.4, 3.3)
left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1, 1.4))
for axes, design, title in ((left, result.design, "16 x 16"), (middle, fine, "80 x 80")):
    draw_design(axes, design)
    axes.set_xlim(0, 100)
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("x [mm]")
left.set_ylabel("y [mm]")
draw_curve(right, {"16 x 16": responses[0.0], "80 x 80": fine_response}, problem)
figure

# %%
missed = max(abs(q - point.q) for point, q in zip(targets, result.q, strict=True))
print(f"largest distance from a target: {missed:.1e} N")
