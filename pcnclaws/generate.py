"""Data sets made with the analytic laws: python -m pcnclaws.generate material=sand."""

from pcnclaws.commands import launcher
from pcnclaws.commands.typed_configs import GenerateConfig


def generate(config: GenerateConfig) -> None:
    """Makes what is missing of the data set in data.folder, and a picture of it."""
    from pcnclaws.commands import generation_command as work  # loads PyTorch

    work.generate(config)


def main() -> None:
    """The command."""
    launcher.main(generate, "generate")


if __name__ == "__main__":
    main()
