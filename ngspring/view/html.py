"""HTML pages from the templates of this package, each in one file that loads nothing else."""

from __future__ import annotations

import base64
import io
import time
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from ngspring.basics.version import __version__

_ENVIRONMENT = Environment(
    loader=PackageLoader("ngspring.view"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def page(template: str, refresh: int | None = None, **values: object) -> str:
    """A whole HTML document.

    Parameters
    ----------
    template : str
        Name of a file in ``templates``, which extends ``page.html``.
    refresh : int, optional
        Seconds after which a browser loads the file again.
    **values
        What the template shows: plain text, unless it is Markup.
    """
    now = time.strftime("%Y-%m-%d %H:%M:%S %Z")
    return _ENVIRONMENT.get_template(template).render(
        values, refresh=refresh, version=__version__, now=now
    )


def picture(
    name: str,
    figure: Figure | bytes,
    alt: str,
    caption: str,
    dpi: int = 110,
    margins: tuple[float, float, float, float] | None = None,
) -> Markup:
    """A figure with its caption.

    Parameters
    ----------
    name : str
        Its id in the document.
    figure : Figure or bytes
        PNG, if it is bytes.
    alt, caption : str
        Plain text: what can be seen, and what it means.
    dpi : int
        Resolution of a Figure.
    margins : tuple of float, optional
        Left, bottom, right and top of a Figure's axes as shares of its size, instead of those
        that matplotlib would find in twice the time.
    """
    content = figure
    if isinstance(content, Figure):
        if margins is not None:
            content.set_layout_engine(None)
            left, bottom, right, top = margins
            content.subplots_adjust(left, bottom, right, top, hspace=0.12)
        buffer = io.BytesIO()
        content.savefig(buffer, format="png", dpi=dpi)
        content = buffer.getvalue()
    # A PNG says its size in its header; with it the page does not jump while it is built.
    width, height = (int.from_bytes(content[k : k + 4], "big") for k in (16, 20))
    data = base64.b64encode(content).decode("ascii")
    macros: Any = _ENVIRONMENT.get_template("macros.html").module
    return Markup(macros.picture(name, data, width, height, alt, caption))


def link(target: str, text: str) -> Markup:
    """A link to a file beside the page; plain text."""
    return Markup('<a href="{}">{}</a>').format(quote(target), text)
