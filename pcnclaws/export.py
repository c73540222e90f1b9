"""Motions and laws for other programs: python -m pcnclaws.export trajectory=x.h5 output=x.pvd."""

from pcnclaws.commands import launcher
from pcnclaws.commands.typed_configs import ExportConfig


def export(config: ExportConfig) -> None:
    """Writes a motion for ParaView (vtu), Blender and Houdini (ply, usd) or programs (npz, csv), or a law alone."""
    from pcnclaws.commands import export_command as work  # loads PyTorch

    work.export(config)


def main() -> None:
    """The command."""
    launcher.main(export, "export")


if __name__ == "__main__":
    main()
