"""Pages of the site that docs/ does not hold: the README as its front page, and the files outside that pages link to.

A link from docs/ to a program, a test or a folder of the checkout leads to a page that shows it. The texts stay where
they are, and their links work on the site as they do in the checkout.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

LINK = re.compile(r"(?P<before>\]\()(?P<target>[^)\s#]+)(?P<anchor>#[^)\s]*)?(?P<after>\))")
SHORT_CELL = re.compile(r"<td(?P<style> style=\"[^\"]*\")?>(?P<text>[^<]{1,12})</td>")
# Texts of the checkout that are pages of the site.
PAGES = {"README.md": "index.md", "CHANGELOG.md": "changelog.md"}
LANGUAGES = {".py": "python", ".cpp": "cpp", ".hpp": "cpp", ".f90": "fortran", ".mk": "make", ".md": "markdown"}
FENCE = "~~~~~~"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds those pages, and one for each file and folder that they and the pages of docs/ link to."""
    root, docs = Path(config.config_file_path).parent, Path(config.docs_dir)
    for text, page in PAGES.items():
        files.append(File.generated(config, page, content=(root / text).read_text(encoding="utf-8")))
    for source in sorted({*docs.rglob("*.md"), *(root / text for text in PAGES)}):
        for match in LINK.finditer(source.read_text(encoding="utf-8")):
            linked = _inside(root, source, match["target"])
            shown = linked and _page_of(root, docs, linked)
            if linked and shown and files.get_file_from_path(shown) is None:
                files.append(File.generated(config, shown, content=_content(root, linked)))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, **_: Any) -> str:
    """The text of a page with links to the pages of linked files."""
    root, docs = Path(config.config_file_path).parent, Path(config.docs_dir)
    here = page.file.src_uri
    source = next((root / text for text, uri in PAGES.items() if uri == here), docs / here)
    if not source.is_file():  # a page that is made here
        return markdown

    def led(match: re.Match[str]) -> str:
        linked = _inside(root, source, match["target"])
        if linked is None:
            return match[0]
        shown = _page_of(root, docs, linked) or linked.relative_to(docs).as_posix()
        target = posixpath.relpath(shown, posixpath.dirname(here) or ".")
        return f"{match['before']}{target}{match['anchor'] or ''}{match['after']}"

    return LINK.sub(led, markdown)


def on_page_content(html: str, **_: Any) -> str:
    """The page with short cells of tables that are not broken: 9.0e-09 would be, at its hyphen."""
    return SHORT_CELL.sub(r'<td class="short"\g<style>>\g<text></td>', html)


def _inside(root: Path, source: Path, target: str) -> Path | None:
    """The file or folder of the checkout that a link leads to."""
    if ":" in target:
        return None
    linked = (source.parent / target).resolve()
    return linked if linked.exists() and linked.is_relative_to(root) else None


def _page_of(root: Path, docs: Path, linked: Path) -> str | None:
    """The page that shows a file or a folder; None for what docs/ holds itself."""
    name = linked.relative_to(root).as_posix()
    if name in PAGES:
        return PAGES[name]
    if linked.is_relative_to(docs) and linked.is_file():
        return None
    return f"files/{name}.md"


def _content(root: Path, linked: Path) -> str:
    title = f"# {linked.relative_to(root).as_posix()}\n\n"
    if linked.is_dir():
        names = sorted(path.relative_to(linked).as_posix() for path in linked.rglob("*") if path.is_file())
        return title + "\n".join(f"- `{name}`" for name in names if "__pycache__" not in name) + "\n"
    text = linked.read_text(encoding="utf-8", errors="replace")
    return f"{title}{FENCE}{LANGUAGES.get(linked.suffix, 'text')}\n{text}\n{FENCE}\n"
