"""What the formulas of a law are made of: three principal values, and what they read by name."""

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import torch

from pcnclaws.compiled.symbols import Symbol, derivative
from pcnclaws.errors import unknown_name

# Three principal values: tensors (particles,) in PyTorch, numbers of a kernel when it is made.
Values = Sequence[Any]
# What laws that flow with time read as a parameter [s].
TIME_STEP = "time_step"


class Known(SimpleNamespace):
    """What formulas read as p.<name>."""

    def __init__(self, law: str, values: Mapping[str, Any]) -> None:
        super().__init__(**values)
        self.__dict__["_law"] = law

    def __getattr__(self, name: str) -> Any:
        known = [one for one in vars(self) if one != "_law"]
        raise unknown_name(f"the law {vars(self).get('_law')}: p", name, known)


def gradient(function: Callable[[Values], Any], h: Values) -> Values:
    """The derivatives of a function of three numbers: as a formula, or of tensors (particles,)."""
    if isinstance(h[0], Symbol):
        value = function(h)
        return [derivative(value, strain) if isinstance(value, Symbol) else 0.0 for strain in h]
    strains = torch.stack(list(h))
    value, pull = torch.func.vjp(lambda s: function(s.unbind(0)), strains)[:2]
    return pull(torch.ones_like(value))[0].unbind(0)
