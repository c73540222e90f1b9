"""Training of the laws of a material: python -m pcnclaws.train experiment=sand_multi."""

from collections.abc import Mapping

from pcnclaws.commands import launcher
from pcnclaws.commands.typed_configs import TrainConfig


def train(config: TrainConfig) -> Mapping[str, float | None]:
    """Makes the data if it is missing, trains, tests, and fills the run folder `output`; returns errors of the law."""
    from pcnclaws.commands import training_command as work  # loads PyTorch

    return work.train(config)


def main() -> None:
    """The command."""
    launcher.main(train, "train")


if __name__ == "__main__":
    main()
