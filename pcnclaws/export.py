"""A recorded motion as files of other programs: python -m pcnclaws.export trajectory=x.h5 format=vtu output=x.pvd."""

from pcnclaws.commands import launcher
from pcnclaws.commands.typed_configs import ExportConfig


def export(config: ExportConfig) -> None:
    """Writes a recorded motion as files for ParaView (vtu), Blender and Houdini (ply, usd) or programs (npz, csv)."""
    from pcnclaws.commands import export_command as work  # loads PyTorch

    work.export(config)


def main() -> None:
    """The command."""
    launcher.main(export, "export")


if __name__ == "__main__":
    main()
