"""Errors of a law: python -m pcnclaws.evaluate material=sand law=analytic trajectories=x.h5 output=metrics.json."""

from pcnclaws.commands import launcher
from pcnclaws.commands.tasks import evaluate


def main() -> None:
    """The command."""
    launcher.main(evaluate, "evaluate")


if __name__ == "__main__":
    main()
