"""The load path and the deformed states of each stored design, stored beside it.

So that `ngspring show C7`, reports and figures need not compute them. They are written to
ngspring/design/stored/states-NAME.npz, see `ngspring.analysis.stored`, and belong to the package.

Designs that have not changed since are skipped, unless --again says not to. 10 to 60 seconds for
each on one core.

    python examples/paper/states_of_gallery.py [NAME ...] [--again] [--threads N]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from importlib.resources import as_file

from ngspring import gallery
from ngspring.analysis.finished import computed_responses, responses_in_gallery
from ngspring.analysis.stored import StoredStates
from ngspring.design.gallery import STATES


def store(name: str, threads: int | None) -> None:
    begin = time.perf_counter()
    design = gallery[name]
    responses = computed_responses(design, threads)
    with as_file(gallery.folder / f"{STATES}{name}.npz") as path:
        StoredStates.of(design, responses).save(path)
    for response in responses.values():
        for line in filter(None, [response.message, *map(str, response.jumps)]):
            print(f"{name}: {line}")
    size, seconds = path.stat().st_size / 1000, time.perf_counter() - begin
    print(f"{name}: {size:.0f} kB, {seconds:.0f} s", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these designs")
    parser.add_argument("--again", action="store_true", help="those that are stored, too")
    parser.add_argument("--threads", type=int, default=1, help="threads to use (default: 1)")
    given = parser.parse_args(arguments)
    for name in given.names or gallery:
        if given.again or responses_in_gallery(gallery[name]) is None:
            store(name, given.threads)


if __name__ == "__main__":
    main()
