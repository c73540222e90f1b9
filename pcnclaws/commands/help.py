"""Help of the console command, and of one command: its groups, their choices, its options with their values."""

from collections.abc import Mapping, Sequence

from omegaconf import DictConfig, OmegaConf

from pcnclaws.commands.choices import choices_of
from pcnclaws.commands.composition import composed_groups, conf_folder

FLAGS = {
    "--cfg job": "the options alone",
    "--multirun": "one job for each combination of comma-separated values",
    "--hydra-help": "the flags of Hydra",
}
OF_CONSOLE = {
    "pcnclaws COMMAND --help": "its groups and options",
    "pcnclaws completion bash": 'completion for this shell, or zsh, fish: eval "$(pcnclaws completion bash)"',
    "pcnclaws --version": "the version",
}


def overview(words: Mapping[str, str | None]) -> str:
    """What `pcnclaws --help` prints.

    words  the docstring of each command's task
    """
    commands = {name: (text or "").partition("\n")[0] for name, text in words.items()}
    return "\n\n".join(
        (
            "pcnclaws COMMAND option=value group=choice ...",
            _table("Commands, each also python -m pcnclaws.COMMAND", commands),
            _table("More", OF_CONSOLE),
        )
    )


def help_text(entry: str, words: str | None, overrides: Sequence[str]) -> str:
    """What `--help` prints, with the overrides beside it applied.

    words   what the command does: the docstring of its task
    raises  errors of Hydra and OmegaConf for overrides that cannot be composed
    """
    options, groups = composed_groups(entry, overrides)
    return "\n\n".join(
        (
            f"pcnclaws {entry} option=value group=choice ...",
            (words or "").partition("\n")[0],
            _table("Flags", FLAGS),
            _table("Groups and their choices", {name: ", ".join(choices_in(name)) for name in sorted(groups)}),
            f"Options\n\n{_shown(options)}",
        )
    )


def choices_in(group: str) -> list[str]:
    """The choices of a group, those of files and those of objects."""
    files = (conf_folder() / group).glob("*.yaml")
    return sorted({*(path.stem for path in files), *choices_of(group)})


def _table(title: str, rows: Mapping[str, str]) -> str:
    width = max(map(len, rows))
    return "\n".join((f"{title}\n", *(f"  {name:<{width}}  {words}" for name, words in rows.items())))


def _shown(options: DictConfig) -> str:
    return "\n".join(f"  {line}" for line in OmegaConf.to_yaml(options).splitlines())
