"""Measure ngspring beside the published formulation in GetFEM, and write the tables::

    python examples/benchmarks/run.py                 # everything: hours
    python examples/benchmarks/run.py pairs           # a few minutes
    python examples/benchmarks/run.py runs growth

Results are kept in ``results.json`` part by part; see the README beside this file.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
from pathlib import Path
from typing import Any

import measure
import ngsolve
import tables

from ngspring.basics.files import write_text
from ngspring.fem.linear import wants_upper

WHAT = ("pairs", "runs", "growth")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("::")[0])
    parser.add_argument("what", nargs="*", metavar="|".join(WHAT), help="all by default")
    parser.add_argument("--getfem", default="/usr/bin/python3", help="a Python that has GetFEM")
    parser.add_argument("--sizes", type=int, nargs="+", default=[40, 80], help="of pairs and runs")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--meshes", type=int, nargs="+", default=[20, 40, 80, 120, 160])
    parser.add_argument(
        "--really", type=int, nargs="*", default=[40], help="sizes of GetFEM's own whole runs"
    )
    parser.add_argument("--hours", type=float, default=3.0, help="longest run of GetFEM")
    parser.add_argument("--max-updates", type=int, help="stop runs early, to try things out")
    parser.add_argument("--results", type=Path, default=tables.RESULTS)
    chosen = parser.parse_args()
    for name in chosen.what:
        if name not in WHAT:
            parser.error(f"{name!r} cannot be measured: name some of {', '.join(WHAT)}")
    return chosen


def machine(python: str | None) -> dict[str, Any]:
    """What the numbers depend on; nothing that names the machine."""
    model = "unknown"
    if os.path.exists("/proc/cpuinfo"):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next((line.split(":")[1].strip() for line in lines if "model name" in line), model)
    return {
        "processors": os.cpu_count(),
        "model": model,
        "load": os.getloadavg()[0],
        "ngsolve": ngsolve.__version__,
        "solver": "pardiso" if wants_upper() else "sparsecholesky",
        "getfem": getfem_version() if python else "no GetFEM",
    }


def getfem_version() -> str:
    """Version of Debian's package, where dpkg knows it."""
    try:
        command = ["dpkg-query", "-W", "-f", "GetFEM ${Version}", measure.PACKAGE]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return "GetFEM, version unknown"


def measure_pairs(chosen: argparse.Namespace, python: str | None) -> dict[str, Any]:
    found = []
    for elements in chosen.sizes:
        for threads in chosen.threads:
            pair = measure.pairs(elements, threads, chosen.rounds, python)
            found.append(pair)
            words = f"{elements} x {elements}, {threads} threads"
            if python is None:
                print(f"{words}: {tables.median(pair['ours'], 'iteration'):.3f} s")
                continue
            ratios = tables.ratios(pair)
            each = ", ".join(f"{ratio:.2f}" for ratio in ratios)
            print(f"{words}: GetFEM / ngspring {each}; median {statistics.median(ratios):.2f}")
    return {"pairs": found}


def measure_runs(chosen: argparse.Namespace, python: str | None) -> dict[str, Any]:
    ours, theirs = [], []
    most = chosen.max_updates
    for elements in chosen.sizes:
        for rule, threads in [("own", n) for n in chosen.threads] + [("paper", 1)]:
            run = measure.our_run(elements, threads, rule, most)
            ours.append(run)
            print(
                f"{elements} x {elements}, {rule} rule, {threads} threads: {run['seconds']:.0f} s"
            )
    for elements in chosen.really if python else []:
        run = measure.their_run(elements, python, 3600 * chosen.hours, most or 10_000)
        theirs.append(run)
        print(f"{elements} x {elements}, GetFEM: {run['seconds']:.0f} s, {run['message']}")
    return {"runs": ours, "their_runs": theirs}


def measure_growth(chosen: argparse.Namespace, python: str | None) -> dict[str, Any]:
    found = []
    for elements in chosen.meshes:
        mesh = measure.growth(elements, 1, min(chosen.rounds, 3), python)
        found.append(mesh)
        texts = [
            f"{name} {tables.seconds(tables.median(mesh[key], 'iteration'))},"
            f" {mesh[key][-1]['memory']:.2f} GB"
            for name, key in (("ngspring", "ours"), ("GetFEM", "theirs"))
            if key in mesh
        ]
        texts += [f"GetFEM: {mesh['theirs_failed']}"] if "theirs_failed" in mesh else []
        print(f"{elements} x {elements}: {'; '.join(texts)}")
    return {"growth": found}


def main() -> None:
    chosen = arguments()
    python: str | None = chosen.getfem
    if not measure.has_getfem(chosen.getfem):
        python = None
        print(
            f"{chosen.getfem} has no GetFEM: only ngspring is measured (on Debian and Ubuntu:"
            f" apt-get install {measure.PACKAGE}; another Python: --getfem PYTHON)"
        )
    path = chosen.results
    results = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    results["machine"] = machine(python)
    parts = {"pairs": measure_pairs, "runs": measure_runs, "growth": measure_growth}
    for name in chosen.what or WHAT:
        results |= parts[name](chosen, python)
        write_text(path, json.dumps(results, indent=1) + "\n")
    if path == tables.RESULTS:
        tables.fill_pages()


if __name__ == "__main__":
    main()
