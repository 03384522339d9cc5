"""What is computed once with every stored design and kept in results/NAME.json."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ngspring import Design, gallery
from ngspring.basics.files import write_text

HERE = Path(__file__).parent
PICTURES = HERE / "figures"
#: Name, design, number of threads; returns what is stored.
Evaluation = Callable[[str, Design, int | None], dict[str, Any]]


def read(results: str) -> dict[str, Any]:
    """What is stored under a name, by design."""
    path = HERE / "results" / f"{results}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def fingerprint(design: Design) -> str:
    """Tells one design from another of the same name."""
    return f"{design.volume:.9e}"


def evaluate(
    results: str,
    text: str | None,
    evaluation: Evaluation,
    arguments: Sequence[str] | None,
    designs: Mapping[str, Design] = gallery,
) -> dict[str, Any]:
    """Evaluate the designs named on the command line, all by default, that have changed since."""
    parser = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these designs")
    parser.add_argument("--threads", type=int, help="threads to use")
    given = parser.parse_args(arguments)
    for name in given.names or designs:
        design = designs[name]
        mark = {"design": fingerprint(design)}
        if read(results).get(name, {}).get("design") == mark["design"]:
            continue
        print(f"{name}:", flush=True)
        found = mark | evaluation(name, design, given.threads)
        # Read anew: others may have been evaluated at the same time.
        known = read(results) | {name: found}
        write_text(
            HERE / "results" / f"{results}.json",
            json.dumps(dict(sorted(known.items())), indent=1) + "\n",
        )
    return read(results)
