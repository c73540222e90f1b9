"""Simulation of one scene: python -m pcnclaws.simulate material=sand law=analytic output=x.h5."""

from pcnclaws.commands import launcher
from pcnclaws.commands.tasks import simulate


def main() -> None:
    """The command."""
    launcher.main(simulate, "simulate")


if __name__ == "__main__":
    main()
