"""The pages link to each other, and say what the program says."""

from __future__ import annotations

import ast
import re
import runpy
import sys
from pathlib import Path
from typing import Any

import pytest

import ngspring
from ngspring.campaign.plan import parse_campaign

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "CONTRIBUTING.md", *(f"docs/{p.name}" for p in ROOT.glob("docs/*.md")))


@pytest.fixture(scope="module")
def build() -> dict[str, Any]:
    return runpy.run_path(str(ROOT / "docs" / "build.py"))


def blocks(language: str) -> list[tuple[str, str]]:
    found = [(page, (ROOT / page).read_text(encoding="utf-8")) for page in PAGES]
    pattern = rf"^```{language}\n(.*?)^```"
    return [(page, code) for page, text in found for code in re.findall(pattern, text, re.M | re.S)]


def test_all_pages_are_built_with_links_that_lead_somewhere(
    build: dict[str, Any], tmp_path: Path
) -> None:
    build["build_pages"](ROOT, tmp_path)
    start = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert 'href="docs/guide.html"' in start
    assert 'href="docs/guide.html#extras"' in start
    assert (tmp_path / "examples" / "paper" / "figures" / "C7.png").is_file()
    chapters = (tmp_path / "docs" / "how-it-works.html").read_text(encoding="utf-8")
    assert 'href="../api/ngspring/kkt/system.html"' in chapters
    assert 'href="../api/ngspring/physics/terms.html"' in chapters
    assert '<h2 id="9-solid">' in chapters
    assert "<table>" in chapters


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[a page](missing.md)", "index.html links to missing.md"),
        ("![a picture](missing.png)", "index.html links to missing.png"),
        ("[a module](ngspring/missing.py)", "index.html links to ngspring/missing.py"),
        ("[a heading](#missing)", "index.html links to #missing"),
        ("[a heading](docs/other.md#missing)", "index.html links to docs/other.html#missing"),
        ("[outside](../elsewhere.md)", "index.html links to ../elsewhere.md"),
    ],
)
def test_a_link_that_leads_nowhere_is_an_error(
    build: dict[str, Any], tmp_path: Path, text: str, complaint: str
) -> None:
    root = tmp_path / "repository"
    (root / "docs").mkdir(parents=True)
    (root / "docs" / "other.md").write_text("# Other\n\n## There\n\n[back](../README.md)\n")
    (root / "README.md").write_text("# Start\n\n[there](docs/other.md#there) [x](https://x.org)\n")
    api = tmp_path / "pages" / "api"
    api.mkdir(parents=True)
    (api / "ngspring.html").write_text("<html></html>")
    build["build_pages"](root, tmp_path / "pages")
    (root / "README.md").write_text(f"# Start\n\n{text}\n")
    with pytest.raises(ValueError, match=f"^{re.escape(complaint)}$"):
        build["build_pages"](root, tmp_path / "pages")


def test_the_command_reference_is_what_the_commands_say() -> None:
    made = runpy.run_path(str(ROOT / "docs" / "commands.py"))["text"]()
    written = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert written == made, "run python docs/commands.py"


def test_the_readme_is_a_front_door() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 800


def test_what_contributing_names_exists() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:[\w.]+/)+[\w.]*|[\w.-]+\.(?:toml|md))`", text)
    assert len(named) > 20
    for path in named:
        assert (ROOT / path).exists(), path


def test_the_map_in_contributing_has_every_package() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    packages = {path.parent.name for path in ROOT.glob("ngspring/*/__init__.py")}
    assert set(re.findall(r"^\| `ngspring/(\w+)/` \|", text, re.M)) == packages


def test_every_package_has_its_chapter() -> None:
    text = (ROOT / "docs" / "how-it-works.md").read_text(encoding="utf-8")
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = layers["tool"]["importlinter"]["contracts"][0]["layers"]
    order = [name for layer in reversed(contract) for name in layer.split(" | ")]
    chapters = re.findall(r"^## \d+\. (\w+)$", text, re.M)
    assert [f"ngspring.{name}" for name in chapters] == order[:-1]


@pytest.mark.parametrize(("page", "code"), blocks("python"))
def test_python_on_the_pages_uses_public_names(page: str, code: str) -> None:
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            assert node.value.id != "ngspring" or hasattr(ngspring, node.attr), node.attr
        if isinstance(node, ast.ImportFrom) and node.module == "ngspring":
            assert all(hasattr(ngspring, name.name) for name in node.names)


@pytest.mark.parametrize(("page", "code"), blocks("toml"))
def test_toml_on_the_pages_is_understood(page: str, code: str) -> None:
    if "[[run]]" in code:
        assert len(parse_campaign(code).runs) >= 2
        return
    point = "" if "control_points" in code else "\n[[control_points]]\nd = 10\nq = 2\n"
    ngspring.SpringProblem.parse_toml(code + point)


def test_the_file_formats_name_every_key_of_a_problem_and_every_column() -> None:
    text = (ROOT / "docs" / "file-formats.md").read_text(encoding="utf-8")
    history = ngspring.gallery["C7"].history
    assert history is not None
    columns = [name for name in history.columns if not re.search(r"[2-9]$", name)]
    for name in (*ngspring.SpringProblem.__dataclass_fields__, *columns):
        assert f"`{name}`" in text, name
