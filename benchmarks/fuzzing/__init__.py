"""Fuzzing: changed files and command lines, each refused with one line or read, within 10 s and 2 GB. Resumable.

What a reader says is its coverage: an input that makes it say something new joins those that are changed next.
"""

import random
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.fuzzing.children import BYTES, FAULTS, SECONDS, Outcome, outcomes
from benchmarks.fuzzing.command_lines import COMMAND_LINES, run_command_line, seed_command_lines
from benchmarks.fuzzing.mutations import mutated, mutated_arguments
from benchmarks.fuzzing.readers import READERS
from benchmarks.fuzzing.seeds import write_seeds
from pcnclaws.commands.configuration import whole_number
from pcnclaws.errors import unknown_name

# Inputs of a row of results, one after the other in as few children as survive them.
OF_ROW = 250
# Share of the inputs that change what was changed already.
CHANGED_AGAIN = 1 / 3
# At most so many examples of faults are kept of a row.
EXAMPLES = 5


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Rows by reader: how many inputs had which outcome, the slowest [s], and the faults."""
    names, count = list(options["readers"]), whole_number(options["inputs"], "problem.inputs")
    lines = whole_number(options["command_lines"], "problem.command_lines", least=0)
    for name in names:
        if name not in READERS:
            raise unknown_name("problem.readers", name, READERS)
    folder = context.folder / "files"
    seeds = write_seeds(folder)
    for name in names:  # what a reader imports, its children have
        for seed in seeds[name]:
            _read(name, seed.read_bytes(), folder)
    done = Checkpointed.load(context.folder, "fuzzing", {"seed": context.seed})
    counts = dict.fromkeys(names, count) | ({COMMAND_LINES: lines} if lines else {})
    rows = [(name, first) for name, total in counts.items() for first in range(0, total, OF_ROW)]
    found: dict[str, list[Any]] = {name: [] for name in counts}
    for number, (name, first) in enumerate(rows):
        context.advance(number, len(rows), name)
        numbers = range(first, min(first + OF_ROW, counts[name]))
        make = _lines_row if name == COMMAND_LINES else _files_row
        key = f"{name} {first}-{numbers[-1]}"
        found[name].append(done.row(key, lambda make=make, name=name, n=numbers: make(name, n, folder, seeds, context)))
    return {"limits": {"seconds": SECONDS, "bytes": BYTES}, "readers": {one: _summed(of) for one, of in found.items()}}


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """None: the table says it."""
    return []


def tables(document: Mapping[str, Any]) -> list[Table]:
    """Outcomes by reader."""
    table = Table(title="Changed inputs")
    for column in ("reader", "inputs", "read", "refused", *FAULTS, "slowest [s]"):
        table.add_column(column, justify="left" if column == "reader" else "right")
    for name, row in document["results"]["readers"].items():
        numbers = (str(row["outcomes"].get(word, 0)) for word in ("read", "refused", *FAULTS))
        table.add_row(name, str(row["inputs"]), *numbers, f"{row['slowest']:.1f}")
    return [table]


def _files_row(
    name: str, numbers: Sequence[int], folder: Path, seeds: Mapping[str, Sequence[Path]], context: BenchmarkContext
) -> dict[str, Any]:
    reader, kept = READERS[name], context.folder / "corpus" / name
    kept.mkdir(parents=True, exist_ok=True)
    whole, found = ([path.read_bytes() for path in paths] for paths in (seeds[name], sorted(kept.iterdir())))
    inputs = {n: _input(whole, found, _numbers(context.seed, name, n)) for n in numbers}

    def work(n: int) -> None:
        _read(name, inputs[n], folder)

    def keep(n: int, outcome: Outcome) -> None:
        (kept / f"{n:06d}{reader.ending}").write_bytes(inputs[n])

    return _row(work, numbers, keep, kept)


def _lines_row(
    name: str, numbers: Sequence[int], folder: Path, seeds: Mapping[str, Sequence[Path]], context: BenchmarkContext
) -> dict[str, Any]:
    lines = seed_command_lines(folder)
    words = sorted({word for line in lines for word in line[1:]})

    def work(n: int) -> None:
        draw = _numbers(context.seed, name, n)
        entry, *arguments = draw.choice(lines)
        run_command_line(entry, mutated_arguments(arguments, words, draw))

    return _row(work, numbers, lambda n, outcome: None, context.folder / "corpus" / name)


def _read(name: str, content: bytes, folder: Path) -> None:
    path = folder / f"input{READERS[name].ending}"
    path.write_bytes(content)
    READERS[name].read(path)


def _numbers(seed: int, name: str, n: int) -> random.Random:
    """The random numbers of an input: the same whatever came before it."""
    return random.Random(f"{seed} {name} {n}")  # noqa: S311  # no secret


def _input(whole: Sequence[bytes], found: Sequence[bytes], draw: random.Random) -> bytes:
    """A changed seed, or, one time in three, a changed input that was new: it may be damaged already."""
    pool = found if found and draw.random() < CHANGED_AGAIN else whole
    return mutated(draw.choice(pool), [*whole, *found], draw)


def _row(
    work: Callable[[int], None], numbers: Sequence[int], keep: Callable[[int, Outcome], None], kept: Path
) -> dict[str, Any]:
    counts, faults, slowest = Counter[str](), [], 0.0
    known = _known(kept)
    for n, outcome in outcomes(work, numbers):
        counts[outcome.word] += 1
        slowest = max(slowest, outcome.seconds)
        said = f"{outcome.word}: {_without_numbers(outcome.text)}"
        if outcome.word in FAULTS and len(faults) < EXAMPLES:
            text = outcome.text.replace(f"{kept.parent.parent.absolute()}/", "")  # wherever the seeds lie
            faults.append({"input": n, "outcome": outcome.word, "text": text[:300]})
        if said not in known:
            known.add(said)
            keep(n, outcome)
    if kept.is_dir():
        kept.with_suffix(".txt").write_text("\n".join(sorted(known)), encoding="utf-8")
    return {"inputs": len(numbers), "outcomes": dict(counts), "slowest": slowest, "faults": faults}


def _known(kept: Path) -> set[str]:
    """What a reader has said so far."""
    said = kept.with_suffix(".txt")
    return set(said.read_text(encoding="utf-8").splitlines()) if said.is_file() else set()


def _without_numbers(text: str) -> str:
    """A message without what differs from input to input."""
    return re.sub(r"'[^']*'|\"[^\"]*\"|[^\x20-\x7e]|[-+.\deEx]*\d[-+.\w]*", "#", " ".join(text.split()))[:160]


def _summed(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    counts = Counter[str]()
    for row in rows:
        counts.update(row["outcomes"])
    return {
        "inputs": sum(row["inputs"] for row in rows),
        "outcomes": dict(counts),
        "slowest": max(row["slowest"] for row in rows),
        "faults": [fault for row in rows for fault in row["faults"]][:EXAMPLES],
    }
