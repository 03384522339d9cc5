"""The documentation as HTML pages that link to each other.

    python docs/build.py [FOLDER]     (default: build/docs; open index.html)

The Markdown pages of the repository, and the API pages made from the docstrings with pdoc (extra
``docs``). A link of a Markdown page to a module or package of ``ngspring`` becomes one to its API
page; pictures and other files that a page links to are copied. An error is a link, an anchor or a
picture that leads nowhere, a docstring that pdoc cannot render, an annotation that it cannot
resolve.
"""

from __future__ import annotations

import os
import pkgutil
import re
import shutil
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from html import escape, unescape
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote, urlsplit

import jinja2
import pdoc
from markdown_it import MarkdownIt
from markdown_it.token import Token
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import get_lexer_by_name
from pygments.util import ClassNotFound

import ngspring

ROOT = Path(__file__).parent.parent
TEMPLATES = Path(__file__).parent / "templates"
API = "api"

#: The bar on every page, in this order; other pages are reached by links.
BAR = {
    "README.md": "Start",
    "docs/guide.md": "Guide",
    "docs/commands.md": "Commands",
    "docs/file-formats.md": "File formats",
    "docs/limits.md": "Limits",
    "docs/performance.md": "Performance",
    "docs/how-it-works.md": "How it works",
    "examples/README.md": "Examples",
    "examples/paper/README.md": "Results",
    "CONTRIBUTING.md": "Contributing",
    "CHANGELOG.md": "Changes",
}


class BrokenLinkError(ValueError):
    """Links that lead nowhere, one a line."""


def sources(root: Path) -> list[Path]:
    """The Markdown pages of a repository."""
    return [*root.glob("*.md"), *root.glob("docs/*.md"), *root.glob("examples/**/*.md")]


def page_of(path: Path, root: Path) -> str:
    """Where the page of a Markdown file, a module or a package is built; of others, the file."""
    inside = path.relative_to(root)
    if inside == Path("README.md"):
        return "index.html"
    if (path / "README.md").exists():
        inside /= "README.md"
    if inside.parts[:1] == ("ngspring",) and (path.suffix == ".py" or path.is_dir()):
        inside = API / inside
        inside = inside.parent if inside.name == "__init__.py" else inside
        return inside.with_suffix(".html").as_posix()
    return inside.with_suffix(".html").as_posix() if inside.suffix == ".md" else inside.as_posix()


def anchor(heading: str) -> str:
    """The id of a heading, as on GitHub."""
    return re.sub(r"[^\w\- ]", "", heading.casefold()).replace(" ", "-")


class Pages:
    """Markdown pages of the repository at `root`, as HTML in `folder`."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root = root.resolve()
        self.folder = folder
        environment = jinja2.Environment(
            loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, trim_blocks=True
        )
        self.template = environment.get_template("page.html.jinja2")
        self.markdown = MarkdownIt("commonmark", {"highlight": highlighted}).enable("table")

    def write(self, source: Path) -> None:
        """Write the page of one Markdown file, and copy what it shows."""
        source = source.resolve()
        tokens = self.markdown.parse(source.read_text(encoding="utf-8"))
        for token in every(tokens):
            for attribute in ("href", "src"):
                if attribute in token.attrs:
                    target = str(token.attrs[attribute])
                    token.attrs[attribute] = self.moved(target, source)
        headings = list(with_ids(tokens))
        here = page_of(source, self.root)
        html = self.template.render(
            title=headings[0][1] if headings else source.stem,
            bar=[
                (title, relative(page_of(self.root / path, self.root), here), path)
                for path, title in BAR.items()
                if (self.root / path).exists()
            ],
            current=source.relative_to(self.root).as_posix(),
            sections=[(name, text) for level, text, name in headings if level == 2],
            api=relative(f"{API}/ngspring.html", here),
            body=self.markdown.renderer.render(tokens, self.markdown.options, {}),
            colours=HtmlFormatter().get_style_defs("pre"),
            version=ngspring.__version__,
        )
        file = self.folder / here
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(html, encoding="utf-8")

    def moved(self, target: str, source: Path) -> str:
        """The target of a link in a Markdown file as seen from its page."""
        parts = urlsplit(target)
        if parts.scheme or not parts.path:
            return target
        path = Path(os.path.normpath(source.parent / unquote(parts.path)))
        if not path.is_relative_to(self.root) or not path.exists():
            return target  # `check` finds it
        there = page_of(path, self.root)
        if path.is_file() and not there.endswith(".html"):
            file = self.folder / there
            file.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, file)
        link = relative(there, page_of(source, self.root))
        return f"{link}#{parts.fragment}" if parts.fragment else link


def relative(there: str, here: str) -> str:
    """A link to a built page from another one."""
    return Path(os.path.relpath(there, Path(here).parent)).as_posix()


def every(tokens: Iterable[Token]) -> Iterator[Token]:
    """Tokens with those in them."""
    for token in tokens:
        yield token
        yield from every(token.children or ())


def with_ids(tokens: Sequence[Token]) -> Iterator[tuple[int, str, str]]:
    """Give the headings ids; their level, text and id."""
    for token, inline in pairwise(tokens):
        if token.type == "heading_open":
            text = "".join(t.content for t in inline.children or ())
            token.attrs["id"] = anchor(text)
            yield int(token.tag[1:]), text, anchor(text)


def highlighted(code: str, language: str, attributes: str) -> str:
    """Coloured HTML of a block of code."""
    try:
        return str(highlight(code, get_lexer_by_name(language), HtmlFormatter(nowrap=True)))
    except ClassNotFound:
        return escape(code, quote=False)


def check(folder: Path) -> None:
    """Raise BrokenLinkError unless all local links of the Markdown pages lead somewhere."""
    api = folder / API
    texts = {
        page.resolve(): page.read_text(encoding="utf-8")
        for page in folder.rglob("*.html")
        if not page.is_relative_to(api)
    }
    broken = []
    for page, text in texts.items():
        for link in re.findall(r'(?:href|src)="([^"]+)"', text):
            parts = urlsplit(unescape(link))
            if parts.scheme:
                continue
            path = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            if path.is_relative_to(api.resolve()) and not api.exists():
                continue
            fragment = parts.fragment and path in texts and f'id="{parts.fragment}"'
            if not path.is_file() or (fragment and fragment not in texts[path]):
                broken.append(f"{page.relative_to(folder.resolve())} links to {link}")
    if broken:
        raise BrokenLinkError("\n".join(broken))


def build_pages(root: Path, folder: Path) -> None:
    """The Markdown pages alone; links to the API are checked only if it is there."""
    pages = Pages(root, folder)
    for source in sources(root):
        pages.write(source)
    check(folder)


def build_api(folder: Path) -> None:
    """The API pages: the package, and the packages in it, whose modules pdoc finds."""
    found = pkgutil.iter_modules(ngspring.__path__, "ngspring.")
    names = ["ngspring", *(module.name for module in found if module.ispkg)]
    pdoc.render.configure(
        docformat="numpy",
        math=True,
        footer_text=f"ngspring {ngspring.__version__}",
        template_directory=TEMPLATES,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        pdoc.pdoc(*names, output_directory=folder)


def build(folder: Path) -> Path:
    """Write everything and return the first page."""
    build_api(folder / API)
    build_pages(ROOT, folder)
    return folder / "index.html"


def main(arguments: Sequence[str]) -> None:
    """Build into the folder that is named, and say where to start reading."""
    try:
        print(build(Path(arguments[0] if arguments else "build/docs")))
    except BrokenLinkError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main(sys.argv[1:])
