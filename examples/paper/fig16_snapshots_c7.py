"""Fig. 16: the design of C7 on its way, from the column (above) and from a random start (below).

The initial design, five designs on the way, and the last one. Half columns at the left and the
right border are one column: the sides are symmetry lines.

The snapshots come with the package (ngspring/design/stored/snapshots-NAME.npz); --recompute makes
them in runs/figures/NAME/snapshots.npz, minutes on a coarse mesh (--elements 32) and an hour or
more on the paper's. Every run records them, see `ngspring.design.snapshots`.

Numbers to expect: W/H = 0.5 at the start from the column and 0.459 at the random one; 0.2526 at the
end from the column after 93 updates (paper: 0.2539 after 153), and 0.2513 after 102 from the random
start (paper: 0.2515 after 140 from its own).
"""

from __future__ import annotations

from importlib.resources import as_file, files

from designs import Numbers, Options, recompute, save

from ngspring.design.snapshots import Snapshots
from ngspring.view.rows import snapshots_figure

NAMES = ("C7", "C7-random")


def load(name: str, options: Options) -> Snapshots | None:
    if options.only is not None and name not in options.only:
        return None
    if options.recompute:
        recompute(name, options)
        return Snapshots.load(options.folder(name) / "snapshots.npz").select()
    resource = files("ngspring.design") / "stored" / f"snapshots-{name}.npz"
    if not resource.is_file():
        print(f"no snapshots of {name}: make them with --recompute")
        return None
    with as_file(resource) as path:
        return Snapshots.load(path)


def draw(options: Options) -> Numbers:
    stored = {name: load(name, options) for name in NAMES}
    runs = {name: {} if kept is None else kept.designs() for name, kept in stored.items()}
    if not any(runs.values()):
        raise SystemExit("there are no snapshots: make them with --recompute")
    save(snapshots_figure(runs), options, "fig16")
    return {
        name: {update: d.equivalent_width / d.problem.H for update, d in designs.items()}
        for name, designs in runs.items()
    }
