"""The tables of README.md, made from the stored designs and what was computed with them.

What stands between ``<!-- NAME -->`` and ``<!-- end NAME -->`` is replaced:

- ``missing``: designs of the campaign that are not stored yet;
- ``growth``: W/H along the families of the paper;
- ``designs``: every stored design with its targets, what it reached, W/H, the effort, the start;
- ``ladder``: what was stored before coarse meshes came first (results/before_ladder.json) beside
  what they lead to (results/ladder.json, written by ladder_of_gallery.py);
- ``stability``: where its symmetric path loses stability (results/stability.json, written by
  stability_of_gallery.py);
- ``parts``: every stored part beside the design it was made from (results/parts.json, written by
  evaluation_of_parts.py);
- ``limits``, ``bands`` and ``walls``: what a limit of the stretch costs, and what robust, wall and
  gap change (results/limits.json, written by limits_and_tolerances.py);
- ``verification``: how far the remodelled solid with real contact is from the third medium
  (results/verification.json, written by verification_of_gallery.py).

    python examples/paper/results_page.py
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

from designs import HERE, RUNS
from gallery_results import read

from ngspring import Design, gallery
from ngspring.basics.files import write_text
from ngspring.design.gallery import PART
from ngspring.problem.point import relative_deviation, worst_deviation
from ngspring.view.text import deviation_text

PAGE = HERE / "README.md"
#: W/H and design updates where the paper's text states them.
PAPER = {"C7": ("0.2539", "153"), "C7-random": ("0.2515", "140"), "C4": ("", "115 + 1")}
Row = Sequence[str]


def names() -> list[str]:
    """The designs in the order of the gallery's campaign, then any others."""
    return [name for name in RUNS if name in gallery] + sorted(set(gallery) - set(RUNS))


def table(header: Row, rows: Iterable[Row]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def forces(design: Design) -> tuple[str, str, float]:
    """Targets, forces reached (dilated control points in brackets) and the largest deviation."""
    targets, reached = [], []
    for point, q in zip(design.problem.control_points, design.info["q"], strict=True):
        text = f"{q:.4f}" if abs(q) < 50 else f"{q:.2f}"
        if point.eta:
            targets.append(f"({point.q:g})")
            reached.append(f"({text})")
        else:
            targets.append(f"{point.q:g} at {point.d:g}")
            reached.append(text)
    worst = worst_deviation(design.problem.control_points, design.info["q"])
    assert worst is not None
    return ", ".join(targets), ", ".join(reached), abs(worst)


def design_row(name: str) -> Row:
    design = gallery[name]
    history = design.history
    assert history is not None
    targets, reached, worst = forces(design)
    width, updates = PAPER.get(name, ("", ""))
    return (
        name,
        targets,
        reached,
        f"{100 * worst:.4f} %",
        f"{design.relative_width:.4f}",
        width,
        str(len(history) - 1),
        updates,
        str(history.newton_iterations),
        f"{history.last().seconds / 60:.0f}",
        str(design.info["start"]),
    )


def designs_table() -> str:
    header = (
        "design", "targets q [N] at d [mm]", "reached q [N]", "largest deviation", "W/H or D/H",
        "paper", "updates", "paper", "Newton iterations", "minutes", "start",
    )  # fmt: skip
    return table(header, map(design_row, names()))


def missing_line() -> str:
    missing = [name for name in RUNS if name not in gallery]
    return f"Not there yet: {', '.join(missing)}." if missing else f"All {len(RUNS)} are there."


def growth_lines() -> str:
    """Do the volumes grow as the paper says? For those that are stored."""
    lines = []
    for family in (tuple(f"C{i}" for i in range(1, 8)), tuple(f"T{i}" for i in range(1, 7))):
        ratios = {n: gallery[n].relative_width for n in family if n in gallery}
        growing = [ratio for name, ratio in ratios.items() if name != "T1"]
        verdict = "grows" if growing == sorted(growing) else "does NOT grow"
        values = ", ".join(f"{name} {ratio:.4f}" for name, ratio in ratios.items())
        lines.append(f"- {family[0]} to {family[-1]}: {values}: W/H {verdict}.")
    return "\n".join(lines)


def ladder_row(name: str, before: dict[str, Any], now: dict[str, Any]) -> Row:
    change = now["C"] / before["C"] - 1
    return (
        name,
        str(now["start"]),
        str(before["iterations"]),
        ", ".join(f"{count} on {mesh}" for mesh, count in now["iterations"].items()),
        f"{before['width']:.6f}",
        f"{now['width']:.6f}",
        "none" if abs(change) < 1e-9 else f"{100 * change:+.4f} %",
        f"{now['density']:.0e}",
    )


def ladder_table() -> str:
    before, now = read("before_ladder"), read("ladder")
    header = (
        "design", "start", "iterations before", "iterations now, by mesh", "W/H or D/H before",
        "now", "change of C", "largest change of density",
    )  # fmt: skip
    again = [name for name in names() if name in now]
    return table(header, [ladder_row(name, before[name], now[name]) for name in again])


def stability_row(name: str, found: dict[str, Any]) -> Row:
    low, high = found["range"]
    events = [
        f"{c['symmetry']} mode from d = {c['d']:.2f} mm, q = {c['q']:.4g} N on"
        f" ({100 * c['in_solid']:.0f} % in solid)"
        for c in found["critical"]
    ]
    picture = f"[mode](figures/stability-{name}.png)" if events else ""
    return (
        name,
        f"{low:g} to {high:g}",
        f"{found['lowest']:.4f}",
        "; ".join(events) or "stable",
        picture,
    )


def stability_table() -> str:
    stored = read("stability")
    rows = [stability_row(name, stored[name]) for name in names() if name in stored]
    header = ("design", "d [mm]", "lowest eigenvalue", "symmetric path", "picture")
    return table(header, rows)


def percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:+.1f} %"


def verification_row(name: str, found: dict[str, Any]) -> Row:
    if "error" in found:
        return (name, "", "", "", "", "", "", found["error"])
    points = found["control_points"]
    forces = ", ".join(
        f"{p['q_third_medium']:.4g} / "
        + ("-" if p["q_contact"] is None else f"{p['q_contact']:.4g}")
        for p in points
    )
    starts = ", ".join(f"{d:.2f}" for d in found["contact_starts"]) or "none"
    remarks = " ".join([*found["remarks"], found["message"]]).strip()
    pictures = f"[curves](figures/verification-{name}.png) [states](figures/contact-{name}.png)"
    return (
        f"{name} ({pictures})",
        forces,
        ", ".join(percent(p["relative_deviation"]) for p in points),
        deviation_text(**found["largest_deviation"]),
        starts,
        f"{found['largest_stretch']['value']:.2f}",
        f"{found['smallest_wall']:.1f}" if found["smallest_wall"] else "-",
        remarks,
    )


def verification_table() -> str:
    stored = read("verification")
    rows = [verification_row(name, stored[name]) for name in names() if name in stored]
    header = (
        "design", "q [N]: third medium / real contact", "deviation at the control points",
        "largest deviation in force over the path", "contact from d [mm]", "largest stretch",
        "smallest wall [mm]", "in words",
    )  # fmt: skip
    return table(header, rows)


def solid_deviations(found: dict[str, Any]) -> str:
    """Of the solid from the targets, at the control points."""
    texts = []
    for point in found["control_points"]:
        q, target = point["q_contact"], point["q_target"]
        texts.append("-" if q is None else f"{100 * relative_deviation(q, target):+.2f} %")
    return ", ".join(texts)


def stable_until(found: dict[str, Any]) -> str:
    events = [f"{c['d']:.2f} mm" for c in found["stability"]["critical"] if c["kind"] == "solid"]
    return f"until {' and '.join(events)}" if events else "stable"


def length(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def part_row(name: str, found: dict[str, Any]) -> Row:
    return (
        name,
        solid_deviations(found),
        stable_until(found),
        f"{found['stretch_measure']:.2f}",
        length(found["smallest_wall"]),
        length(found["smallest_gap_at_rest"]),
        f"{found['width']:.4f}",
    )


def parts_table() -> str:
    """Each design, and below it the parts of its case."""
    stored = read("parts")
    rows = []
    for name in names():
        of_case = [part for part, found in stored.items() if found["case"] == name]
        if of_case:
            rows.append(part_row(name, stored[of_case[0]]["before"]))
        rows += [part_row(f"{part}{PART}", stored[part]["after"]) for part in of_case]
    header = (
        "design", "solid from its targets", "symmetric path", "stretch of a thousandth",
        "smallest wall [mm]", "smallest gap [mm]", "W/H or D/H",
    )  # fmt: skip
    return table(header, rows)


def imperfect_text(found: dict[str, Any]) -> str:
    """What the full solid with its surfaces moved does, in a few words."""
    furthest = found["largest_deviation"]
    off = f"{100 * abs(furthest['relative']):.1f} % at {furthest['d']:g} mm"
    snaps = " and ".join(f"{jump['d']:.2f}" for jump in found["jumps"])
    ends = "" if found["complete"] else "; a path ends early"
    return off + (f"; snaps at {snaps} mm" if snaps else "") + ends


def stable_row(name: str, found: dict[str, Any], buckling: dict[str, Any] | None) -> Row:
    after, width = found["after"], found["after"]["width"]
    other = None if buckling is None else buckling["after"]["width"]
    return (
        f"{name}{PART}",
        f"{after['stability']['lowest']:.3f}",
        imperfect_text(after["imperfect"]),
        f"{width:.4f}",
        "-" if other is None else f"{other:.4f}",
        "-" if other is None else percent(width / other - 1),
    )


def stable_table() -> str:
    """Every part that was designed not to buckle, beside the one of its case that was not."""
    stored = read("parts")
    chosen = {name: found for name, found in stored.items() if "imperfect" in found["after"]}
    rows = [stable_row(name, found, stored.get(found["case"])) for name, found in chosen.items()]
    header = (
        "part", "lowest eigenvalue", "imperfect solid off by", "W/H", "W/H of the one that buckles",
        "material",
    )  # fmt: skip
    return table(header, rows)


def unfinished(found: dict[str, Any]) -> str:
    return "" if found["converged"] else f"stopped after {found['updates']} updates"


def strain_row(found: dict[str, Any]) -> Row:
    limit, measure, largest = found["limit"], found["stretch_measure"], found["largest_stretch"]
    return (
        found["case"],
        f"{limit:g}" if limit else "none",
        "-" if measure is None else f"{measure:.3f}",
        percent(measure / limit - 1) if limit and measure else "",
        "-" if largest is None else f"{largest:.2f}",
        f"{found['width']:.4f}",
        f"{100 * abs(found['deviation']):.3f} %",
        unfinished(found),
    )


def limits_table() -> str:
    """Every design with a limit, below the one of its case without."""
    others = ("offsets", "wall", "gap")
    stored = [f for f in read("limits").values() if not any(f[key] for key in others)]
    limited = [name for name in names() if any(f["case"] == name and f["limit"] for f in stored)]
    chosen = [found for found in stored if found["case"] in limited]
    chosen.sort(key=lambda f: (limited.index(f["case"]), -(f["limit"] or math.inf)))
    header = (
        "design", "stretch_limit", "stretch of a thousandth", "from the limit", "largest stretch",
        "W/H", "third medium from its targets", "",
    )  # fmt: skip
    return table(header, map(strain_row, chosen))


def band(forces: Sequence[float | None]) -> float | None:
    """Width in N of the band of a curve at a place; None if a curve does not reach it."""
    known = [q for q in forces if q is not None]
    return max(known) - min(known) if len(known) == len(forces) else None


def narrower(before: float | None, after: float | None) -> float | None:
    return after / before - 1 if before and after is not None else None


def band_row(plain: dict[str, Any], robust: dict[str, Any]) -> Row:
    places = [d for d, *_ in plain["forces"]]
    before, after = ([band(q) for _, *q in one["forces"]] for one in (plain, robust))
    return (
        plain["case"],
        ", ".join(f"{d:g}" for d in places),
        *(", ".join("-" if w is None else f"{w:.3g}" for w in one) for one in (before, after)),
        ", ".join(percent(narrower(*pair)) for pair in zip(before, after, strict=True)),
        *(f"{one['width']:.4f}" for one in (plain, robust)),
        unfinished(robust),
    )


def bands_table() -> str:
    """Every robust design beside the plain one of its case."""
    with_forces = [found for found in read("limits").values() if "forces" in found]
    rows = [
        band_row(plain, robust)
        for plain in with_forces
        for robust in with_forces
        if plain["case"] == robust["case"] and robust["offsets"] and not plain["offsets"]
    ]
    header = (
        "design", "d [mm]", "band of q [N]", "with robust", "change", "W/H or D/H", "with robust",
        "",
    )  # fmt: skip
    return table(header, rows)


def asked(found: dict[str, Any]) -> str:
    """The wall and the gap that a design was asked for, in the words of a problem's file."""
    kinds = [(kind, found[kind]) for kind in ("wall", "gap") if found[kind]]
    return ", ".join(f"{kind} = {size:g}" for kind, size in kinds) or "nothing"


def walls_table() -> str:
    """Every design with a wall or a gap, below the one of its case without."""
    stored = [f for f in read("limits").values() if not (f["limit"] or f["offsets"])]
    cases = {found["case"] for found in stored if found["wall"] or found["gap"]}
    chosen = sorted(
        (f for f in stored if f["case"] in cases),
        key=lambda f: (f["case"], f["wall"] or 0.0, f["gap"] or 0.0),
    )
    rows = [
        (
            found["case"],
            asked(found),
            length(found["smallest_wall"]),
            length(found["smallest_gap_at_rest"]),
            f"{found['width']:.4f}",
            unfinished(found),
        )
        for found in chosen
    ]
    header = ("design", "asked for [mm]", "smallest wall [mm]", "smallest gap [mm]", "W/H", "")
    return table(header, rows)


def replaced(text: str, name: str, content: str) -> str:
    pattern = rf"(<!-- {name} -->\n).*?(<!-- end {name} -->)"
    new, count = re.subn(pattern, lambda m: f"{m[1]}{content}\n{m[2]}", text, flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f"{PAGE} lacks its part {name!r}")
    return new


def page() -> str:
    """The page with its tables made anew."""
    text = PAGE.read_text(encoding="utf-8")
    text = replaced(text, "designs", designs_table())
    text = replaced(text, "missing", missing_line())
    text = replaced(text, "ladder", ladder_table())
    text = replaced(text, "growth", growth_lines())
    text = replaced(text, "stability", stability_table())
    text = replaced(text, "parts", parts_table())
    text = replaced(text, "stable", stable_table())
    text = replaced(text, "limits", limits_table())
    text = replaced(text, "bands", bands_table())
    text = replaced(text, "walls", walls_table())
    return replaced(text, "verification", verification_table())


if __name__ == "__main__":
    write_text(PAGE, page())
