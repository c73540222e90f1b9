"""What guards did in this process: counts of what a run survives, or ends with, and readers should know.

Guards count where they act; commands write the counts into their JSON files, and say in one line what nobody said.
"""

from collections import Counter
from collections.abc import Callable

# What is counted, in words.
WORDS = {
    "principal_axes_by_the_slow_path": "particles far from det F = 1 whose principal axes took the slow path",
    "law_evaluations_in_pytorch": "evaluations of a law in PyTorch for want of a kernel",
    "parameters_outside_training_data": "parameters outside the training data of a law",
    "particles_that_failed": "particles that turned inside out, left the domain or were not finite",
    "scenes_that_diverged": "scenes that diverged",
    "iterations_without_gradient": "iterations without a finite gradient",
}

# Those that say nothing where they act.
SILENT = ("principal_axes_by_the_slow_path", "law_evaluations_in_pytorch")

_counted: Counter[str] = Counter()
_sources: dict[str, Callable[[], int]] = {}
_before: dict[str, int] = {}


def count(kind: str, times: int = 1) -> None:
    """Adds to one of WORDS."""
    if kind not in WORDS:
        raise ValueError(f"{kind} is no guard")
    _counted[kind] += times


def counts_elsewhere(kind: str, total: Callable[[], int]) -> None:
    """Names who knows a count of this process: kernels count for themselves."""
    _sources[kind] = total


def restart() -> None:
    """Begins anew, as each job of a sweep does."""
    _before.update(_totals())


def counts() -> dict[str, int]:
    """How often each guard acted since `restart`, every one of WORDS."""
    return {kind: total - _before.get(kind, 0) for kind, total in _totals().items()}


def in_words() -> str:
    """One line of what nobody said, empty where nothing was."""
    found = counts()
    return ", ".join(f"{found[kind]} {WORDS[kind]}" for kind in SILENT if found[kind])


def _totals() -> dict[str, int]:
    return {kind: _sources[kind]() if kind in _sources else _counted[kind] for kind in WORDS}
