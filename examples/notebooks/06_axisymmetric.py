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
# # 6. Springs that are bodies of revolution
#
# So far a spring was a plane section of some thickness. Turn the section about the vertical axis
# instead, and it becomes a body of revolution: something that can be turned on a lathe or cast in
# a round mould. Section 3.4 of the paper needs two changes for it. The deformation gradient gets a
# hoop stretch,
#
# $$F = I + \begin{bmatrix}\nabla u & \\ & u_r/r\end{bmatrix} \tag{21}$$
#
# because a ring of radius $r$ that moves outwards by $u_r$ becomes longer by $u_r/r$. And integrals
# over the volume become integrals over rings,
#
# $$T\int_\Omega\ldots\,\mathrm d\Omega \;\to\; \int_{\Omega^+} 2\pi r\,\ldots\,\mathrm d\Omega ,
#   \qquad V = \int_{\Omega^+}2\pi r\,\rho(\chi)\,\mathrm d\Omega . \tag{23}$$
#
# In ngspring that is `kinematics="axisymmetric"`, and everything else stays as it is.

# %%
# %matplotlib inline
import ngsolve as ng
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from ngsolve.webgui import Draw
from scipy.optimize import brentq

import ngspring
from ngspring import ControlPoint, SpringProblem
from ngspring.analysis.forward import control_point_responses
from ngspring.physics.chi import rho
from ngspring.physics.elasticity import measure
from ngspring.solid.outline.outline import outline
from ngspring.solid.sides import SURFACE
from ngspring.view.design import density_figure
from ngspring.view.fields import design_fields
from ngspring.view.figure import new_figure
from ngspring.view.rows import design_figure

THREADS = 1  # more on a machine that has nothing else to do

# %% [markdown]
# ## Does a cylinder know that it is one?
#
# First a check with a known answer. A solid cylinder that is pulled with free sides is in uniaxial
# stress: the same stretch $\lambda=1+d/H$ everywhere along the axis, the same stretch $s$ across
# it in *all* directions, radial and hoop. $s$ follows from $P_{rr}=0$, one scalar equation with
# the stress of Eq. 17,
#
# $$P_{rr} = \frac{K\ln J}{s} + G J^{-2/3}\Big(s-\frac{2s^2+\lambda^2}{3s}\Big) = 0,\qquad
#   q = A\,\Big[\frac{K\ln J}{\lambda}
#   + G J^{-2/3}\Big(\lambda-\frac{2s^2+\lambda^2}{3\lambda}\Big)\Big],\qquad J = s^2\lambda ,$$
#
# and a tube, with its smaller area $A$, does just the same. If $u_r/r$ were forgotten ($F_{33}=1$)
# the force would be another one; that is computed, too.

# %%
problem = SpringProblem([ControlPoint(d=10, q=100)], kinematics="axisymmetric", elements=10)
K, G, H = problem.K, problem.G, problem.H


def stress(stretch, J, norm):
    """A principal value of P (Eq. 17) by its own stretch, |F| and ||F||^2."""
    return K * np.log(J) / stretch + G * J ** (-2 / 3) * (stretch - norm / (3 * stretch))


def uniaxial(d, hoop=True):
    """Exact force per area in MPa; without the hoop stretch if asked for."""
    along = 1 + d / H

    def state(s):
        f_33 = s if hoop else 1.0
        return s * f_33 * along, s**2 + f_33**2 + along**2

    s = brentq(lambda s: stress(s, *state(s)), 0.5, 2.0, xtol=1e-14)
    return stress(along, *state(s))


r = problem.L / 2 - ng.x
bodies = {
    "solid cylinder, r < 50 mm": (ng.CF(100.0), np.pi * 50**2),
    "tube, 20 mm < r < 40 mm": (
        ng.IfPos(r - 20, ng.IfPos(40 - r, 100, -100), -100),
        np.pi * (40**2 - 20**2),
    ),
}
displacements = [-20.0, -10.0, 10.0, 20.0]
relative = []
for name, (chi, area) in bodies.items():
    response = ngspring.load_displacement(chi, displacements, problem=problem, threads=THREADS)
    print(name)
    for d, q in zip(response.d, response.q, strict=True):
        exact, wrong = area * uniaxial(d), area * uniaxial(d, hoop=False)
        relative.append(abs(q / exact - 1))
        print(
            f"  d = {d:4g} mm: {q:10.4f} N, exact {exact:10.4f} N"
            f" ({relative[-1]:.0e}), without hoop stretch {wrong:10.4f} N"
        )

# %% [markdown]
# The cylinder is exact to rounding. The tube has void inside and outside, with a millionth of the
# stiffness ($\mathcal E_0$), and that is the size of its error.
#
# ## A1: a spring that softens
#
# The paper shows its four axisymmetric springs as pictures and does not print their targets, so
# ngspring has four of its own, A1 to A4. A1 is to need 100 N at 10 mm, in tension and in
# compression, but only 125 N at 20 mm of compression.

# %%
design = ngspring.gallery["A1"]
for point in design.problem.control_points:
    print(f"d = {point.d:4g} mm: target {point.q:g} N")
density_figure(design)

# %% [markdown]
# The picture is the section through the axis (dash-dotted). Eq. 23 as NGSolve writes it, and the
# diameter of the solid cylinder of the same volume (Eq. 25), $\bar D=\sqrt{4V/(\pi H)}$:

# %%
mesh, chi, _ = design_fields(design)
V = ng.Integrate(measure(design.problem) * rho(chi), mesh, order=5)
D = np.sqrt(4 * V / (np.pi * design.problem.H))
print(f"V = {V:.1f} mm^3 (ngspring: {design.volume:.1f}), D/H = {D / design.problem.H:.4f}")
across = design.density(np.linspace(0.5, 99.5, 100)[:, None], np.linspace(0.5, 99.5, 100)[None, :])
print(f"share of the section that is solid: {across.mean():.4f}")

# %% [markdown]
# The share of the section and $\bar D/H$ are different things: of two rings with the same section
# the one further from the axis holds more material.
#
# ## Under load

# %%
responses = control_point_responses(design, [-15.0, -5.0, 5.0], threads=THREADS)
response = responses[0.0]
design_figure(design, responses, response)

# %% [markdown]
# The spring is a tube whose wall has a slight kink, and a waist, at half its height. In compression
# the wall folds outwards there, and the force levels off. The rings of the fold have to become
# longer for that, which costs force that a plane spring does not know. Towards 20 mm the fold
# closes on the inside.
#
# ## What it looks like
#
# The contour $\chi=0$ turned about the axis, with a quarter cut away: at rest, and compressed
# by 20 mm. The displacement is evaluated on the contour itself.

# %%
loops = outline(design).loops
pieces = [piece.points for loop in loops for piece in loop.pieces if piece.name == SURFACE]
sections = [loop.polygon for loop in loops]


def moved(points, d):
    """r and z of points of the lower left quarter at a displacement, and of their mirror image."""
    mesh, _, u = design_fields(design, response, d)
    inside = np.clip(points, 1e-9, [design.problem.L / 2 - 1e-9, design.problem.H / 2 - 1e-9])
    x, y = (points + np.array([u(mesh(*point)) for point in inside])).T
    r = design.problem.L / 2 - x
    return (r, y), (r[::-1], design.problem.H + d - y[::-1])


def draw_revolved(axes, d):
    angle = np.radians(np.linspace(0, 270, 55))
    for points in pieces:
        for r, z in moved(points[:: max(1, len(points) // 60)], d):
            axes.plot_surface(
                r[:, None] * np.cos(angle),
                r[:, None] * np.sin(angle),
                z[:, None] + 0 * angle,
                color="0.8",
                linewidth=0,
                antialiased=False,
            )
    for polygon in sections:
        for r, z in moved(polygon, d):
            for end in (angle[0], angle[-1]):
                face = np.column_stack([r * np.cos(end), r * np.sin(end), z])
                axes.add_collection3d(Poly3DCollection([face], facecolor="0.35"))
    axes.set(xlim=(-45, 45), ylim=(-45, 45), zlim=(0, 100))
    axes.set(xticks=[-40, 0, 40], yticks=[-40, 0, 40], zticks=[0, 50, 100])
    axes.set_box_aspect((90, 90, 100))
    axes.view_init(elev=22, azim=-45)
    axes.set_title(f"d = {d:g} mm (axes in mm)", fontsize=10)


figure = new_figure(8.6, 4.6)
for k, d in enumerate((0.0, -20.0), start=1):
    draw_revolved(figure.add_subplot(1, 2, k, projection="3d"), d)
figure

# %% [markdown]
# And the section that is analysed, to be zoomed and turned in a live notebook (the axis is its
# right side):

# %%
mesh, chi, u = design_fields(design, response, -20.0)
scene = Draw(rho(chi), mesh, "density", deformation=u, order=1, min=0, max=1)

# %%
print(f"largest relative error of the patch check: {max(relative):.1e}; D/H = {D / H:.4f}")
