"""Parameters that stay the same through a run."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from torch import Tensor

from pcnclaws.tensors.tensor_types import Parameters


@runtime_checkable
class _WithKernelRows(Protocol):
    """A law, as far as its parameters know it."""

    def kernel_rows(self, parameters: Parameters) -> Tensor: ...


class FixedParameters(dict[str, Tensor]):
    """Parameters that stay the same from step to step: what the kernels read of them is made once.

    Rates of forward mode are kept with them, so that such an object must not outlive the level of forward mode that it
    was made in.
    one_graph  the same where they are differentiated in reverse mode: all steps then belong to one backward pass
    """

    def __init__(self, parameters: Parameters, one_graph: bool = False) -> None:
        super().__init__(parameters)
        self._one_graph = one_graph
        self._rows: dict[_WithKernelRows, Tensor] = {}

    @classmethod
    def of_rows(cls, rows: Mapping[_WithKernelRows, Tensor]) -> "FixedParameters":
        """Parameters of which nothing but Law.kernel_rows is known, for laws that have kernels."""
        parameters = cls({}, one_graph=True)
        parameters._rows = dict(rows)
        return parameters

    def rows_of(self, law: _WithKernelRows) -> Tensor | None:
        """Law.kernel_rows, or None where the parameters are differentiated in backward passes of several graphs."""
        if not self._one_graph and any(value.requires_grad for value in self.values()):
            return None
        if law not in self._rows:
            self._rows[law] = law.kernel_rows(self)
        return self._rows[law]
