"""Completion of the console command in a shell: commands, options, groups and their choices.

A shell asks `pcnclaws complete LINE` for whole words; the scripts below hand them over in the manner of each shell.
Where nothing fits, the shell completes the names of files.
"""

from collections.abc import Iterator, Sequence
from typing import Any, cast

from omegaconf import OmegaConf

from pcnclaws.commands.choices import offer_choices
from pcnclaws.commands.composition import CONFIG_ERRORS, as_hydra_reads_them, composed_groups, register_resolvers
from pcnclaws.commands.help import choices_in
from pcnclaws.commands.options import leaves
from pcnclaws.errors import UserError

# Bash takes the text behind the last = or : for the word that it completes.
BASH = """\
_pcnclaws() {
    local line="${COMP_LINE:0:COMP_POINT}" word reply
    word="${line##* }"
    COMPREPLY=()
    while IFS= read -r reply; do
        [[ $word == *=* && $COMP_WORDBREAKS == *=* ]] && reply="${reply#*=}"
        [[ -n $reply ]] && COMPREPLY+=("$reply")
    done < <(pcnclaws complete "$line" 2>/dev/null)
}
complete -o default -o nospace -F _pcnclaws pcnclaws"""
ZSH = """\
autoload -Uz compinit && compinit -u
_pcnclaws() {
    local -a replies
    replies=("${(@f)$(pcnclaws complete "${(j: :)words[1,CURRENT]}" 2>/dev/null)}")
    [[ -n $replies[1] ]] && compadd -S '' -a replies || { compset -P '*='; _files }
}
compdef _pcnclaws pcnclaws"""
FISH = """\
complete -c pcnclaws -a '(pcnclaws complete (commandline -cp) 2>/dev/null)'"""
SCRIPTS = {"bash": BASH, "zsh": ZSH, "fish": FISH}
FLAGS = ("--cfg", "--help", "--multirun")


def candidates(line: str, commands: Sequence[str]) -> list[str]:
    """The words that the last one of a command line may become, `pcnclaws` being the first.

    commands  names of the commands
    returns   whole words: `material=sand`; one that goes on ends in = or with a dot
    """
    words = line.split(" ")
    if len(words) <= 2:
        return [name for name in (*commands, "completion", "--help", "--version") if name.startswith(words[-1])]
    entry, *before, word = words[1:]
    if entry not in commands:
        return []
    return sorted({name for name in _offered(entry, before, word) if name.startswith(word) and name != word})


def _offered(entry: str, before: Sequence[str], word: str) -> Iterator[str]:
    if word.startswith("-"):
        yield from FLAGS
        return
    options, groups = _known(entry, before)
    option, says, _ = word.partition("=")
    names = {name.replace("/", "."): name for name in groups}
    if not says:
        depth = word.count(".") + 1
        for name in (*options, *names):
            parts = name.split(".")
            yield f"{'.'.join(parts[:depth])}{'=' if len(parts) <= depth else '.'}"
    elif option in names:
        yield from (f"{option}={choice}" for choice in choices_in(names[option]))
    elif isinstance(options.get(option), bool):
        yield from (f"{option}=true", f"{option}=false")


def _known(entry: str, before: Sequence[str]) -> tuple[dict[str, Any], list[str]]:
    """The options of a command by name, and its groups, with the words before where they can be read."""
    register_resolvers()
    try:
        overrides = as_hydra_reads_them([word for word in before if "=" in word])
        offer_choices(overrides)
        config, groups = composed_groups(entry, overrides)
    except (*CONFIG_ERRORS, UserError):
        offer_choices()
        config, groups = composed_groups(entry, [])
    options = cast(dict[str, Any], OmegaConf.to_container(config, resolve=False))
    return dict(leaves(options)), groups
