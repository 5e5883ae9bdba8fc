"""Adds to the documentation site what docs/ does not contain: pages from other folders, generated pages, and files that pages link to.
Only mkdocs uses it (see mkdocs.yml).

Links in the pages are relative to their position in the repository, so that they work there, too; this module converts them to positions on
the site. A link to a file that is not a page leads to a copy of the file.
"""

from __future__ import annotations

import importlib.util
import os
import posixpath
import re
import subprocess
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent

ELSEWHERE = {
    "benchmarks/README.md": "verification/benchmarks.md",
    "CHANGELOG.md": "reference/changelog.md",
    "CONTRIBUTING.md": "how-to/contributing.md",
    "README.md": "index.md",
}
"""Pages outside docs/, and their positions on the site."""

COMMAND_LINE = "reference/command-line.md"
SOURCES = "files"
"""The folder of the site with copies of the repository's files that pages link to."""

LINK = re.compile(r"(\]\()([^)\s]+)(\))")
FENCE = re.compile(r"^( *)(```|~~~).*?^\1\2 *$", re.DOTALL | re.MULTILINE)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """List the decisions in the navigation, newest last."""
    names = sorted(path.name for path in (ROOT / "docs" / "decisions").glob("0*.md"))
    config.nav = _with_decisions(config.nav, ["decisions/index.md", *(f"decisions/{name}" for name in names)])
    return config


def _with_decisions(entry: object, pages: list[str]) -> object:
    match entry:
        case list():
            return [_with_decisions(part, pages) for part in entry]
        case dict():
            return {title: pages if part == "decisions/" else _with_decisions(part, pages) for title, part in entry.items()}
        case _:
            return entry


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from other folders, the generated pages, and the script that draws diagrams."""
    for source, page in ELSEWHERE.items():
        if files.get_file_from_path(page) is None:
            files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    files.append(File.generated(config, COMMAND_LINE, content=_command_line()))
    for path in sorted(_mermaid().glob("*.js")):
        files.append(File.generated(config, f"assets/mermaid/{path.name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Convert links to positions on the site."""
    here = page.file.src_uri
    origin = next((source for source, target in ELSEWHERE.items() if target == here and _is_generated(page.file)), f"docs/{here}")

    def turned(link: re.Match[str]) -> str:
        address, _, anchor = link[2].partition("#")
        if not address or re.match(r"[a-z][a-z0-9+.-]*:", address):
            return link[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(origin), address))
        target = _on_the_site(path, here, config, files)
        return f"{link[1]}{posixpath.relpath(target, posixpath.dirname(here) or '.')}{'#' + anchor if anchor else ''}{link[3]}"

    parts, end = [], 0
    for fence in FENCE.finditer(markdown):
        parts += [LINK.sub(turned, markdown[end : fence.start()]), fence[0]]
        end = fence.end()
    return "".join([*parts, LINK.sub(turned, markdown[end:])])


def _is_generated(file: File) -> bool:
    return file.generated_by is not None


def _on_the_site(path: str, page: str, config: MkDocsConfig, files: Files) -> str:
    """Return the position of a file or a folder of the repository on the site."""
    if path in ELSEWHERE:
        return ELSEWHERE[path]
    if path.startswith("docs/"):
        inside = path.removeprefix("docs/")
        return inside if inside.endswith(".md") or "." in posixpath.basename(inside) else f"{inside}/index.md"
    source = ROOT / path
    if source.is_dir() and (source / "__init__.py").exists():
        source, path = source / "__init__.py", f"{path}/__init__.py"
    if not source.is_file():
        raise PluginError(f"{page} links to {path}, which is not a file of the repository")
    target = f"{SOURCES}/{path}.txt" if source.suffix in (".py", ".md", ".toml", "") else f"{SOURCES}/{path}"
    if files.get_file_from_path(target) is None:
        files.append(File.generated(config, target, abs_src_path=str(source)))
    return target


def _command_line() -> str:
    """Return the reference page of the command `somrs`, generated from its help."""
    made = subprocess.run(
        [sys.executable, "-m", "typer", "somrs.cli.main", "utils", "docs", "--name", "somrs", "--title", "The command line"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "TERM": "dumb", "COLUMNS": "200"},
    )
    if made.returncode:
        raise PluginError(f"the command-line page cannot be generated: {made.stderr.strip()}")
    return made.stdout


def _mermaid() -> Path:
    """Return the folder of Mermaid's modules, which are a part of NiceGUI."""
    spec = importlib.util.find_spec("nicegui")
    if spec is None or spec.origin is None:
        raise PluginError("Mermaid, which draws the diagrams, is a part of NiceGUI: pip install 'somrs[gui]'")
    return Path(spec.origin).parent / "elements" / "mermaid" / "dist"
