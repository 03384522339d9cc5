"""``results.json`` as tables of Markdown, written into the pages that show them.

What stands between ``<!-- NAME -->`` and ``<!-- end NAME -->`` is replaced::

    python examples/benchmarks/tables.py
"""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ngspring.basics.files import write_text
from ngspring.evolution.bench import PARTS as WORDS

HERE = Path(__file__).parent
RESULTS = HERE / "results.json"
PAGES = (HERE / "README.md", HERE.parents[1] / "docs" / "performance.md")

Answer = dict[str, Any]


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of Markdown; all columns but the first are numbers."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def median(measured: Sequence[Answer], part: str) -> float:
    """Of one part over the rounds."""
    return statistics.median(answer[part] for answer in measured)


def ratios(pair: Answer, part: str = "iteration") -> list[float]:
    """Theirs over ours, pair by pair as they were measured in turn."""
    return [
        theirs[part] / ours[part] for ours, theirs in zip(pair["ours"], pair["theirs"], strict=True)
    ]


def seconds(value: float) -> str:
    """Two significant digits or whole seconds."""
    if value >= 100:
        return f"{value:.0f} s"
    return f"{value:.1f} s" if value >= 10 else f"{value:.2f} s"


def pairs_table(results: Answer) -> str:
    """One row a mesh and number of threads: medians, and the ratio pair by pair."""
    rows = []
    for pair in results.get("pairs", []):
        row = [size(pair), f"{pair['threads']}", seconds(median(pair["ours"], "iteration"))]
        if "theirs" in pair:
            found = ratios(pair)
            row += [
                seconds(median(pair["theirs"], "iteration")),
                ", ".join(f"{ratio:.1f}" for ratio in found),
                f"**{statistics.median(found):.1f}**",
            ]
            # With more threads the time of those that wait would count.
            if pair["threads"] == 1:
                row.append(f"{statistics.median(ratios(pair, 'cpu')):.1f}")
        rows.append(row + ["-"] * (7 - len(row)))
    header = (
        "elements", "threads", "ngspring", "GetFEM", "ratio pair by pair", "median", "of CPU time",
    )  # fmt: skip
    return table(header, rows)


def parts_table(results: Answer) -> str:
    """What each part of an iteration costs."""
    rows = []
    for pair in results.get("pairs", []):
        for name, key in (("ngspring", "ours"), ("GetFEM", "theirs")):
            if key in pair:
                parts = [median(pair[key], p) for p in ("assembly", "linear", "residual")]
                unknowns = f"{pair[key][0]['unknowns']:,}"
                rows.append(
                    [f"{size(pair)}, {threads(pair)}, {name}", unknowns, *map(seconds, parts)]
                )
    return table(("", "unknowns", "matrix", "linear solver", "residual"), rows)


def agreement_line(results: Answer) -> str:
    """How far apart the two codes were at the state that was timed."""
    found = [pair["agreement"] for pair in results.get("pairs", []) if "agreement" in pair]
    if not found:
        return "GetFEM was not there: the codes have not been compared."
    worst = [max(max(a[name].values()) for a in found) for name in ("residual", "update")]
    return (
        f"At the states that were timed the residuals of Eqs. 4, 7 and 8 differ by {worst[0]:.0e}"
        f" at most, the Newton updates of chi, u and lam by {worst[1]:.0e}."
    )


def runs_table(results: Answer) -> str:
    """Whole runs, those of GetFEM really run or estimated from iterations and their time."""
    rows = [run_row("ngspring", run) for run in results.get("runs", [])]
    rows += [run_row("GetFEM, run", run) for run in results.get("their_runs", [])]
    rows += [estimate_row(*estimate) for estimate in estimates(results)]
    header = ("", "rule for dt", "threads", "updates", "iterations", "W/H", "time", "GB")
    return table(header, rows)


def run_row(name: str, run: Answer) -> list[str]:
    """A run that was measured."""
    iterations = run["iterations"] + run["rejected_iterations"]
    end = "" if run["message"] == "converged" else f" ({run['message']})"
    return [
        f"{size(run)}, {name}{end}", run["rule"], f"{run['threads']}", f"{run['updates']}",
        f"{iterations}", f"{run['width']:.4f}", seconds(run["seconds"]), f"{run['memory']:.2f}",
    ]  # fmt: skip


def ends_line(results: Answer) -> str:
    """Whether both codes ended at the same spring by the paper's rule."""
    ours = {r["elements"]: r for r in results.get("runs", []) if r["rule"] == "paper"}
    lines = []
    for theirs in results.get("their_runs", []):
        run = ours.get(theirs["elements"], theirs)
        if run is not theirs and run["message"] == theirs["message"] == "converged":
            apart = abs(run["width"] / theirs["width"] - 1)
            lines.append(
                f"By the paper's rule both codes end at the same spring on {size(run)} elements:"
                f" their W/H differ by {apart:.0e}."
            )
    return "\n".join(lines) or "No run of both codes went to its end by the paper's rule."


def estimates(results: Answer) -> list[tuple[Answer, Answer]]:
    """Runs of ngspring by the paper's rule whose iterations GetFEM was timed for, but not run."""
    really = {run["elements"] for run in results.get("their_runs", [])}
    timed = {pair["elements"]: pair for pair in results.get("pairs", []) if "theirs" in pair}
    chosen = {
        run["elements"]: run
        for run in results.get("runs", [])
        if run["rule"] == "paper" and run["elements"] in timed.keys() - really
    }
    return [(run, timed[elements]) for elements, run in chosen.items()]


def estimate_row(run: Answer, pair: Answer) -> list[str]:
    """Iterations that ngspring takes by the paper's rule, times GetFEM's time for one."""
    iterations = run["iterations"] + run["rejected_iterations"]
    passed = iterations * median(pair["theirs"], "iteration")
    return [
        f"{size(run)}, GetFEM, estimated", "paper", f"{pair['threads']}", f"{run['updates']}",
        f"{iterations}", "-", seconds(passed), "-",
    ]  # fmt: skip


def where_table(results: Answer) -> str:
    """Share of each part of ngspring's runs."""
    runs = results.get("runs", [])
    if not runs:
        return ""
    header = ("", *(f"{size(run)}, {run['rule']}, {threads(run)}" for run in runs))
    rows = [
        [words, *(f"{run['parts'][name] / run['seconds']:.0%}" for run in runs)]
        for name, words in WORDS.items()
        if name != "pictures"
    ]
    return table(header, rows)


def growth_table(results: Answer) -> str:
    """Seconds and memory from coarse to fine."""
    rows = []
    for mesh in results.get("growth", []):
        ours = mesh["ours"]
        row = [size(mesh), f"{ours[0]['unknowns']:,}"]
        row += [seconds(median(ours, "iteration")), f"{ours[-1]['memory']:.2f} GB"]
        if "theirs" in mesh:
            theirs = mesh["theirs"]
            row += [seconds(median(theirs, "iteration")), f"{theirs[-1]['memory']:.2f} GB"]
        else:
            row += [mesh.get("theirs_failed", "-"), "-"]
        rows.append(row)
    header = ("elements", "unknowns", "ngspring", "memory", "GetFEM", "memory")
    return table(header, rows)


def machine_line(results: Answer) -> str:
    """Where and with what it was measured."""
    m = results["machine"]
    busy = (
        " The machine was busy: seconds are too long, and ratios rough." if m["load"] > 0.5 else ""
    )
    return (
        f"Measured on {m['processors']} processors ({m['model']}), load {m['load']:.1f} before it"
        f" began; NGSolve {m['ngsolve']}, linear solver {m['solver']}; {m['getfem']}.{busy}"
    )


def size(measured: Answer) -> str:
    """The mesh in words."""
    return f"{measured['elements']} x {measured['elements']}"


def threads(measured: Answer) -> str:
    """The number of threads in words."""
    return "1 thread" if measured["threads"] == 1 else f"{measured['threads']} threads"


PARTS = {
    "machine": machine_line,
    "agreement": agreement_line,
    "pairs": pairs_table,
    "parts": parts_table,
    "runs": runs_table,
    "ends": ends_line,
    "where": where_table,
    "growth": growth_table,
}


def filled(text: str, results: Answer) -> str:
    """A page with all of its parts made anew."""
    for name, make in PARTS.items():
        pattern = rf"(<!-- {name} -->\n).*?(<!-- end {name} -->)"
        content = make(results)
        text = re.sub(pattern, lambda m, c=content: f"{m[1]}{c}\n{m[2]}", text, flags=re.DOTALL)
    return text


def fill_pages() -> None:
    """Write the tables into the pages."""
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    for page in PAGES:
        write_text(page, filled(page.read_text(encoding="utf-8"), results))


if __name__ == "__main__":
    fill_pages()
