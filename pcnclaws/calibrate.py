"""Calibration of a law for estimation: python -m pcnclaws.calibrate material=sand law=RUN_FOLDER."""

from pcnclaws.commands import launcher
from pcnclaws.commands.typed_configs import CalibrateConfig


def calibrate(config: CalibrateConfig) -> None:
    """Writes estimation.json, the error of the law in marker positions, beside its weights or to `output`."""
    from pcnclaws.commands import calibration_command as work  # loads PyTorch

    work.calibrate(config)


def main() -> None:
    """The command."""
    launcher.main(calibrate, "calibrate")


if __name__ == "__main__":
    main()
