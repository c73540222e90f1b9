"""Pictures and films of recorded motions: python -m pcnclaws.render trajectory=x.h5 output=x.mp4 colour=speed."""

from pcnclaws.commands import launcher
from pcnclaws.commands.tasks import render


def main() -> None:
    """The command."""
    launcher.main(render, "render")


if __name__ == "__main__":
    main()
