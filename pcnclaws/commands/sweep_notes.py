"""Notes of the jobs of a sweep that run in other processes: what became of each, in a folder that all of them see."""

import json
import os
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

from pcnclaws.atomic import replaced_file
from pcnclaws.commands.sweeps import Job
from pcnclaws.errors import UserError

NOTE, CLAIM = "job_*.json", "output_{}.claim"
FAILED = 1
NOT_FINISHED = "has not finished: its process was killed, or is still at it"


class SweepNotes:
    """The notes in the folder of a sweep."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def begin(self, number: int, overrides: list[str]) -> None:
        """Notes that a job has begun: it is this note that is left of one whose process is killed."""
        self.end(number, Job(overrides, FAILED, "", {}, NOT_FINISHED))

    def end(self, number: int, job: Job) -> None:
        """Notes what became of a job."""
        with replaced_file(self.folder / NOTE.replace("*", f"{number:06d}")) as part:
            part.write(json.dumps(job._asdict()).encode())

    def claim(self, output: str, number: int) -> None:
        """Keeps an output for a job; UserError where another job of the sweep has it."""
        name = sha256(os.path.realpath(output).encode()).hexdigest()[:32]
        path = self.folder / CLAIM.format(name)
        try:
            with path.open("x") as file:
                file.write(str(number))
        except FileExistsError:
            if path.read_text() != str(number):  # a job that goes on has its own
                raise shared_output(output) from None

    def jobs(self) -> Iterator[Job]:
        """The jobs that have begun, in their order."""
        for path in sorted(self.folder.glob(NOTE)):
            yield Job(**json.loads(path.read_text(encoding="utf-8")))


def shared_output(output: str) -> UserError:
    """The error for two jobs of a sweep with one output."""
    return UserError(f"output={output} is shared with another job; accepted: one output for each job")
