"""Writes the pages of results: python -m benchmarks.pages docs/results/accuracy docs/results.md.

With a second folder and page, docs/results/baselines docs/comparison.md, also the comparison, which it prints, too.
"""

import sys
from pathlib import Path

from benchmarks.pages.comparison import write_comparison
from benchmarks.pages.page import write_page
from pcnclaws.errors import UserError


def main() -> None:
    """The command."""
    if len(sys.argv) not in (3, 5):
        sys.exit(
            "accepted: a folder of results and its page, docs/results/accuracy docs/results.md, "
            "and perhaps those of the comparison, docs/results/baselines docs/comparison.md"
        )
    folder, output, *compared = map(Path, sys.argv[1:])
    try:
        written = write_page(folder, output)
        if compared and compared[0].is_dir():
            written += write_comparison(*compared)
            print(compared[1].read_text(encoding="utf-8"))
        for path in written:
            print(f"wrote {path}")
    except UserError as fault:
        print(fault, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
