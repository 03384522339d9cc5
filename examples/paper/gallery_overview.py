"""The whole gallery in one picture: every stored design undeformed, with W/H (or D/H) below it.

Black is solid, white is void. Axisymmetric springs (A) are shown in section. Designs that are not
stored yet are left out.
"""

from __future__ import annotations

from designs import RUNS, Numbers, Options, save

from ngspring import gallery
from ngspring.view.design import draw_design
from ngspring.view.figure import new_figure
from ngspring.view.text import width_symbol

COLUMNS = 9


def draw(options: Options) -> Numbers:
    designs = {name: gallery[name] for name in RUNS if name in gallery}
    if options.only is not None:
        designs = {name: design for name, design in designs.items() if name in options.only}
    rows = -(-len(designs) // COLUMNS)
    figure = new_figure(1.35 * COLUMNS, 1.75 * rows)
    panels = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    numbers: Numbers = {}
    for axes in panels:
        axes.set_axis_off()
    for axes, (name, design) in zip(panels, designs.items(), strict=False):
        draw_design(axes, design)
        problem = design.problem
        axes.set(xlim=(0, problem.L), ylim=(0, problem.H))
        symbol, ratio = width_symbol(problem), design.equivalent_width / problem.H
        axes.set_title(f"{name}\n{symbol} = {ratio:.3f}", fontsize=8, y=-0.32)
        numbers[name] = {symbol: ratio}
    save(figure, options, "gallery")
    return numbers
