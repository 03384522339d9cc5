"""What a fresh installation gives: a quick import, no GUI, one version, complete archives."""

from __future__ import annotations

import importlib.metadata
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

import ngspring

ROOT = Path(__file__).parent.parent


def run(code: str) -> str:
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout


def test_the_import_takes_less_than_a_second_and_leaves_the_heavy_libraries_alone() -> None:
    heavy = ("ngsolve", "netgen", "matplotlib", "scipy", "ipctk")
    loaded = run(f"import sys, ngspring; print(set({heavy!r}) & sys.modules.keys())")
    assert loaded == "set()\n"
    seconds = []
    for _ in range(3):
        begin = time.perf_counter()
        run("import ngspring")
        seconds.append(time.perf_counter() - begin)
    assert statistics.median(seconds) < 1.0


def test_no_module_chooses_a_gui_backend_or_prints_at_its_import() -> None:
    code = (
        "import importlib, pkgutil, sys, ngspring\n"
        "names = [m.name for m in pkgutil.walk_packages(ngspring.__path__, 'ngspring.')]\n"
        "for name in names:\n"
        "    if not name.endswith('__main__'):\n"
        "        try:\n"
        "            importlib.import_module(name)\n"
        "        except ModuleNotFoundError as error:\n"
        "            assert not str(error.name).startswith('ngspring'), error\n"
        "assert len(names) > 50\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "assert 'tkinter' not in sys.modules\n"
    )
    assert run(code) == ""


def test_the_version_is_the_same_everywhere() -> None:
    version = ngspring.__version__
    assert importlib.metadata.version("ngspring") == version
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## (\S+?),? ", changes, re.M)
    assert newest is not None
    assert newest[1] == version


def test_links_between_the_pages_lead_somewhere() -> None:
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("examples/**/*.md")]
    assert len(pages) >= 5
    for page in pages:
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name} links to {target}"
