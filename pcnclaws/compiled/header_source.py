"""One self-contained C++17 header of a law: our own kernels for one particle, with the law and its weights in it."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np

from pcnclaws.compiled.build import SOURCES
from pcnclaws.compiled.law_source import LawKernel

PORTABLE = Path(__file__).parent / "portable"
# Of a GPU's threads, which have one particle each.
DEFINED, UNDEFINED = ("ONE_LANE",), ("__CUDACC_RTC__",)
# What all laws share, and what is written for each of them.
SHARED = ("one_lane.hpp", "lanes.hpp", "tape.hpp", "functions.hpp", "graded_axes.hpp", "spectral.hpp")
OF_LAW = ("law_input.hpp", "law_block.hpp", "plain_network.hpp", "law_point.hpp")
# Written by hand, or left to others.
REPLACED = ("fallbacks.hpp", "law.hpp")
# Extensions of compilers that say where speed is won.
HINTS = (("CALLS_SLOW_PATH ", "inline "), ("SLOW_PATH ", ""), ("IN_ONE_FUNCTION ", ""))
NUMBERS_A_LINE = 8


@dataclass(frozen=True)
class HeaderLaw:
    """An elastic or a plastic law as the header has it.

    kernel        its formulas
    coefficients  statements, and the expressions of the rows, of its function of parameters (coefficient_source)
    weights       matrices (to, from) and biases (to,) of the layers, in turn
    variables     places of its internal variables among those of the model
    """

    kernel: LawKernel
    coefficients: tuple[str, Sequence[str]]
    weights: Sequence[tuple[np.ndarray, np.ndarray]]
    variables: Sequence[int]


@dataclass(frozen=True)
class HeaderModel:
    """What a header is of.

    namespace   of everything in it
    comment     lines at its top
    parameters  name to its value where none is given, and a comment
    internal    names of the internal variables, with their values in an undeformed body
    plastic     None for a purely elastic material
    """

    namespace: str
    comment: Sequence[str]
    parameters: Mapping[str, tuple[float, str]]
    internal: Mapping[str, float]
    elastic: HeaderLaw
    plastic: HeaderLaw | None


def law_header(model: HeaderModel) -> str:
    """The text of the header."""
    laws = [law for law in (model.elastic, model.plastic) if law is not None]
    operations = max(_defined(law.kernel, "LAW_OPERATIONS") for law in laws)
    plastic = "\n".join(_flat("no_flow.hpp")) if model.plastic is None else _law(model.plastic)
    interface = (PORTABLE / "c_interface.hpp").read_text().replace("NAMESPACE", model.namespace)
    return "\n".join(
        (
            *(f"// {line}".rstrip() for line in model.comment),
            "#pragma once",
            *_flat("standard.hpp", includes=True),
            "",
            f"namespace {model.namespace} {{",
            "",
            *_flat("standard.hpp"),
            f"constexpr int MOST_OPERATIONS = {operations};  // and inputs, of a law",
            *(line for name in SHARED for line in _flat(name)),
            _parameters(model),
            f"namespace elastic {{\n{_law(model.elastic)}\n}}  // namespace elastic\n",
            f"namespace plastic {{\n{plastic}\n}}  // namespace plastic\n",
            *_flat("model.hpp"),
            f"}}  // namespace {model.namespace}",
            "",
            interface,
        )
    )


def _law(law: HeaderLaw) -> str:
    """What stands in the namespace of a law."""
    statements, rows = law.coefficients
    sizes = [law.weights[0][0].shape[1], *(len(bias) for _, bias in law.weights)] if law.weights else []
    assigned = "".join(f"    rows[{k}] = {row};\n" for k, row in enumerate(rows))
    return "\n".join(
        (
            f"constexpr int LAYERS = {max(law.kernel.layers, 1)}, PARAMETER_ROWS = {law.kernel.rows}, "
            f"INTERNAL = {law.kernel.internal};",
            f"constexpr int VARIABLES[] = {{{', '.join(map(str, law.variables)) or '0'}}};",
            *_weights(law, sizes or [0] * (law.kernel.layers + 1)),
            "",
            "// what the formulas read of the parameters",
            "inline void coefficients(const Parameters& p, double time_step, double* rows) {",
            "    (void)p, (void)time_step;",
            f"{statements}{assigned}}}",
            "",
            *_law_text(law.kernel),
            *(line for name in OF_LAW for line in _flat(name)),
        )
    )


def _weights(law: HeaderLaw, sizes: Sequence[int]) -> Iterator[str]:
    arrays = [array for layer in law.weights for array in layer]
    single = all((array.astype(np.float32) == array).all() for array in arrays)
    kind = "float" if single else "double"
    yield f"constexpr int SIZES[] = {{{', '.join(map(str, sizes))}}}, WIDEST = {max([1, *sizes])};"
    for k, array in enumerate(arrays):
        yield f"inline constexpr {kind} W{k}[] = {{"
        numbers = [f"{value!r}f" if single else repr(value) for value in _numbers(array, single)]
        for first in range(0, len(numbers), NUMBERS_A_LINE):
            yield f"    {', '.join(numbers[first : first + NUMBERS_A_LINE])},"
        yield "};"
    for name, first in (("WEIGHTS", 0), ("BIASES", 1)):
        named = ", ".join(f"W{k}" for k in range(first, len(arrays), 2)) or "nullptr"
        yield f"inline constexpr const {kind}* {name}[] = {{{named}}};"


def _numbers(array: np.ndarray, single: bool) -> list[float]:
    """Numbers whose shortest decimals give them back."""
    flat = array.reshape(-1)
    return [float(str(value)) for value in flat.astype(np.float32)] if single else flat.tolist()


def _parameters(model: HeaderModel) -> str:
    fields = "\n".join(
        f"    double {name} = {value!r};  // {words}" for name, (value, words) in model.parameters.items()
    )
    read = ", ".join(f"given[{k}]" for k in range(len(model.parameters)))
    names = ", ".join(f'"{name}"' for name in model.internal)
    starts = ", ".join(map(repr, model.internal.values()))
    return f"""
// Physical parameters; those of nobody's choice are the middle of the ranges.
struct Parameters {{
{fields}
}};
constexpr int PARAMETER_COUNT = {len(model.parameters)};
inline Parameters parameters_of(const double* given) {{ return Parameters{{{read}}}; }}

// Internal variables, and their values in a body that has not been deformed.
constexpr int INTERNAL_VARIABLES = {len(model.internal)};
inline constexpr const char* INTERNAL_NAMES[] = {{{names or "nullptr"}}};
inline constexpr double INTERNAL_START[] = {{{starts or "0.0"}}};
"""


def _law_text(kernel: LawKernel) -> list[str]:
    lines = [line for line in kernel.text.splitlines() if line and not line.startswith(("#", "namespace", "}  //"))]
    # not every formula reads all that it is given
    return [re.sub(r"(?<=[(,] )const S\*|(?<=\()const S\*", "[[maybe_unused]] const S*", line) for line in lines]


def _defined(kernel: LawKernel, name: str) -> int:
    found = re.search(rf"#define {name} (\d+)", kernel.text)
    if found is None:
        raise ValueError(f"the kernel of '{kernel.name}' defines no {name}")
    return int(found[1])


def _flat(name: str, includes: bool = False) -> Iterator[str]:
    """The lines of a source file as they stand in a namespace of their own, or those before its namespace."""
    folder = PORTABLE if (PORTABLE / name).is_file() else SOURCES
    lines = list(_chosen((folder / name).read_text().splitlines()))
    start = next((k for k, line in enumerate(lines) if line.startswith("namespace ")), len(lines))
    if includes:
        yield from (line for line in lines[:start] if line.strip() and not line.startswith(("// ", "#pragma")))
        return
    for line in lines:
        directive = line.startswith(("#", "namespace pcnclaws", "}  // namespace")) or "#pragma" in line
        constant = line.startswith(("constexpr int LAYERS", "constexpr int PARAMETER_ROWS", "constexpr int INTERNAL ="))
        if not directive and not (constant and folder == SOURCES) and "MOST_OPERATIONS = LAW" not in line:
            yield reduce(lambda text, hint: text.replace(*hint), HINTS, line)


def _chosen(lines: Sequence[str]) -> Iterator[str]:
    """The lines that a preprocessor keeps, of conditions on DEFINED and UNDEFINED."""
    kept: list[bool | None] = []  # None: a condition that is left to the compiler
    for line in lines:
        words = line.split()
        if words[:1] in (["#ifdef"], ["#ifndef"], ["#if"]):
            known = words[1] in (*DEFINED, *UNDEFINED) and words[0] != "#if"
            kept.append((words[1] in DEFINED) == (words[0] == "#ifdef") if known else None)
            if known:
                continue
        elif words[:1] == ["#else"] and kept[-1] is not None:
            kept[-1] = not kept[-1]
            continue
        elif words[:1] == ["#endif"] and kept.pop() is not None:
            continue
        if all(one is not False for one in kept):
            yield line
