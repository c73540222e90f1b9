"""Operations that a law's formulas may use, on tensors and on the numbers of a kernel alike.

Beside them + - * / **, comparisons, and & | ~ of comparisons. Of three principal values h there are trace, deviator,
sum_of_squares and norm.
"""

from collections.abc import Sequence
from typing import Any, TypeVar

import torch
from torch import Tensor
from torch.nn import functional

from pcnclaws.compiled.symbols import Condition, Number, Symbol

# A tensor, a number of a kernel, or a Python number.
N = TypeVar("N", bound=Any)


def exp(x: N) -> N:
    """e^x."""
    return _elementary("exp", x)


def log(x: N) -> N:
    """Natural logarithm."""
    return _elementary("log", x)


def sqrt(x: N) -> N:
    """Square root; its derivative at 0 is infinite, see safe_sqrt."""
    return _elementary("sqrt", x)


def tanh(x: N) -> N:
    """Hyperbolic tangent."""
    return _elementary("tanh", x)


def softplus(x: Any) -> Any:
    """log(1 + e^x)."""
    return x.trace.make("softplus", x) if isinstance(x, Symbol) else functional.softplus(x, threshold=700.0)


def where(condition: Any, yes: Any, no: Any) -> Any:
    """`yes` where the condition holds, `no` elsewhere. What is not chosen has no influence, on no derivative either,
    as long as it is finite."""
    if isinstance(condition, Condition):
        return condition.trace.choose(condition, yes, no)
    return torch.where(condition, yes, no)


def maximum(a: Any, b: Any) -> Any:
    """The larger of two numbers, the first where they are equal."""
    return where(a >= b, a, b)


def minimum(a: Any, b: Any) -> Any:
    """The smaller of two numbers, the first where they are equal."""
    return where(a <= b, a, b)


def positive_part(x: N) -> N:
    """max(x, 0)."""
    return where(x > 0.0, x, 0.0 * x if isinstance(x, Tensor) else 0.0)


def safe_sqrt(x: N) -> N:
    """Square root with the derivative 0 (a subgradient) where x is 0."""
    return where(x > 0.0, sqrt(where(x > 0.0, x, 1.0)), 0.0)


def trace(h: Sequence[N]) -> N:
    """h_1 + h_2 + h_3."""
    return h[0] + h[1] + h[2]


def deviator(h: Sequence[N]) -> list[N]:
    """h less a third of its trace."""
    mean = trace(h) / 3.0
    return [value - mean for value in h]


def sum_of_squares(h: Sequence[N]) -> N:
    """h_1^2 + h_2^2 + h_3^2."""
    return h[0] * h[0] + h[1] * h[1] + h[2] * h[2]


def norm(h: Sequence[N]) -> N:
    """Root of the sum of squares, with the derivative 0 where it is 0."""
    return safe_sqrt(sum_of_squares(h))


def _elementary(name: str, x: Any) -> Any:
    return x.trace.make(name, x) if isinstance(x, Symbol) else getattr(torch, name)(x)


__all__ = [
    "Number",
    "deviator",
    "exp",
    "log",
    "maximum",
    "minimum",
    "norm",
    "positive_part",
    "safe_sqrt",
    "softplus",
    "sqrt",
    "sum_of_squares",
    "tanh",
    "trace",
    "where",
]
