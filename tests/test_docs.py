"""The docs site: every page is in its navigation, every link leads somewhere, every public name has its entry."""

import json
import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import IntervalSweep

import pcnclaws as pc
from pcnclaws.commands.composition import compose_config

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
# Made of texts outside of docs/ when the site is built: docs/hooks/linked_files.py.
MADE = {"index.md": "README.md", "changelog.md": "CHANGELOG.md"}
PAGES = sorted({*DOCS.rglob("*.md"), *DOCS.rglob("*.ipynb")})
TEXTS = [*PAGES, *(ROOT / name for name in MADE.values())]
LINK = re.compile(r"\]\(([^)\s]+)\)")


class Loader(yaml.SafeLoader):
    """Reads mkdocs.yml, whose tags name functions, without them."""


Loader.add_multi_constructor("", lambda loader, suffix, node: None)


def in_navigation(entry: Any) -> Iterator[str]:
    if isinstance(entry, str):
        yield entry
        return
    for one in entry.values() if isinstance(entry, dict) else entry:
        yield from in_navigation(one)


def written(path: Path) -> str:
    """The Markdown of a page or of a notebook, without its blocks of code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = [cell["source"] for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown"]
        text = "\n\n".join("".join(source) for source in cells)
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)


def anchors(path: Path) -> set[str]:
    """What a link may name behind #: the headings, as GitHub and the site spell them."""
    titles = re.findall(r"^#+ +(.+)$", written(path), re.MULTILINE)
    plain = [re.sub(r"[^\w\s-]", "", title.lower()).strip() for title in titles]
    return {re.sub(r"\s", "-", title) for title in plain}


def test_every_page_is_in_the_navigation_once() -> None:
    # the loader is a safe one
    site = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), Loader)  # noqa: S506
    named = list(in_navigation(site["nav"]))
    assert sorted(named) == sorted([*MADE, *(page.relative_to(DOCS).as_posix() for page in PAGES)])


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    for link in LINK.findall(written(page)):
        if re.match(r"[a-z]+:", link):
            continue
        target, _, anchor = link.partition("#")
        linked = (page.parent / target).resolve() if target else page
        assert linked.exists(), link
        assert not anchor or linked.suffix != ".md" or anchor in anchors(linked), link


def test_every_public_name_is_in_the_reference() -> None:
    described = re.findall(r"^::: pcnclaws\.(\w+)$", "\n".join(map(written, (DOCS / "reference").glob("*.md"))), re.M)
    assert sorted(described) == sorted(pc.__all__)


def first_job(words: list[str]) -> Iterator[str]:
    """The options of the first job of a sweep, or of the only one."""
    for override in OverridesParser.create().parse_overrides([word for word in words if not word.startswith("--")]):
        name, value = override.get_key_element(), override.value()
        if not name.startswith("hydra"):
            if isinstance(value, IntervalSweep):
                yield f"{name}={value.start}"
            elif override.is_sweep_override():
                yield f"{name}={next(iter(override.sweep_string_iterator()))}"
            else:
                yield override.input_line or ""


def test_commands_that_are_not_run_have_options_that_exist() -> None:
    seen = 0
    for page in (DOCS / "how_to").glob("*.md"):
        for block in re.findall(r"^```shell\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
            lines = block.replace("\\\n", " ")
            for entry, words in re.findall(r"^(?:exec )?pcnclaws (\w+) (.*)$", lines, re.MULTILINE):
                compose_config(entry, list(first_job(shlex.split(re.sub(r"\$\w+", "1", words)))))
                seen += 1
    assert seen > 2


@pytest.mark.parametrize("notebook", sorted(DOCS.rglob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_hold_their_results(notebook: Path) -> None:
    cells = [cell for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell["outputs"])
    assert notebook.stat().st_size < 500_000


def code_of(page: Path) -> list[tuple[str, str]]:
    """The blocks of a page that are run, with their languages, in order."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        return [("python", "".join(cell["source"])) for cell in cells if cell["cell_type"] == "code"]
    return re.findall(r"^```(python|bash)[^\n]*\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


# PyTorch warns of its own use of torch.jit when it loads forward mode
@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if page.parent.name in ("how_to", "notebooks")] + [DOCS / "getting_started.md"],
    ids=lambda page: page.stem,
)
def test_the_blocks_of_a_page_run_one_after_the_other(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_a_shell: Callable[[str], None]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for language, block in code_of(page):
        if language == "bash":
            in_a_shell(block)
        elif match := re.match(r"# (\w+\.py)\n", block):  # a file that the commands read
            (tmp_path / match[1]).write_text(block)
        else:
            exec(compile(block, page.name, "exec"), names)  # noqa: S102  # our own page
