"""A real browser for the tests: headless Chromium, if it is installed."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from ngspring.basics.arrays import FloatArray

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")

_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
)
#: Writes into the document what the browser made of its pictures.
_PROBE = """<script>
window.addEventListener("load", () => {
  const found = {};
  for (const image of document.images) {
    const box = image.getBoundingClientRect();
    found[image.id] = {complete: image.complete, width: image.naturalWidth,
      box: [box.left + scrollX, box.top + scrollY, box.width, box.height]};
  }
  document.body.dataset.found = JSON.stringify(
    {images: found, overflow: document.documentElement.scrollWidth - innerWidth});
});
</script></body>"""


def _run(home: Path, *arguments: str) -> str:
    assert CHROMIUM is not None
    command = [CHROMIUM, *_OPTIONS, f"--user-data-dir={home / 'profile'}", *arguments]
    done = subprocess.run(command, capture_output=True, timeout=120, check=True)
    return done.stdout.decode("utf-8")


def probe(page: Path, home: Path, width: int = 1200, height: int = 3000) -> dict[str, Any]:
    """What a window of this size makes of a page: its images by id, and overflow in pixels."""
    probed = home / "probed.html"
    text = page.read_text(encoding="utf-8")
    assert text.count("</body>") == 1
    probed.write_text(text.replace("</body>", _PROBE), encoding="utf-8")
    size = f"--window-size={width},{height}"
    dom = _run(home, size, "--virtual-time-budget=5000", "--dump-dom", probed.as_uri())
    match = re.search(r'data-found="([^"]*)"', dom)
    assert match, dom[:500]
    found: dict[str, Any] = json.loads(unescape(match[1]))
    return found


def screenshot(page: Path, home: Path, width: int = 1200, height: int = 3000) -> FloatArray:
    """Brightness (rows, columns) of a page, from 0 to 1."""
    picture = home / "screenshot.png"
    size = f"--window-size={width},{height}"
    _run(home, size, f"--screenshot={picture}", page.as_uri())
    return np.asarray(imread(picture)[..., :3].mean(axis=2))
