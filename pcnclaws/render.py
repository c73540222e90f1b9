"""Pictures and films of recorded motions: python -m pcnclaws.render trajectory=x.h5 output=x.mp4 colour=speed."""

from pcnclaws.commands import launcher
from pcnclaws.commands.typed_configs import RenderConfig


def render(config: RenderConfig) -> None:
    """Draws recorded motions: a sheet of their times (png, pdf, svg) or a film (gif, mp4), as `output` ends."""
    from pcnclaws.commands import render_command as work  # loads PyTorch

    work.render(config)


def main() -> None:
    """The command."""
    launcher.main(render, "render")


if __name__ == "__main__":
    main()
