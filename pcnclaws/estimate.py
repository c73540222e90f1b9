"""Physical parameters from motion: python -m pcnclaws.estimate material=sand observation.file=x.h5."""

from collections.abc import Mapping

from pcnclaws.commands import launcher
from pcnclaws.commands.typed_configs import EstimateConfig


def estimate(config: EstimateConfig) -> Mapping[str, float | None]:
    """Writes the parameters that explain the observation to `output`, with intervals; returns estimates and error."""
    from pcnclaws.commands import estimation_command as work  # loads PyTorch

    return work.estimate(config)


def main() -> None:
    """The command."""
    launcher.main(estimate, "estimate")


if __name__ == "__main__":
    main()
