"""Data sets made with the analytic laws: python -m pcnclaws.generate material=sand."""

from pcnclaws.commands import launcher
from pcnclaws.commands.tasks import generate


def main() -> None:
    """The command."""
    launcher.main(generate, "generate")


if __name__ == "__main__":
    main()
