"""Which implementation of the step runs: a choice for the whole process, like the number of threads."""

from collections.abc import Iterator
from contextlib import contextmanager

from pcnclaws.errors import unknown_name

BACKENDS = ("auto", "torch", "compiled")
_configured = "auto"


def configured_backend() -> str:
    """The choice that holds now, one of BACKENDS."""
    return _configured


def use_backend(name: str) -> None:
    """Chooses the implementation of the step.

    torch     the vectorised torch reference, on every device
    compiled  hand-written C++ kernels, on a GPU in steps that are recorded; a law that has none runs in torch
    auto      compiled where the kernels can be compiled, torch otherwise
    raises    UserError for another name
    """
    global _configured
    if name not in BACKENDS:
        raise unknown_name("simulation.backend", name, BACKENDS)
    _configured = name


@contextmanager
def using_backend(name: str) -> Iterator[None]:
    """The choice for the length of a `with` block."""
    before = _configured
    use_backend(name)
    try:
        yield
    finally:
        use_backend(before)
