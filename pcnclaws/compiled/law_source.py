"""The C++ of a law, made from its Python function: the structure that source/law_block.hpp is compiled with.

Whatever depends on one number alone becomes one operation with its derivative, so that a kernel writes down and sweeps
back as little as possible.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pcnclaws.compiled.symbols import ARITHMETIC, COMPARISONS, Condition, Number, Symbol, Trace, Untraceable, derivative

# C++ names of the operations with one argument, on values.
FUNCTIONS = {"exp": "exponential", "log": "logarithm", "sqrt": "square_root", "tanh": "tangent", "softplus": "softplus"}
Features = Callable[[Sequence[Symbol]], Sequence[Number]]
Response = Callable[[Sequence[Symbol], Sequence[Symbol], Sequence[Symbol], Sequence[Symbol]], Sequence[Number]]


@dataclass(frozen=True)
class LawKernel:
    """A law as its kernel is compiled.

    name         for messages and file names
    text         C++: the sizes of the law, and `struct Law`
    rows         of per-particle parameters that it reads
    layers       of its network
    internal     internal variables that it reads
    after        internal variables that it gives back
    """

    name: str
    text: str
    rows: int
    layers: int
    internal: int = 0
    after: int = 0


@dataclass(frozen=True)
class LawShape:
    """What a law is beside its formulas: whether it returns strains, and how many numbers its formulas take.

    returns_strain  the response is the principal strain after plastic flow, else a principal stress
    parameters      that the response reads
    internal        internal variables that the response reads, and gives back where it returns strains
    features        of its network, 0 without one
    outputs         of its network
    conditions      further inputs of its network
    layers          of its network, hidden ones and the last one
    """

    returns_strain: bool
    parameters: int
    internal: int = 0
    features: int = 0
    outputs: int = 0
    conditions: int = 0
    layers: int = 3


def law_kernel(name: str, shape: LawShape, features: Features | None, response: Response) -> LawKernel:
    """The kernel of a law from its functions of three principal Hencky strains.

    features  strains to features, None without a network
    response  strains, features, parameters and then internal variables, and outputs of the network to three principal
              values, and then internal variables
    raises    Untraceable for functions that do more than arithmetic
    """
    of_features = _Writer()
    if features is not None:
        found = features(of_features.trace.inputs("h", 3))
        of_features.write("x", _numbers(found, shape.features, "features"))
    of_response = _Writer()
    inputs = [
        of_response.trace.inputs(*a)
        for a in (("h", 3), ("x", shape.features), ("p", shape.parameters), ("q", shape.internal), ("f", shape.outputs))
    ]
    strains, x, p, q, f = inputs
    after = shape.internal if shape.returns_strain else 0
    values = _numbers(response(strains, x, [*p, *q], f), 3 + after, "values")
    if shape.returns_strain:
        changes = [_change(of_response.trace.as_symbol(value), h) for value, h in zip(values, strains, strict=False)]
        values = [*changes, *values[3:]]
    of_response.write("y", values)
    operations = max(sum(map(len, inputs)) + of_response.operations, 3 + of_features.operations)
    text = f"""// Made from the Python function of '{name}'.
#pragma once
#define LAW_LAYERS {shape.layers}
#define LAW_ROWS {shape.parameters + shape.conditions}
#define LAW_INTERNAL {shape.internal}
#define LAW_OPERATIONS {operations}
#include "functions.hpp"

namespace pcnclaws {{

struct Law {{
    static constexpr bool RETURN_MAP = {str(shape.returns_strain).lower()};
    static constexpr int PARAMETERS = {shape.parameters}, FEATURES = {shape.features}, OUTPUTS = {shape.outputs};
    template <class S> static void features(const S* h, S* x) {{
{of_features.text}    }}
    template <class S> static void respond(const S* h, const S* x, const S* p, const S* f, const S* q, S* y) {{
{of_response.text}    }}
}};

}}  // namespace pcnclaws
"""
    return LawKernel(name, text, shape.parameters + shape.conditions, shape.layers, shape.internal, after)


def _numbers(values: Sequence[Number], count: int, what: str) -> list[Number]:
    found = list(values)
    if len(found) != count:
        raise Untraceable(f"it returns {len(found)} {what}; accepted: {count}")
    return found


def _change(after: Symbol, before: Symbol) -> Number:
    """after - before, exactly where the one is written as the other and something more."""
    if after is before:
        return 0.0
    if after.name == "where":
        condition, yes, no = after.args
        return after.trace.choose(condition, _change(yes, before), _change(no, before))
    if after.name == "constant" and after.value == 0.0:
        return -before
    if after.name == "sub" and after.args[0] is before:
        return -after.args[1]
    if after.name == "add" and any(arg is before for arg in after.args):
        a, b = after.args
        return b if a is before else a
    return after - before


class _Writer:
    """Writes the statements of one function, each operation once."""

    def __init__(self) -> None:
        self.trace, self.text, self.operations = Trace(), "", 0
        self._carriers: dict[int, str] = {}  # with derivatives
        self._values: dict[int, str] = {}
        self._conditions: dict[int, str] = {}
        self._roots: dict[int, Symbol | None] = {}

    def write(self, array: str, results: Sequence[Number]) -> None:
        """Statements that fill an array with the results."""
        for k, result in enumerate(results):
            self._line(f"{array}[{k}] = {self._carrier(self.trace.as_symbol(result))};")

    def _line(self, statement: str) -> None:
        self.text += f"        {statement}\n"

    def _root(self, symbol: Symbol) -> Symbol | None:
        """The one number that a symbol is a function of; itself where there are several; None for a constant."""
        if id(symbol) not in self._roots:
            below = {
                id(root): root
                for arg in symbol.args
                if isinstance(arg, Symbol)
                if (root := self._root(arg)) is not None
            }
            if symbol.name == "constant":
                self._roots[id(symbol)] = None
            else:
                self._roots[id(symbol)] = next(iter(below.values())) if len(below) == 1 else symbol
        return self._roots[id(symbol)]

    def _carrier(self, symbol: Symbol) -> str:
        """The C++ name of a symbol that carries derivatives."""
        if symbol.name == "input":
            array, place = symbol.value
            return f"{array}[{place}]"
        if id(symbol) not in self._carriers:
            text = self._carried(symbol)
            self.operations += 1
            name = f"s{len(self._carriers)}"
            self._line(f"const S {name} = {text};")
            self._carriers[id(symbol)] = name
        return self._carriers[id(symbol)]

    def _carried(self, symbol: Symbol) -> str:
        root = self._root(symbol)
        if root is None:
            return f"constant(splat({symbol.value!r}), h[0])"
        if root is not symbol:
            slope = derivative(symbol, root)
            return f"chain({self._carrier(root)}, {self._value(symbol)}, {self._splat(slope)})"
        if symbol.name == "where":
            condition, yes, no = symbol.args
            return f"select({self._condition(condition)}, {self._carrier(yes)}, {self._carrier(no)})"
        a, b = (self._carrier(arg) for arg in symbol.args)
        return f"{a} {ARITHMETIC[symbol.name]} {b}"

    def _splat(self, number: Number) -> str:
        """A value, or a constant as one."""
        symbol = self.trace.as_symbol(number)
        return f"splat({symbol.value!r})" if symbol.name == "constant" else self._value(symbol)

    def _value(self, symbol: Symbol) -> str:
        """The C++ name of a symbol's value, or the number of a constant."""
        if symbol.name == "constant":
            return f"{symbol.value!r}"
        if id(symbol) not in self._values:
            known = symbol.name == "input" or id(symbol) in self._carriers
            text = f"value_of({self._carrier(symbol)})" if known else self._computed(symbol)
            name = f"v{len(self._values)}"
            self._line(f"const V {name} = {text};")
            self._values[id(symbol)] = name
        return self._values[id(symbol)]

    def _computed(self, symbol: Symbol) -> str:
        if symbol.name == "where":
            condition, yes, no = symbol.args
            return f"select({self._condition(condition)}, {self._splat(yes)}, {self._splat(no)})"
        values = [self._value(arg) for arg in symbol.args]
        if symbol.name in ARITHMETIC:
            return f" {ARITHMETIC[symbol.name]} ".join(values)
        return f"-{values[0]}" if symbol.name == "negative" else f"{FUNCTIONS[symbol.name]}({values[0]})"

    def _condition(self, condition: Condition) -> str:
        """The C++ name of a condition."""
        if id(condition) not in self._conditions:
            if condition.name in COMPARISONS:
                a, b = (self._splat(arg) for arg in condition.args)
                text = f"{a} {COMPARISONS[condition.name]} {b}"
            else:
                parts = [self._condition(arg) for arg in condition.args]
                text = (
                    f"!{parts[0]}"
                    if condition.name == "not"
                    else {"and": " & ", "or": " | "}[condition.name].join(parts)
                )
            name = f"m{len(self._conditions)}"
            self._line(f"const Mask {name} = {text};")
            self._conditions[id(condition)] = name
        return self._conditions[id(condition)]
