"""The AOTInductor package of a law gives what PyTorch gives, to rounding, for any number of particles."""

import shutil
import subprocess
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import torch
import torch._inductor
from torch import Tensor

import pcnclaws as pc
from benchmarks.remembering_material import CLAY
from pcnclaws.compiled.build import find_compiler
from pcnclaws.laws.exported_program import LawProgram, program_package

EXACT = 1e-13
CALLER = Path(__file__).parents[2] / "examples" / "10_from_libtorch" / "caller.cpp"
LAWS = {"elasticity": "law=analytic material=elasticity", "sand": "law=sand"}
MODELS = {"elasticity": pc.analytic_law("elasticity"), "sand": pc.load_law("sand")}


def states(count: int) -> Tensor:
    """Deformation gradients, the degenerate ones first."""
    torch.manual_seed(count)
    eye = torch.eye(3, dtype=torch.float64)
    turn = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64))[0]
    equal = turn @ torch.diag(torch.tensor([0.95, 0.95, 1.02], dtype=torch.float64)) @ turn.T
    general = eye + 0.1 * torch.randn(count, 3, 3, dtype=torch.float64)
    return torch.cat((torch.stack((eye, 0.97 * eye, equal)), general))[:count]


def differences(found: Any, model: pc.ConstitutiveModel, trial: Tensor, parameters: Tensor) -> list[float]:
    """Of F, tau and their tangents from those of PyTorch, as parts of 1 and of Young's modulus."""
    known: dict[str, Any] = dict(zip(model.parameter_names, parameters.unbind(1), strict=True))
    at = trial.clone().requires_grad_()
    with pc.using_backend("torch"):
        after = model.return_map(at, **known)
        stress = model.stress(after, **known)

    def tangent(values: Tensor) -> Tensor:
        flat = values.flatten(1)
        rows = [torch.autograd.grad(flat[:, k].sum(), at, retain_graph=True)[0] for k in range(9)]
        return torch.stack(rows, 1).reshape(-1, 3, 3, 3, 3)

    expected, units = (after, stress, tangent(after), tangent(stress)), (1.0, 1e5, 1.0, 1e5)
    return [float((a - b).detach().abs().max()) / unit for a, b, unit in zip(found, expected, units, strict=True)]


def parameters_of(model: pc.ConstitutiveModel, count: int) -> Tensor:
    """Of each particle its own."""
    share = torch.linspace(0.2, 0.8, count, dtype=torch.float64)
    return torch.stack([low + share * (high - low) for low, high in model.ranges.values()], 1)


def test_the_function_that_is_exported_has_the_tangents_of_the_law() -> None:
    model = pc.analytic_law("plasticine")
    trial, parameters = states(5), parameters_of(model, 5)
    with pc.using_backend("torch"):
        found = LawProgram(model)(trial, parameters)
    assert max(differences(found, model, trial, parameters)) < EXACT


@pytest.fixture(scope="module", params=list(LAWS))
def law(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def package(law: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made as a user makes it; it takes minutes."""
    folder = tmp_path_factory.mktemp("package")
    command = [sys.executable, "-m", "pcnclaws.export", *LAWS[law].split(), "output=law.pt2"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return folder / "law.pt2"


@pytest.fixture(scope="module")
def caller(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built as the docs say where there is CMake, otherwise by hand."""
    compiler, root = find_compiler(), Path(torch.__file__).parent
    if compiler is None:
        pytest.skip("needs a C++ compiler")
    folder = tmp_path_factory.mktemp("caller")
    if shutil.which("cmake"):
        prefix = f"-DCMAKE_PREFIX_PATH={torch.utils.cmake_prefix_path}"
        built([("cmake", "-S", CALLER.parent, "-B", folder, prefix), ("cmake", "--build", folder)])
    else:
        includes = (f"-I{root / 'include'}", f"-I{root / 'include/torch/csrc/api/include'}")
        libraries = (f"-L{root / 'lib'}", "-ltorch", "-ltorch_cpu", "-lc10", f"-Wl,-rpath,{root / 'lib'}")
        built([(*compiler, "-std=c++20", "-O0", *includes, CALLER, *libraries, "-o", folder / "caller")])
    return folder / "caller"


def built(commands: Sequence[Sequence[str | Path]]) -> None:
    for command in commands:
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_package_runs_from_python_without_the_law(law: str, package: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        program = torch._inductor.aoti_load_package(str(package))
    for count in (2, 5, 40):
        trial, parameters = states(count), parameters_of(MODELS[law], count)
        assert max(differences(program(trial, parameters), MODELS[law], trial, parameters)) < 10 * EXACT


@pytest.mark.slow
def test_a_package_runs_from_cpp_with_libtorch_alone(law: str, package: Path, caller: Path) -> None:
    for count in (2, 5, 40):
        trial, parameters = states(count), parameters_of(MODELS[law], count)
        table = torch.cat((parameters, trial.flatten(1)), 1).tolist()
        text = "\n".join(" ".join(map(repr, row)) for row in table)
        done = subprocess.run([caller, package], input=text, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        rows = [[float(number) for number in line.split()] for line in done.stdout.splitlines()]
        found = torch.tensor(rows, dtype=torch.float64).split([9, 9, 81, 81], 1)
        shaped = [one.reshape(count, *[3] * (2 + 2 * (k > 1))) for k, one in enumerate(found)]
        assert max(differences(shaped, MODELS[law], trial, parameters)) < 10 * EXACT


@pytest.mark.slow
def test_what_the_caller_cannot_use_is_one_line(caller: Path, tmp_path: Path) -> None:
    (tmp_path / "law.pt2").write_bytes(b"not a package")
    for arguments, given, message in (
        (("law.pt2",), "1 2\n", "give at least two states"),
        ((), "", "usage: caller PACKAGE"),
        (("law.pt2",), "1 1 0 0 0 1 0 0 0 1\n" * 2, "error: "),
    ):
        done = subprocess.run([caller, *arguments], input=given, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode in (1, 2)
        assert message in done.stderr


def test_what_no_package_is_made_of_is_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(pc.UserError, match="format=pt2: the law of clay remembers or takes time"):
        program_package(pc.analytic_law(CLAY))
    monkeypatch.setattr("pcnclaws.laws.exported_program.find_compiler", lambda: None)
    with pytest.raises(pc.UserError, match="format=pt2 needs a C\\+\\+ compiler"):
        program_package(pc.analytic_law("sand"))
    assert not list(tmp_path.iterdir())
