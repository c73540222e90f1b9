"""Calibration of a law for estimation: python -m pcnclaws.calibrate material=sand law=RUN_FOLDER."""

from pcnclaws.commands import launcher
from pcnclaws.commands.tasks import calibrate


def main() -> None:
    """The command."""
    launcher.main(calibrate, "calibrate")


if __name__ == "__main__":
    main()
