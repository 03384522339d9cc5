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
# # 7. A part that does what the curve says
#
# Notebook 4 ends with a solid that is a few percent stiffer than the curve it was designed for.
# The paper stops there (section 3.5, Fig. 13). This notebook goes on until the *solid* goes
# through the points, and looks at the strains that it pays with.

# %%
# %matplotlib inline
import ngsolve as ng
import numpy as np
from ngsolve.webgui import Draw

import ngspring
from ngspring.design.corrections import corrections_of
from ngspring.view.curves import draw_frame, draw_line
from ngspring.view.design import draw_design
from ngspring.view.figure import new_figure

THREADS = 1  # more on a machine that has nothing else to do

# %% [markdown]
# ## Why the solid is stiffer
#
# In the third medium a surface is grey over the width $l_i$. With Eqs. 2 and 3 the stiffness is
# $E(\chi) = 1 / (1 + (1+p)\,e^{-\chi})$: half of it is reached at $\chi = \ln(1+p) = 2.2$, not at
# the contour $\chi = 0$ where the part has its surface. So every wall of the part is a little
# thicker than the optimiser thought.

# %%
chi = np.linspace(-8, 12, 400)
figure = new_figure(5.4, 3.2)
axes = figure.subplots()
axes.plot(chi, 1 / (1 + np.exp(-chi)), color="0.6", label="density (Eq. 2)")
axes.plot(chi, 1 / (1 + 9 * np.exp(-chi)), color="black", label="stiffness (Eq. 3, p = 8)")
axes.axvline(0, color="0.6", linestyle="--", label="surface of the part")
axes.axvline(np.log(9), color="black", linestyle=":", label="middle of the stiffness")
axes.set_xlabel("χ")
axes.grid(color="0.92")
axes.legend(fontsize=8)
figure

# %% [markdown]
# No other level is the answer: where walls touch, their surfaces have to be where they are. But
# the third medium can be asked for a little less. How much less depends on the design, so that it
# takes a few rounds.
#
# ## A small spring, corrected
#
# Two targets on a coarse mesh, where the surface is very wide, and the solid far too stiff.
# `realise` evolves the design, computes its solid with real contact, corrects what is asked of
# the third medium, and goes on.

# %%
points = ngspring.ControlPoint(10, 2), ngspring.ControlPoint(-10, -2)
problem = ngspring.SpringProblem(points, elements=8, l_i=10.0)


def told(update: ngspring.Update) -> None:
    """Say what each solid carries."""
    found = update.correction
    if found is not None:
        aims = ", ".join(f"{aim:6.3f}" for aim in found.aims)
        solid = ", ".join(f"{force:6.3f}" for force in found.solid)
        print(f"asked of the third medium {aims} N, carried by the solid {solid} N")


result = ngspring.realise(problem, observers=[told], threads=THREADS)
small = result.design
worst = max(abs(one) for one in corrections_of(small.info)[-1].deviations(points))
print(result.message or f"both targets are met within {100 * worst:.2f} %")

# %% [markdown]
# ## C4 at the paper's mesh
#
# The same for the paper's C4 is stored with the package. The design keeps both: the targets that
# were asked for, and what the third medium was asked for.

# %%
part, design = ngspring.parts["C4"], ngspring.gallery["C4"]
for point, solid in zip(part.problem.control_points, part.solid, strict=True):
    print(
        f"{point.d:4g} mm: target {point.q:g} N, third medium {point.aim:.4f} N, solid {solid:.4f} N"
    )
print(f"W/H = {part.relative_width:.4f}, before {design.relative_width:.4f}")

# %% [markdown]
# Both solids, with real contact, over the whole range.

# %%
places = [-20, -18, -16, -14, -12, -10, -7, -4, 0, 5, 10]
curves = {
    name: ngspring.contact_load_displacement(
        ngspring.mesh_body(one), places, threads=THREADS, onset=np.inf
    )
    for name, one in (("C4", design), ("C4, corrected", part))
}
figure = new_figure(5.4, 4.2)
axes = figure.subplots()
draw_frame(axes)
for (name, curve), style in zip(curves.items(), ("--", "-"), strict=True):
    draw_line(axes, curve, color="black", linestyle=style, linewidth=1.3, label=f"solid of {name}")
targets = part.problem.control_points
axes.plot(
    [point.d for point in targets],
    [point.q for point in targets],
    "o",
    markerfacecolor="0.7",
    markeredgecolor="black",
    label="target",
)
axes.grid(color="0.92")
axes.legend(fontsize=8)
figure

# %% [markdown]
# ## Less strain, more material
#
# The ends of slits are where a spring of this kind tears. `stretch_limit` is one more term of the
# objective, $k_s/n \, \langle \rho(\chi)(\lambda/\lambda_{max} - 1) \rangle^n$ over the body and all
# control points. What is compared is the stretch that only a thousandth of the volume exceeds.
# It costs material. (Without corrections here, on a mesh of 12 x 12.)

# %%
fine = problem.replace(elements=12, l_i=80 / 12)
stretches, widths = [], []
figure = new_figure(6.4, 3.2)
for axes, limit in zip(figure.subplots(1, 2), (0.0, 1.12), strict=True):
    one = ngspring.optimize(fine.replace(stretch_limit=limit), threads=THREADS).design
    body = ngspring.mesh_body(one)
    curve = ngspring.contact_load_displacement(body, [10, -10], threads=THREADS, onset=np.inf)
    stretches.append(float(curve.stretch_measure.max()))
    widths.append(one.relative_width)
    draw_design(axes, one)
    axes.set_title(f"limit {limit:g}" if limit else "no limit", fontsize=9)
    axes.set_xlabel("x [mm]")
    print(f"limit {limit:g}: stretch {stretches[-1]:.3f}, W/H = {widths[-1]:.3f}")
figure

# %% [markdown]
# The solid of the last one in compression, on its undeformed mesh, with its displacement in mm.

# %%
u = ng.GridFunction(ng.VectorH1(body.mesh, order=2))
u.vec.FV().NumPy()[:] = curve.u[1]
scene = Draw(ng.Norm(u), body.mesh, "|u|", deformation=u)
