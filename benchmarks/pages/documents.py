"""The JSON files that the page of results is made of.

<folder>/<material>/<row>/<task>.json    metrics of `python -m pcnclaws.evaluate`, a row being one law
<folder>/<material>/<row>/training.json  metrics.json of the law's run folder, if it was trained
<folder>/<material>/<row>/<task>_*.png   pictures of that evaluation
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from pcnclaws.errors import UserError

TASKS = ("reconstruction", "long_term", "geometry", "unseen", "unseen_motion", "resolution", "outside_range")
TRAINING = "training"

Document: TypeAlias = Mapping[str, Any]


class Row(NamedTuple):
    """One law: its folder, the metrics of its evaluations by task, and those of its training."""

    folder: Path
    tasks: Mapping[str, Document]
    training: Document | None

    def picture(self, task: str, kind: str) -> Path | None:
        """The picture that evaluate left of a task: kind 'sheet' or 'map'; None where there is none."""
        path = self.folder / f"{task}_{kind}.png"
        return path if path.is_file() else None


# Material -> row -> law.
Results: TypeAlias = Mapping[str, Mapping[str, Row]]


def read_results(folder: Path) -> Results:
    """All results in the folder; UserError for a folder without any, or a file that is none."""
    found: dict[str, dict[str, Row]] = {}
    for place in sorted({path.parent for path in folder.glob("*/*/*.json")}):
        documents = {path.stem: read_document(path) for path in sorted(place.glob("*.json"))}
        training = documents.pop(TRAINING, None)
        found.setdefault(place.parent.name, {})[place.name] = Row(place, documents, training)
    if not any(row.tasks for rows in found.values() for row in rows.values()):
        raise UserError(f"{folder}: holds no results; accepted: a folder of <material>/<row>/<task>.json")
    return found


def tasks_of(rows: Mapping[str, Row]) -> list[str]:
    """The tasks that some row has, in the order of the page."""
    return [task for task in TASKS if any(task in row.tasks for row in rows.values())]


def read_document(path: Path, holds: str = "mse", command: str = "evaluate") -> Document:
    """A JSON file of a command; UserError for one that cannot be read, or does not hold what it should."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise UserError(f"{path}: not readable ({fault}); accepted: the output of {command}") from fault
    if not isinstance(document, dict) or holds not in document:
        raise UserError(f"{path}: holds no {holds}; accepted: the output of {command}")
    return document
