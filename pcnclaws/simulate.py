"""Simulation of one scene: python -m pcnclaws.simulate material=sand law=analytic output=x.h5."""

from pcnclaws.commands import launcher
from pcnclaws.commands.typed_configs import SimulateConfig


def simulate(config: SimulateConfig) -> None:
    """Writes the trajectory of the configured scene to `output`, and a picture of it beside it."""
    from pcnclaws.commands import simulation_command as work  # loads PyTorch

    work.simulate(config)


def main() -> None:
    """The command."""
    launcher.main(simulate, "simulate")


if __name__ == "__main__":
    main()
