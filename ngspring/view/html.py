"""Self-contained HTML pages: everything is in the one file, nothing is loaded from elsewhere."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape

from matplotlib.figure import Figure

_STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 68rem; padding: 1rem 1.2rem 3rem; background: #fff;
  color: #1a1a1a; font: 1rem/1.5 system-ui, sans-serif; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: .6rem 0 .2rem; }
h2 { font-size: 1.15rem; margin: 1.6rem 0 .5rem; border-bottom: 1px solid #ccc; }
p { margin: .4rem 0; max-width: 46rem; }
.badge { display: inline-block; padding: .05rem .6rem; border: 2px solid #333; border-radius: 1rem;
  font-size: .95rem; font-weight: 600; vertical-align: middle; }
.running { background: #dcebfa; } .converged { background: #dff2df; }
.stopped { background: #f0f0f0; } .stale { background: #fdf0cf; } .failed { background: #f9dcdc; }
dl.numbers { display: grid; grid-template-columns: repeat(auto-fit, minmax(9rem, 1fr)); gap: .6rem;
  margin: 1rem 0; }
dl.numbers div { border: 1px solid #ccc; border-radius: .4rem; padding: .4rem .7rem; }
dt { font-size: .85rem; color: #444; } dd { margin: 0; font-size: 1.15rem; font-weight: 600; }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 26rem), 1fr));
  gap: 1rem 1.5rem; align-items: start; }
figure { margin: 0; break-inside: avoid; }
figure img { display: block; width: 100%; height: auto; }
figcaption { font-size: .88rem; color: #444; }
.table, .wide { overflow-x: auto; }
.wide img { min-width: 40rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }
th, td { padding: .2rem .7rem; text-align: right; white-space: nowrap;
  border-bottom: 1px solid #ddd; }
th { color: #444; font-weight: 600; border-bottom: 2px solid #999; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
footer { margin-top: 2rem; font-size: .85rem; color: #555; }
@media (max-width: 40rem) { body { padding: .6rem .7rem 2rem; } table { font-size: .82rem; }
  th, td { padding: .2rem .35rem; } }
@media print { body { max-width: none; padding: 0; font-size: 10pt; }
  h2 { break-after: avoid; } .badge { background: none; } .wide img { min-width: 0; } }
"""


def page(title: str, body: Iterable[str], refresh: int | None = None) -> str:
    """A whole HTML document.

    Parameters
    ----------
    title : str
        Plain text.
    body : iterable of str
        HTML of its parts.
    refresh : int, optional
        Seconds after which a browser loads the file again.
    """
    head = [
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
    ]
    if refresh is not None:
        head.append(f'<meta http-equiv="refresh" content="{refresh}">')
    # Without an icon of its own a browser would ask a server for one.
    head += [
        '<link rel="icon" href="data:,">',
        f"<title>{escape(title)}</title>",
        f"<style>{_STYLE}</style>",
    ]
    lines = ["<!DOCTYPE html>", '<html lang="en">', "<head>", *head, "</head>", "<body>"]
    return "\n".join([*lines, *body, "</body>", "</html>", ""])


def picture(
    name: str,
    figure: Figure | bytes,
    alt: str,
    caption: str,
    dpi: int = 110,
    margins: tuple[float, float, float, float] | None = None,
) -> str:
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
    return (
        f'<figure><img id="{escape(name)}" alt="{escape(alt)}" width="{width}" height="{height}"'
        f' src="data:image/png;base64,{data}"><figcaption>{escape(caption)}</figcaption></figure>'
    )


def numbers(pairs: Iterable[tuple[str, str]]) -> str:
    """Names and values as cards; plain text."""
    cards = [f"<div><dt>{escape(k)}</dt><dd>{escape(v)}</dd></div>" for k, v in pairs]
    return f'<dl class="numbers">{"".join(cards)}</dl>'


def table(header: Sequence[str], rows: Iterable[Sequence[str]], raw: bool = False) -> str:
    """A table of plain text, or of HTML in the first column (``raw``)."""

    def cell(k: int, text: str) -> str:
        return f"<td>{text if raw and k == 0 else escape(text)}</td>"

    head = "".join(f'<th scope="col">{escape(text)}</th>' for text in header)
    body = "".join(
        f"<tr>{''.join(cell(k, text) for k, text in enumerate(row))}</tr>\n" for row in rows
    )
    return (
        f'<div class="table"><table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>'
        "</div>"
    )


def badge(status: str) -> str:
    """The status of a run, as text in a coloured frame."""
    return f'<span class="badge {escape(status)}">{escape(status)}</span>'
