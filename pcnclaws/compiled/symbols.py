"""Traced formulas: numbers that write down what is done with them, for kernels that are made from Python functions.

A function of numbers is called once with symbols. What it returns is a graph of operations, each of them once.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

Number: TypeAlias = "Symbol | float | int"

ELEMENTARY = ("negative", "exp", "log", "sqrt", "tanh", "softplus")  # with one argument
ARITHMETIC = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
COMPARISONS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


class Untraceable(TypeError):
    """A function that cannot become a kernel: it does something else than arithmetic with its numbers."""


class Branches(Untraceable):
    """A function that decides by a number, of which each particle has its own."""


class Symbol:
    """A number of a traced function: an input, a constant, or the result of an operation on others.

    name   of the operation, 'input' or 'constant'
    args   symbols and conditions that it is made of
    value  of a constant; for an input, the array that it stands in and its place
    """

    __slots__ = ("args", "name", "trace", "value")
    __array_priority__ = 1000  # NumPy leaves the arithmetic to this class

    def __init__(self, trace: "Trace", name: str, args: tuple[Any, ...], value: Any) -> None:
        self.trace, self.name, self.args, self.value = trace, name, args, value

    def __add__(self, other: Number) -> "Symbol":
        return self.trace.make("add", self, other)

    def __radd__(self, other: Number) -> "Symbol":
        return self.trace.make("add", other, self)

    def __sub__(self, other: Number) -> "Symbol":
        return self.trace.make("sub", self, other)

    def __rsub__(self, other: Number) -> "Symbol":
        return self.trace.make("sub", other, self)

    def __mul__(self, other: Number) -> "Symbol":
        return self.trace.make("mul", self, other)

    def __rmul__(self, other: Number) -> "Symbol":
        return self.trace.make("mul", other, self)

    def __truediv__(self, other: Number) -> "Symbol":
        return self.trace.make("div", self, other)

    def __rtruediv__(self, other: Number) -> "Symbol":
        return self.trace.make("div", other, self)

    def __neg__(self) -> "Symbol":
        return self.trace.make("negative", self)

    def __abs__(self) -> "Symbol":
        return self.trace.choose(self >= 0.0, self, -self)

    def __pow__(self, exponent: Number) -> "Symbol":
        if isinstance(exponent, (int, float)) and float(exponent).is_integer() and 1 <= exponent <= 8:
            half = self ** (int(exponent) // 2) if exponent > 1 else self
            square = half * half if exponent > 1 else self
            return square * self if exponent > 1 and int(exponent) % 2 else square
        return self.trace.make("exp", self.trace.make("log", self) * exponent)

    def __rpow__(self, base: float) -> "Symbol":
        return self.trace.make("exp", self * math.log(base))

    def __gt__(self, other: Number) -> "Condition":
        return self.trace.compare("gt", self, other)

    def __ge__(self, other: Number) -> "Condition":
        return self.trace.compare("ge", self, other)

    def __lt__(self, other: Number) -> "Condition":
        return self.trace.compare("lt", self, other)

    def __le__(self, other: Number) -> "Condition":
        return self.trace.compare("le", self, other)

    def __bool__(self) -> bool:
        raise Branches("it branches on a number; accepted: where(condition, yes, no)")

    def __float__(self) -> float:
        raise Untraceable("it turns a number of its own into a Python float")

    def __getattr__(self, name: str) -> object:
        raise Untraceable(
            f"it uses '.{name}' of a number; accepted: + - * / **, comparisons and pcnclaws.laws.operations"
        )


class Condition:
    """Whether something holds of the numbers of a traced function."""

    __slots__ = ("args", "name", "trace")

    def __init__(self, trace: "Trace", name: str, args: tuple[Any, ...]) -> None:
        self.trace, self.name, self.args = trace, name, args

    def __and__(self, other: "Condition") -> "Condition":
        return self.trace.condition("and", self, other)

    def __or__(self, other: "Condition") -> "Condition":
        return self.trace.condition("or", self, other)

    def __invert__(self) -> "Condition":
        return self.trace.condition("not", self)

    def __bool__(self) -> bool:
        raise Branches("it branches on a number; accepted: where(condition, yes, no)")


class Trace:
    """The operations of one function, each kept once."""

    def __init__(self) -> None:
        self._symbols: dict[tuple[object, ...], Symbol] = {}
        self._conditions: dict[tuple[object, ...], Condition] = {}

    def inputs(self, array: str, count: int) -> list[Symbol]:
        """The elements of an input array."""
        return [self._symbol("input", (), (array, k)) for k in range(count)]

    def constant(self, value: float | int) -> Symbol:
        """A number that is the same for all particles."""
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise Untraceable(f"it uses {value!r} as a number; accepted: finite Python numbers")
        return self._symbol("constant", (), float(value))

    def make(self, name: str, *operands: Number) -> Symbol:
        """The result of an operation."""
        args = tuple(self.as_symbol(operand) for operand in operands)
        if all(arg.name == "constant" for arg in args):
            return self.constant(_computed(name, [arg.value for arg in args]))
        return self._symbol(name, args, None)

    def choose(self, condition: Condition, yes: Number, no: Number) -> Symbol:
        """`yes` where the condition holds, `no` elsewhere."""
        if not isinstance(condition, Condition):
            raise Untraceable(f"where() got {condition!r}; accepted: a comparison of numbers")
        chosen, other = self.as_symbol(yes), self.as_symbol(no)
        return chosen if chosen is other else self._symbol("where", (condition, chosen, other), None)

    def compare(self, name: str, a: Number, b: Number) -> Condition:
        """Whether a comparison holds."""
        return self.condition(name, self.as_symbol(a), self.as_symbol(b))

    def condition(self, name: str, *args: Symbol | Condition) -> Condition:
        """A condition of others, or of numbers."""
        key = (name, *map(id, args))
        if key not in self._conditions:
            self._conditions[key] = Condition(self, name, args)
        return self._conditions[key]

    def as_symbol(self, value: Number) -> Symbol:
        """A symbol of this trace, for a number of the function or a constant."""
        return value if isinstance(value, Symbol) else self.constant(value)

    def _symbol(self, name: str, args: tuple[Any, ...], value: Any) -> Symbol:
        key = (name, value, *map(id, args))
        if key not in self._symbols:
            self._symbols[key] = Symbol(self, name, args, value)
        return self._symbols[key]


def derivative(of: Symbol, by: Symbol) -> Symbol | float:
    """The derivative of a symbol with respect to one that it is made of, as a formula; 0.0 where there is none."""
    known: dict[int, Symbol | float] = {id(by): 1.0}

    def slope(symbol: Symbol) -> Symbol | float:
        if id(symbol) not in known:
            known[id(symbol)] = _slope(symbol, slope)
        return known[id(symbol)]

    return slope(of)


def _slope(symbol: Symbol, slope: Callable[[Symbol], Symbol | float]) -> Symbol | float:
    if symbol.name == "where":
        condition, yes, no = symbol.args
        a, b = slope(yes), slope(no)
        return a if a is b or (isinstance(a, float) and a == b) else symbol.trace.choose(condition, a, b)
    args = [arg for arg in symbol.args if isinstance(arg, Symbol)]
    slopes = [slope(arg) for arg in args]
    if all(isinstance(s, float) and s == 0.0 for s in slopes):
        return 0.0
    if symbol.name in ("add", "sub"):
        return _sum(slopes[0], slopes[1] if symbol.name == "add" else _times(-1.0, slopes[1]))
    if symbol.name == "mul":
        return _sum(_times(slopes[0], args[1]), _times(args[0], slopes[1]))
    if symbol.name == "div":
        return _over(_sum(slopes[0], _times(-1.0, _times(symbol, slopes[1]))), args[1])
    argument, inner = args[0], slopes[0]
    match symbol.name:
        case "negative":
            return _times(-1.0, inner)
        case "exp":
            return _times(symbol, inner)
        case "log":
            return _over(inner, argument)
        case "sqrt":
            return _over(_times(0.5, inner), symbol)
        case "tanh":
            return _times(1.0 - symbol * symbol, inner)
        case _:  # softplus
            return _over(inner, 1.0 + symbol.trace.make("exp", -argument))


def _sum(a: Symbol | float, b: Symbol | float) -> Symbol | float:
    if isinstance(a, float) and a == 0.0:
        return b
    return a if isinstance(b, float) and b == 0.0 else a + b


def _times(a: Symbol | float, b: Symbol | float) -> Symbol | float:
    if isinstance(a, float) and a in (0.0, 1.0):
        return b if a else 0.0
    if isinstance(b, float) and b in (0.0, 1.0):
        return a if b else 0.0
    return a * b


def _over(a: Symbol | float, b: Symbol) -> Symbol | float:
    return 0.0 if isinstance(a, float) and a == 0.0 else a / b


def _computed(name: str, values: Sequence[float]) -> float:
    """An operation on plain numbers."""
    if name in ARITHMETIC:
        a, b = values
        return {"add": a + b, "sub": a - b, "mul": a * b}.get(name, 0.0) if name != "div" else a / b
    (a,) = values
    if name == "negative":
        return -a
    if name == "softplus":
        return max(a, 0.0) + math.log1p(math.exp(-abs(a)))
    return float(getattr(math, name)(a))
