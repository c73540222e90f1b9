"""The console command: `pcnclaws train experiment=sand_multi` is `python -m pcnclaws.train experiment=sand_multi`."""

import sys
from collections.abc import Sequence
from typing import NoReturn

from pcnclaws.commands import launcher
from pcnclaws.commands.completion import SCRIPTS, candidates
from pcnclaws.commands.help import overview
from pcnclaws.commands.jobs import WRONG_INPUT
from pcnclaws.commands.tasks import TASKS
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.version import __version__

COMPLETION, COMPLETE = "completion", "complete"


def run(arguments: Sequence[str]) -> int:
    """The exit status of the console command with these arguments: the name of a command, then what it takes."""
    name, *rest = arguments or ["--help"]
    if name in TASKS:
        return launcher.run(TASKS[name], name, rest)
    try:
        launcher.say(_answer(name, rest))
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return WRONG_INPUT
    return 0


def main() -> NoReturn:
    """The command."""
    sys.exit(run(sys.argv[1:]))


def _answer(name: str, rest: Sequence[str]) -> str:
    """What the console command says itself; UserError for a name that is no command."""
    if name in launcher.HELP:
        return overview({name: task.__doc__ for name, task in TASKS.items()})
    if name == "--version":
        return f"pcnclaws {__version__}"
    if name == COMPLETION:
        (shell, *_) = rest or [""]
        if shell not in SCRIPTS:
            raise unknown_name(COMPLETION, shell, SCRIPTS)
        return SCRIPTS[shell]
    if name == COMPLETE:  # called by those scripts, with the line as it was typed so far
        return "\n".join(candidates(" ".join(rest), list(TASKS)))
    raise unknown_name("command", name, [*TASKS, COMPLETION])


if __name__ == "__main__":
    main()
