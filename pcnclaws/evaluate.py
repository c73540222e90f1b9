"""Errors of a law: python -m pcnclaws.evaluate material=sand law=analytic trajectories=x.h5 output=metrics.json."""

from collections.abc import Mapping

from pcnclaws.commands import launcher
from pcnclaws.commands.typed_configs import EvaluateConfig


def evaluate(config: EvaluateConfig) -> Mapping[str, float | None]:
    """Writes the errors of the configured law on the configured task to `output`, and pictures; returns their means."""
    from pcnclaws.commands import evaluation_command as work  # loads PyTorch

    return work.evaluate(config)


def main() -> None:
    """The command."""
    launcher.main(evaluate, "evaluate")


if __name__ == "__main__":
    main()
