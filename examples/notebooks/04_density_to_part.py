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
# # 4. From density to part
#
# The optimiser's result is a density on a grid, with a grey interface and a third medium that
# stands in for contact. Nobody can cast that. This notebook takes a finished design, C4 of the
# paper (linear from 10 mm of tension to 20 mm of compression), and follows it to a file for a
# printer: contour, body-fitted mesh, real contact, the influence of manufacturing errors, solid.
#
# Section 3.5 of the paper does the middle part of this. It names manufacturing errors as an open
# question.

# %%
# %matplotlib inline
import tempfile
from pathlib import Path

import meshio
import ngsolve as ng
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from ngsolve.webgui import Draw

import ngspring
from ngspring.solid.outline.outline import outline
from ngspring.view.design import draw_design
from ngspring.view.figure import new_figure
from ngspring.view.solid import contact_states_figure, draw_body, verification_figure
from ngspring.view.tolerance import tolerance_figure

THREADS = 1  # more on a machine that has nothing else to do

# %% [markdown]
# ## The contour
#
# $\chi$ is a spline, so its zero contour ($\rho=\tfrac12$, Eq. 2) can be traced on the
# spline itself, not on pixels. The lower left quarter is enough: the rest is its mirror image.

# %%
design = ngspring.gallery["C4"]
solid = outline(design)
print(f"{len(solid.parts)} part, {len(solid.loops)} loops, {4 * solid.area:.2f} mm^2 in all")
print(f"area by the density (Eq. 10): {design.volume / design.problem.T:.2f} mm^2")

# %%
figure = new_figure(8.4, 4.0)
whole, detail = figure.subplots(1, 2)
for axes in (whole, detail):
    draw_design(axes, design)
    for loop in solid.loops:
        x, y = np.vstack([loop.polygon, loop.polygon[:1]]).T
        axes.plot(x, y, color="tab:red", linewidth=1.2)
    axes.set_xlabel("x [mm]")
whole.set(xlim=(20, 80), ylim=(0, 100), ylabel="y [mm]", title="density, and the contour χ = 0")
detail.set(xlim=(32, 52), ylim=(32, 52), title="detail: the interface is 1 mm wide")
figure

# %% [markdown]
# ## A mesh of the solid, and surfaces that really touch
#
# `ngspring.verify` meshes the inside of the contour with curved second-order triangles, replaces
# the third medium by contact of the surface with itself, follows the load path, and does the same
# with the third medium for comparison.

# %%
check = ngspring.verify(
    design, [-20, -16, -12, -10, -8, -4, 0, 5, 10], elements_across=2, threads=THREADS
)
quality = check.body.quality
print(f"{quality.elements} triangles, smallest angle {quality.smallest_angle:.0f} degrees,")
print(f"area within {abs(quality.area_error):.0e} of that inside the contour")
print(f"thinnest wall {check.smallest_wall:.1f} mm")
for at in check.contact.contact_starts:
    print(f"contact from d = {at:.2f} mm")
for point in check.points:
    print(
        f"d = {point.point.d:4g} mm: third medium {point.q_third_medium:7.3f} N,"
        f" real contact {point.q_contact:7.3f} N ({100 * point.relative:+.1f} %)"
    )

# %%
contact_states_figure(check)

# %%
verification_figure(check)

# %% [markdown]
# The solid is some percent stiffer than the density said, and evenly so: the curve keeps its
# shape. The reason is the interface. Between $\chi=0$ and fully solid lies half of a grey strip
# 1 mm wide. In the optimiser RAMP (Eq. 3) makes it much softer than its density, in the real part
# it is simply solid. Whoever needs the exact force can aim a few percent lower.
#
# The interactive picture is the meshed quarter at $d=-20$ mm, coloured by the displacement's size.

# %%
k = int(np.abs(check.contact.d + 20).argmin())
u = ng.GridFunction(ng.VectorH1(check.body.mesh, order=2))
u.vec.FV().NumPy()[:] = check.contact.u[k]
scene = Draw(ng.Norm(u), check.body.mesh, "|u|", deformation=u)

# %%
figure = new_figure(4.6, 3.8)
axes = figure.subplots()
draw_body(axes, check.body, check.contact.u[k], d=-20.0)
axes.set(xlabel="x [mm]", ylabel="y [mm]", title="the mesh at d = -20 mm")
figure

# %% [markdown]
# ## Manufacturing errors
#
# Let every surface be a quarter of a millimetre too far out or too far in. By section 2.6 the
# surface moves with the level of $\chi$: the contour $\chi=-8o/l_i$ lies $o$ mm outside of
# $\chi=0$, if the slope is $8/l_i$ there. Each offset is a solid of its own, with its own mesh and
# contact.

# %%
band = ngspring.tolerance(design, offsets=[0.25], points=7, elements_across=2, threads=THREADS)
for point in band.points:
    low, high = (curve.q(point.d) for curve in (band.curves[0], band.curves[-1]))
    print(
        f"d = {point.d:4g} mm: {low:7.3f} to {high:7.3f} N,"
        f" dq/d(offset) = {band.sensitivity(point.d):.2f} N/mm"
    )
tolerance_figure(band)

# %% [markdown]
# A surface further out makes the spring stiffer everywhere. Least in tension, where only walls are
# stretched; most at $d=-20$ mm, where the slit also closes earlier. How far would the surface have
# to move inwards to bring each force back to its target?

# %%
for verdict in check.points:
    inwards = (verdict.q_contact - verdict.point.q) / band.sensitivity(verdict.point.d)
    print(f"d = {verdict.point.d:4g} mm: {inwards:.2f} mm")

# %% [markdown]
# Three different answers: no single offset repairs all three points. Better targets would.
#
# ## The part
#
# The plane spring is extruded. All of the above was per millimetre of thickness; a part of 20 mm
# has 20 times the force. STL is what printers read; `step`, `dxf` and `svg` work the same way.

# %%
thick = design.with_problem(design.problem.replace(T=20.0))
with tempfile.TemporaryDirectory() as folder:
    exported = ngspring.export_body(thick, Path(folder) / "C4.stl")
    size = exported.path.stat().st_size
    surface = meshio.read(exported.path)
triangles = surface.points[surface.cells_dict["triangle"]]
print(f"{exported.parts} part, {len(triangles)} triangles, {size / 1000:.0f} kB")
print(f"volume of the extruded contour: {exported.measure:.0f} mm^3")

# %%
corners = triangles - triangles[:, :1]
normals = np.cross(corners[:, 1], corners[:, 2])
enclosed = float((triangles[:, 0] * normals).sum() / 6)
print(f"volume enclosed by the triangles: {enclosed:.0f} mm^3")

# x, z, y is a reflection: turned round, the corners of each triangle keep its outside outside.
upright = triangles[:, ::-1][:, :, [0, 2, 1]]
figure = new_figure(5.0, 5.0)
axes = figure.add_subplot(projection="3d")
faces = Poly3DCollection(upright, facecolors="0.8", shade=True, antialiased=False)
axes.add_collection3d(faces)
axes.set(xlim=(20, 80), ylim=(-20, 40), zlim=(0, 100))
axes.set(xticks=[20, 50, 80], yticks=[0, 20], zticks=[0, 50, 100])
axes.set_box_aspect((60, 60, 100))
axes.view_init(elev=20, azim=-60)
axes.set(xlabel="x [mm]", ylabel="z [mm]", zlabel="y [mm]")
figure

# %%
deviation = max(abs(point.relative) for point in check.points)
print(f"largest deviation of the solid at a control point: {100 * deviation:.1f} %")
