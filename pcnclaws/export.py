"""Motions and laws for other programs: python -m pcnclaws.export trajectory=x.h5 output=x.pvd."""

from pcnclaws.commands import launcher
from pcnclaws.commands.tasks import export


def main() -> None:
    """The command."""
    launcher.main(export, "export")


if __name__ == "__main__":
    main()
