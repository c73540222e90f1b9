"""The C++ of a function of physical parameters, made from its function in PyTorch: what a law's kernel reads of them.

The function is traced once by PyTorch. Its tensors become tensors of numbers of a table of C++ expressions: what moves
entries about is done by PyTorch on these, arithmetic writes a statement for each entry.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.fx import Interpreter, Node
from torch.fx.experimental.proxy_tensor import make_fx

from pcnclaws.compiled.symbols import Untraceable

ROWS = Callable[[Mapping[str, Tensor]], Tensor]

# What PyTorch calls operations, and the C++ of one entry.
TEMPLATES = {
    "add": "{0} + {1}",
    "sub": "{0} - {1}",
    "rsub": "{1} - {0}",
    "mul": "{0} * {1}",
    "div": "{0} / {1}",
    "pow": "std::pow({0}, {1})",
    "neg": "-{0}",
    "reciprocal": "1.0 / {0}",
    "square": "{0} * {0}",
    "abs": "std::fabs({0})",
    "softplus": "(std::max({0}, 0.0) + std::log1p(std::exp(-std::fabs({0}))))",
    "sigmoid": "1.0 / (1.0 + std::exp(-{0}))",
    "rsqrt": "1.0 / std::sqrt({0})",
    "gelu": "0.5 * {0} * std::erfc(-0.7071067811865476 * {0})",
    "maximum": "std::max({0}, {1})",
    "minimum": "std::min({0}, {1})",
    "clamp_min": "std::max({0}, {1})",
    "clamp_max": "std::min({0}, {1})",
    "gt": "double({0} > {1})",
    "ge": "double({0} >= {1})",
    "lt": "double({0} < {1})",
    "le": "double({0} <= {1})",
    "where": "{0} != 0.0 ? {1} : {2}",
    **{
        name: f"std::{name}({{0}})"
        for name in (
            *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"),
            *("exp", "expm1", "log", "log1p", "log2", "log10", "sqrt", "erf"),
        )
    },
}
FILLED = {"ones_like": 1.0, "zeros_like": 0.0, "ones": 1.0, "zeros": 0.0}
# Operations that move entries about, whatever these are.
MOVING = (
    *("view", "_unsafe_view", "reshape", "expand", "slice", "select", "unsqueeze", "squeeze", "t", "transpose"),
    *("permute", "cat", "stack", "unbind", "split", "clone", "alias", "detach", "index", "index_select", "movedim"),
)
COUNTED = ("linspace", "arange")
# Extremes along a dimension, and what they are of two entries.
EXTREMES = {"amin": "minimum", "amax": "maximum"}
KEPT = ("_to_copy", "lift_fresh_copy", "contiguous", "copy")


def coefficient_source(function: ROWS, parameters: Mapping[str, str]) -> tuple[str, list[str]]:
    """Statements of C++, and the expressions of the rows that they give.

    function    physical parameters by name, each (1,), to rows (rows, 1): in PyTorch, without looking at their numbers
    parameters  name to what C++ calls it
    raises      Untraceable for what C++ is not made of here
    """
    given = [torch.full((1,), 0.25, dtype=torch.float64) for _ in parameters]
    try:
        graph = make_fx(lambda *values: function(dict(zip(parameters, values, strict=True))))(*given)
    except RuntimeError as fault:
        reason = " ".join(str(fault).split())[:200]
        raise Untraceable(f"its coefficients look at numbers, which a header has none of yet ({reason})") from fault
    writer = _Writer(graph)
    ids = [writer.expression(text) for text in parameters.values()]
    places = writer.run(*(torch.full((1,), one) for one in ids))
    rows = [writer.expressions[int(one)] for one in places[:, 0]]
    return "".join(_used(writer.statements, rows)), rows


def _used(statements: dict[str, str], results: Sequence[str]) -> list[str]:
    """The statements, name to expression, that the results depend on."""
    wanted, kept = set(results), []
    for name, text in reversed(statements.items()):
        if name in wanted:
            wanted.update(re.findall(r"\bc\d+\b", text))
            kept.append(f"    const double {name} = {text};\n")
    return kept[::-1]


class _Writer(Interpreter):
    """Runs the graph on tensors of places in the table of expressions."""

    def __init__(self, graph: Any) -> None:
        super().__init__(graph)
        self.expressions: list[str] = []
        self.statements: dict[str, str] = {}
        self._places: dict[str, int] = {}

    def expression(self, text: str) -> int:
        """The place of an expression."""
        if text not in self._places:
            self._places[text] = len(self.expressions)
            self.expressions.append(text)
        return self._places[text]

    def run_node(self, n: Node) -> Any:
        if n.op == "get_attr":
            return self._constants(super().run_node(n))
        if n.op != "call_function":
            return super().run_node(n)
        name = str(getattr(n.target, "overloadpacket", n.target)).removeprefix("aten.")
        args, kwargs = self.fetch_args_kwargs_from_env(n)
        return self._done(name, n.target, list(args), dict(kwargs))

    def _done(self, name: str, target: Any, args: list[Any], kwargs: dict[str, Any]) -> Any:
        if name in MOVING or "getitem" in name:
            return target(*args, **kwargs)
        if name in KEPT:
            return args[0]
        if name in COUNTED:
            return self._constants(target(*args, **kwargs))
        if name in FILLED or name.startswith(("full", "new_full")):
            value = FILLED[name] if name in FILLED else args[1] if name != "new_full" else args[2]
            shape = args[0].shape if isinstance(args[0], Tensor) and name != "new_full" else args[name == "new_full"]
            return torch.full(tuple(shape), self._place(value))
        if name == "clamp":
            ends = [*args[1:], *([None] * (3 - len(args)))]
            low = args[0] if ends[0] is None else self._entries("clamp_min", [args[0], ends[0]])
            return low if ends[1] is None else self._entries("clamp_max", [low, ends[1]])
        if name in ("add", "sub") and kwargs.get("alpha", 1) != 1:
            args[1] = self._entries("mul", [args[1], kwargs["alpha"]])
        if name in ("mm", "addmm"):
            product = self._product(args[-2], args[-1])
            return product if name == "mm" else self._entries("add", [args[0], product])
        if name == "bmm":
            return torch.stack([self._product(a, b) for a, b in zip(args[0], args[1], strict=True)])
        if name in EXTREMES and len(args) > 1 and len(args[1]) == 1:
            return self._extreme(EXTREMES[name], args[0], int(args[1][0]), keep=len(args) > 2 and bool(args[2]))
        if name not in TEMPLATES or kwargs.get("approximate", "none") != "none" or kwargs.get("rounding_mode"):
            raise Untraceable(f"its coefficients use '{name}' of PyTorch, which no header is made of")
        return self._entries(name, args[: 1 + max(k for k in range(3) if f"{{{k}}}" in TEMPLATES[name])])

    def _entries(self, name: str, args: Sequence[Any]) -> Tensor:
        """A statement for each entry of the result."""
        places = torch.broadcast_tensors(
            *(one if isinstance(one, Tensor) else torch.tensor(self._place(one)) for one in args)
        )
        flat = [[self.expressions[int(place)] for place in one.reshape(-1)] for one in places]
        found = [self._statement(TEMPLATES[name].format(*entry)) for entry in zip(*flat, strict=True)]
        return torch.tensor(found, dtype=torch.long).reshape(places[0].shape)

    def _extreme(self, of_two: str, values: Tensor, dimension: int, keep: bool) -> Tensor:
        """The least or largest entry along a dimension."""
        found, *others = values.unbind(dimension)
        for one in others:
            found = self._entries(of_two, [found, one])
        return found.unsqueeze(dimension) if keep else found

    def _product(self, a: Tensor, b: Tensor) -> Tensor:
        named = [[[self.expressions[place] for place in row] for row in matrix.tolist()] for matrix in (a, b.T)]
        terms = [
            [" + ".join(f"{x} * {y}" for x, y in zip(row, column, strict=True)) for column in named[1]]
            for row in named[0]
        ]
        return torch.tensor([[self._statement(text) for text in row] for row in terms], dtype=torch.long)

    def _statement(self, text: str) -> int:
        if text in self._places:
            return self._places[text]
        name = f"c{len(self.expressions)}"
        self.statements[name] = text
        self._places[text] = place = self.expression(name)
        return place

    def _place(self, number: Any) -> int:
        text = repr(float(number))
        return self.expression(f"({text})" if text.startswith("-") else text)

    def _constants(self, values: Any) -> Tensor:
        places = [self._place(value) for value in values.detach().double().reshape(-1).tolist()]
        return torch.tensor(places, dtype=torch.long).reshape(values.shape)
