"""Training of the laws of a material: python -m pcnclaws.train experiment=sand_multi."""

from pcnclaws.commands import launcher
from pcnclaws.commands.tasks import train


def main() -> None:
    """The command."""
    launcher.main(train, "train")


if __name__ == "__main__":
    main()
