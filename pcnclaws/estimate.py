"""Physical parameters from motion: python -m pcnclaws.estimate material=sand observation.file=x.h5."""

from pcnclaws.commands import launcher
from pcnclaws.commands.tasks import estimate


def main() -> None:
    """The command."""
    launcher.main(estimate, "estimate")


if __name__ == "__main__":
    main()
