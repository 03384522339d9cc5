"""Pictures of body-fitted meshes and of verifications (Figs. 12 and 13)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import ngsolve as ng
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from ngspring.analysis.states import index_of
from ngspring.basics.arrays import FloatArray
from ngspring.basics.text import significant
from ngspring.solid.contact.contact import lobatto
from ngspring.solid.contact.response import ContactResponse
from ngspring.solid.mesh.body import Body
from ngspring.solid.verification import Verification
from ngspring.view.curves import draw_curve, draw_frame, draw_line, draw_named_points
from ngspring.view.figure import SMALL, new_figure
from ngspring.view.text import deviation_text, picture_name

_PIECES = 3
#: Corners, then the points in between, of an element's outline in reference coordinates.
_RING = np.concatenate(
    [
        np.linspace(a, b, _PIECES + 1)[:-1]
        for a, b in (((1, 0), (0, 1)), ((0, 1), (0, 0)), ((0, 0), (1, 0)))
    ]
).astype(float)


def element_outlines(body: Body, u: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Outlines of all elements as polygons.

    Parameters
    ----------
    body : Body
    u : array (2 ndof,), optional
        Dofs of VectorH1(order=2); none by default.

    Returns
    -------
    places, displacements : arrays (elements, 9, 2)
        In mm; three pieces for each of the curved sides.
    """
    rule = ng.IntegrationRule([(float(x), float(y)) for x, y in _RING], [0.0] * len(_RING))
    points = body.mesh.MapToAllElements({ng.ET.TRIG: rule}, ng.VOL)
    shape = (body.mesh.ne, len(_RING), 2)
    places = np.asarray(ng.CF((ng.x, ng.y))(points)).reshape(shape)
    if u is None:
        return places, np.zeros(shape)
    field = ng.GridFunction(ng.VectorH1(body.mesh, order=2))
    field.vec.FV().NumPy()[:] = u
    return places, np.asarray(field(points)).reshape(shape)


def draw_body(
    axes: Axes, body: Body, u: FloatArray | None = None, d: float = 0.0, whole: bool = True
) -> None:
    """Draw a body-fitted mesh, deformed by u, with its mirror images."""
    places, displacements = element_outlines(body, u)
    parts = body.problem.sector.copied(places, displacements, d)
    for x, v in parts if whole else parts[:1]:
        axes.add_collection(
            PolyCollection(list(x + v), facecolor="0.82", edgecolor="0.35", linewidth=0.25)
        )
    axes.set_aspect("equal")
    axes.autoscale_view()


def draw_pressure(axes: Axes, contact: ContactResponse, index: int, largest: float) -> None:
    """Draw the contact pressure on the deformed surface, edge by edge; black is ``largest`` (MPa).

    Edges carry their mean pressure: between the points of an edge a penalty's pressure oscillates.
    """
    rest = contact.surface_rest
    moved = contact.surface[index] - rest
    pressure = edge_pressure(contact)[index]
    touching = pressure > 1e-3 * largest
    for x, v in contact.body.problem.sector.copied(rest, moved, float(contact.d[index])):
        edges = (x + v).reshape(len(pressure), -1, 2)[touching]
        lines = LineCollection(list(edges), linewidth=2.6, cmap="inferno_r", capstyle="round")
        lines.set_array(pressure[touching])
        lines.set_clim(0, largest)
        axes.add_collection(lines)


def edge_pressure(contact: ContactResponse) -> FloatArray:
    """Mean contact pressure in MPa on every edge of the surface, (points, edges)."""
    count = contact.settings.points
    _, weights = lobatto(count)
    pressure = contact.pressure.reshape(len(contact.d), -1, count)
    return np.asarray(pressure @ weights)


def verification_figure(verification: Verification) -> Figure:
    """Curves of the third medium and of the solid with real contact, with the targets (Fig. 13)."""
    figure = new_figure(4.8, 4.0)
    axes = figure.subplots()
    problem = verification.design.problem
    draw_curve(axes, {"third medium": verification.third_medium}, problem)
    draw_contact_curve(axes, verification.contact, "body-fitted, real contact")
    for d in verification.contact.contact_starts:
        axes.axvline(d, color="0.45", linestyle=":", linewidth=1)
        axes.annotate(
            "contact",
            (d, 0.02),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            fontsize=SMALL,
            color="0.3",
        )
    axes.legend(fontsize=SMALL, loc="upper left")
    found = deviation_text(*verification.largest_deviation)
    # On lines of their own: together they are wider than the picture.
    axes.set_title(f"{picture_name(problem)}\nlargest deviation in force: {found}", fontsize=9)
    return figure


def draw_contact_curve(axes: Axes, contact: ContactResponse, label: str | None) -> None:
    """Draw the curve of the solid with real contact."""
    draw_line(axes, contact, color="tab:red", linestyle="--", linewidth=1.5, label=label)


def contact_states_figure(verification: Verification) -> Figure:
    """The deformed body-fitted mesh at every control point, with the contact pressure."""
    contact = verification.contact
    wanted = [0.0, *(verdict.point.d for verdict in verification.points)]
    states = [(d, index_of(contact, d)) for d in dict.fromkeys(wanted)]
    figure = new_figure(2.7 * len(states) + 0.9, 3.3)
    panels: Sequence[Axes] = figure.subplots(1, len(states), squeeze=False)[0]
    largest = float(edge_pressure(contact).max(initial=0.0))
    problem = verification.design.problem
    for axes, (d, k) in zip(panels, states, strict=True):
        if k is None and d == 0.0:
            draw_body(axes, verification.body)
        elif k is None:
            axes.text(0.5, 0.5, "not reached", ha="center", transform=axes.transAxes)
        else:
            draw_body(axes, verification.body, contact.u[k], d)
            if largest > 0:
                draw_pressure(axes, contact, k, largest)
        force = "" if k is None or d == 0.0 else f"\nq = {significant(contact.q[k], 4)} N"
        axes.set_title(("undeformed" if d == 0.0 else f"d = {d:g} mm") + force, fontsize=SMALL + 1)
        axes.set_xlim(-0.12 * problem.L, 1.12 * problem.L)
        reach = max([0.0, *(x for x, _ in states)])
        axes.set_ylim(-0.03 * problem.H, 1.03 * problem.H + reach)
        axes.tick_params(labelsize=SMALL - 1)
        axes.set_xlabel("mm", fontsize=SMALL)
        for side in (0.0, problem.H + d):
            axes.axhline(side, color="0.3", linewidth=0.8)
    if largest > 0:
        colours = LineCollection([], cmap="inferno_r")
        colours.set_clim(0, largest)
        figure.colorbar(colours, ax=list(panels), label="contact pressure [MPa]", shrink=0.75)
    figure.suptitle(picture_name(problem), fontsize=10)
    return figure


def meshes_figure(bodies: Mapping[str, Body | None]) -> Figure:
    """Body-fitted meshes of the lower left quarters (Fig. 12)."""
    columns = min(3, len(bodies))
    rows = -(-len(bodies) // columns)
    figure = new_figure(3.0 * columns, 3.1 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (name, body) in zip(panels, bodies.items(), strict=False):
        if body is None:
            axes.text(0.5, 0.5, f"{name}:\nnot in the gallery", ha="center", va="center")
            axes.set_axis_off()
            continue
        draw_body(axes, body, whole=False)
        elements = "" if body.quality is None else f", {body.quality.elements} elements"
        axes.set_title(f"{name}{elements}", fontsize=SMALL + 1)
        axes.set_xlim(0, body.problem.L / 2)
        axes.set_ylim(0, body.problem.H / 2)
        axes.tick_params(labelsize=SMALL - 1)
    for axes in panels[len(bodies) :]:
        axes.set_axis_off()
    for axes in panels[-columns:]:
        axes.set_xlabel("x [mm]", fontsize=SMALL)
    for axes in panels[::columns]:
        axes.set_ylabel("y [mm]", fontsize=SMALL)
    return figure


def verifications_figure(groups: Mapping[str, Mapping[str, Verification]]) -> Figure:
    """Both curves of several designs, one diagram for each group (Fig. 13)."""
    figure = new_figure(4.8 * len(groups), 4.2)
    panels: Sequence[Axes] = figure.subplots(1, len(groups), squeeze=False)[0]
    for axes, (title, group) in zip(panels, groups.items(), strict=True):
        draw_frame(axes)
        for k, (name, verification) in enumerate(group.items()):
            third = verification.third_medium
            labels = ("third medium", "real contact") if k == 0 else (None, None)
            draw_line(axes, third, color="black", linewidth=1.3, label=labels[0])
            draw_contact_curve(axes, verification.contact, labels[1])
            draw_named_points(axes, name, [verdict.point for verdict in verification.points])
        axes.set_title(title, fontsize=10)
        axes.grid(color="0.92")
        axes.margins(0.11, 0.06)
        axes.legend(fontsize=SMALL, loc="upper left")
    return figure
