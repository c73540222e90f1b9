"""Writes the page of results: python -m pcnclaws.results_page docs/results/accuracy docs/results.md."""

import sys
from pathlib import Path

from pcnclaws.errors import UserError
from pcnclaws.results_page.page import write_page


def main() -> None:
    """The command."""
    if len(sys.argv) != 3:
        sys.exit("accepted: the folder of results and the page, docs/results/accuracy docs/results.md")
    folder, output = map(Path, sys.argv[1:])
    try:
        for path in write_page(folder, output):
            print(f"wrote {path}")
    except UserError as fault:
        print(fault, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
