"""The pages of the laws that ship are those of their cards and weights."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.pages.laws import law_page, shipped

PAGES = Path(__file__).parents[2] / "docs" / "laws"


def test_each_law_that_ships_has_a_page() -> None:
    assert [path.stem for path in sorted(PAGES.iterdir())] == shipped() == ["elasticity", "plasticine", "sand"]


@pytest.mark.parametrize("material", shipped())
def test_a_page_is_what_its_command_writes(material: str) -> None:
    text = law_page(material)
    assert (PAGES / f"{material}.md").read_text(encoding="utf-8") == text
    for words in ("Errors on objects that it was not trained on", "| `youngs_modulus` | E | Pa |", "calibrated on"):
        assert words in text


@pytest.mark.slow
def test_the_command_names_what_it_wrote(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.pages.laws", str(tmp_path / "laws")], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [f"wrote {tmp_path / 'laws' / name}.md" for name in shipped()]
