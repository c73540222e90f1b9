"""Nothing in the kernels reads or writes beyond its arrays: sanitizers stop at the first such place."""

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from benchmarks.remembering_material import HardeningVonMises
from pcnclaws.compiled.build import LAW_HEADER, SOURCES, find_compiler
from pcnclaws.laws.elasticity import FixedCorotated
from pcnclaws.laws.law import Law
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.laws.plasticity import Tresca

FLAGS = ("-std=c++17", "-O1", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-Wno-unknown-pragmas")
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
HERE = Path(__file__).parent
SAND = {"name": "pcnclaws", "width": 8}
LAWS: dict[str, Callable[[], Law]] = {
    "FixedCorotated": FixedCorotated,
    "Tresca": Tresca,
    "HardeningVonMises": HardeningVonMises,
    "elastic network": lambda: build_neural_laws(MATERIALS["sand"], SAND).elasticity,
    "plastic network": lambda: cast(Law, build_neural_laws(MATERIALS["sand"], SAND).plasticity),
}


@pytest.mark.slow
@pytest.mark.parametrize("number", ["float", "double"])
def test_kernels_of_the_step_stay_within_their_arrays(number: str, tmp_path: Path) -> None:
    _run("kernel_memory.cpp", tmp_path, "-fopenmp", f"-DNUMBER={number}")


@pytest.mark.slow
@pytest.mark.parametrize("number", ["float", "double"])
@pytest.mark.parametrize("law", LAWS)
def test_kernels_of_a_law_stay_within_their_arrays(law: str, number: str, tmp_path: Path) -> None:
    _write_law(LAWS[law](), tmp_path)
    _run("law_memory.cpp", tmp_path, "-fopenmp", f"-DNUMBER={number}")


@pytest.mark.slow
@pytest.mark.parametrize("number", ["float", "double"])
@pytest.mark.parametrize(("law", "ends"), [("elastic network", (4, 6)), ("plastic network", (4, 3))])
@pytest.mark.parametrize(("units", "staged"), [(40, True), (40, False), (7, True)])
def test_kernels_for_gpus_stay_within_their_arrays(
    law: str, ends: tuple[int, int], units: int, staged: bool, number: str, tmp_path: Path
) -> None:
    _write_law(LAWS[law](), tmp_path)
    sizes = {f"UNITS_{layer}": count for layer, count in enumerate((ends[0], units, units, ends[1]))}
    flags = [f"-D{name}={value}" for name, value in {"NUMBER": number, **sizes}.items()]
    _run("gpu_kernel_memory.cpp", tmp_path, "-DONE_LANE", *(["-DSTAGED"] if staged else []), *flags)


@pytest.mark.slow
@pytest.mark.parametrize("number", ["float", "double"])
def test_a_step_for_gpus_stays_within_its_arrays(number: str, tmp_path: Path) -> None:
    _run("gpu_step_memory.cpp", tmp_path, "-DONE_LANE", f"-DNUMBER={number}")


def _write_law(law: Law, folder: Path) -> None:
    kernel = law.kernel
    assert kernel is not None
    (folder / LAW_HEADER).write_text(kernel.text)


def _run(source: str, folder: Path, *flags: str) -> None:
    compiler = find_compiler()
    program = folder / "program"
    if compiler is None or not _sanitizers_work(compiler, folder):
        pytest.skip("needs a C++ compiler with AddressSanitizer and UndefinedBehaviorSanitizer")
    given = [*FLAGS, *SANITIZERS, *flags, f"-I{folder}", f"-I{SOURCES}", str(HERE / source), "-o", str(program)]
    subprocess.run([*compiler, *given], check=True, capture_output=True, text=True)
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr[:4000]


def _sanitizers_work(compiler: tuple[str, ...], folder: Path) -> bool:
    empty = folder / "empty.cpp"
    empty.write_text("int main() {}\n")
    program = folder / "empty"
    built = subprocess.run([*compiler, *SANITIZERS, str(empty), "-o", str(program)], capture_output=True, check=False)
    return built.returncode == 0 and subprocess.run([program], check=False).returncode == 0
