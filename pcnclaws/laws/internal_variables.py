"""Internal variables: what a law remembers of each particle, such as the plastic strain that has hardened it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from pcnclaws.tensors.tensor_types import InternalValues


@dataclass(frozen=True)
class InternalVariable:
    """A number that laws keep for each particle from step to step.

    name   as formulas read it: p.<name>
    start  its value in a body that has not been deformed
    unit   [-] unless it is given
    """

    name: str
    start: float = 0.0
    unit: str = "-"


def variables_of(laws: Iterable[Any]) -> tuple[InternalVariable, ...]:
    """The internal variables of some laws, or of their classes, each once: the rows of ParticleState.internal."""
    return tuple(dict.fromkeys(variable for law in laws if law is not None for variable in law.internal_variables))


def start_values(variables: Sequence[InternalVariable], like: Tensor) -> InternalValues:
    """The internal variables of an undeformed body, (variables, particles), for fields like (..., particles)."""
    starts = like.new_tensor([variable.start for variable in variables]).reshape(-1, 1)
    return starts.expand(-1, like.shape[-1]).contiguous()
