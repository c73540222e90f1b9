"""What every benchmark problem is given, and rows of results that survive an interruption."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import torch

from benchmarks.yardstick import Yardstick
from pcnclaws.atomic import one_line_writing, replaced_file
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.materials import Material
from pcnclaws.provenance import commit


@dataclass(frozen=True)
class BenchmarkContext:
    """Where a problem runs and whom it tells.

    folder     results and partial results go here; it exists
    advance    called with (rows done, rows in all, what comes next): progress with the time left, on stderr.
               Call it first after the options have been checked: it may print.
    yardstick  times of the reference matrix product; let what is timed share a run with it (see `interleaved`)
    laws       the laws that an option names (analytic, pretrained, or the path of a run folder), for a material
    """

    device: torch.device
    seed: int
    folder: Path
    advance: Callable[[int, int, str], None]
    yardstick: Yardstick
    laws: Callable[[str, Material], Laws]


class Checkpointed:
    """Rows of results by name, each on the disk as soon as it is known.

    They live in <folder>/<name>.partial.jsonl: a line with the fingerprint of the settings, then a line a row. Rows of
    other settings are forgotten; the code may have changed in between, so that each row notes its commit.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path, self.fingerprint = path, fingerprint
        self._lines = _lines_of(path, fingerprint)
        self._continues = False

    @classmethod
    def load(cls, folder: Path, name: str, key: Mapping[str, Any]) -> "Checkpointed":
        """The rows that an interrupted run of the same settings left behind, none for a new run.

        key  everything that the rows depend on, as plain values: options, device, precision, ...
        """
        text = json.dumps(key, sort_keys=True)
        return cls(partial_file(folder, name), sha256(text.encode()).hexdigest())

    @property
    def rows(self) -> dict[str, Any]:
        """The rows known so far."""
        return {key: line["row"] for key, line in self._lines.items()}

    def row(self, key: str, make: Callable[[], Any]) -> Any:
        """The row of that key: the stored one, or what `make` returns, stored."""
        if key not in self._lines:
            self.store(key, make())
        return self._lines[key]["row"]

    def store(self, key: str, row: Any) -> None:
        """Keeps a row, a plain value, in memory and on the disk."""
        self._lines[key] = {"key": key, "row": row, "commit": commit()}
        if self._continues:
            with one_line_writing(self.path), self.path.open("ab") as file:
                file.write(_as_text([self._lines[key]]))
        else:  # without what was left of other settings, or half written
            with replaced_file(self.path) as part:
                part.write(_as_text([{"fingerprint": self.fingerprint}, *self._lines.values()]))
            self._continues = True


def partial_file(folder: Path, name: str) -> Path:
    """Where the rows of an unfinished problem are."""
    return folder / f"{name}.partial.jsonl"


def commits_of(folder: Path, name: str) -> list[str | None]:
    """The commits at which the rows of an unfinished problem were made, none where nothing was stored."""
    return list(dict.fromkeys(line["commit"] for line in _whole_lines(partial_file(folder, name))[1:]))


def _whole_lines(path: Path) -> list[dict[str, Any]]:
    """The lines of a JSON lines file up to the first that a killed process left half written."""
    lines: list[dict[str, Any]] = []
    if not path.is_file():
        return lines
    for text in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            lines.append(json.loads(text))
        except json.JSONDecodeError:
            break
    return lines


def _lines_of(path: Path, fingerprint: str) -> dict[str, dict[str, Any]]:
    """The lines of the rows by key; none when the file is of other settings."""
    first, *rows = _whole_lines(path) or [{}]
    return {line["key"]: line for line in rows} if first.get("fingerprint") == fingerprint else {}


def _as_text(lines: Iterable[Mapping[str, Any]]) -> bytes:
    return "".join(json.dumps(line) + "\n" for line in lines).encode()
