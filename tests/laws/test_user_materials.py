"""The UMAT and VUMAT wrappers of an exported law, compiled with gfortran and driven along paths of deformation."""

import math
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor

import pcnclaws as pc
from benchmarks.remembering_material import CLAY
from pcnclaws.compiled.build import find_compiler
from pcnclaws.laws.exported_header import header_text

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("gfortran") is None, reason="gfortran is not installed"),
    pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler"),
]
EXAMPLE = Path(__file__).parents[2] / "examples" / "09_from_fortran"
ORDER = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
EXPLICIT_ORDER = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)]
TIME_STEP = 0.01
LAWS = {"plasticine": pc.analytic_law("plasticine"), "sand": pc.load_law("sand"), "clay": pc.analytic_law(CLAY)}


class Answer(NamedTuple):
    """Cauchy stress [Pa], state variables, DDSDDE [Pa], and Cauchy stress in turning axes [Pa], of one increment."""

    stress: Tensor
    state: Tensor
    tangent: Tensor
    turning: Tensor


@pytest.fixture(scope="module", params=list(LAWS))
def law(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def program(law: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp(law)
    (folder / "law.hpp").write_text(header_text(LAWS[law], "it"))
    flags = ["-std=c++17", "-O0", '-DLAW_HEADER="law.hpp"', "-DLAW=pcnclaws_it", f"-I{folder}"]
    run(folder, *(find_compiler() or ()), *flags, "-c", str(EXAMPLE / "material_point.cpp"), "-o", "point.o")
    sources = [str(EXAMPLE / f"{name}.f90") for name in ("material_point", "umat", "vumat", "path")]
    run(folder, "gfortran", "-Wall", "-fcheck=all", *sources, "point.o", "-lstdc++", "-o", "path")
    return folder / "path"


def run(folder: Path, *command: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def parameters_of(law: str) -> dict[str, Any]:
    return {name: 0.4 * low + 0.6 * high for name, (low, high) in LAWS[law].ranges.items()}


def answers(program: Path, law: str, path: Sequence[Tensor]) -> list[Answer]:
    lines = [[TIME_STEP, *parameters_of(law).values()], *(f.flatten().tolist() for f in path)]
    text = "\n".join(" ".join(map(repr, line)) for line in lines)
    done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    rows = torch.tensor([[float(x) for x in line.split()] for line in done.stdout.splitlines()], dtype=torch.float64)
    assert len(rows) == len(path)
    states = rows.shape[1] - 48
    return [
        Answer(matrix(one[0], ORDER), one[1], one[2].reshape(6, 6).T, matrix(one[3], EXPLICIT_ORDER))
        for one in (row.split([6, states, 36, 6]) for row in rows)
    ]


def matrix(components: Tensor, order: list[tuple[int, int]]) -> Tensor:
    full = torch.zeros(3, 3, dtype=torch.float64)
    for k, (i, j) in enumerate(order):
        full[i, j] = full[j, i] = components[k]
    return full


def uniaxial(increments: int = 8) -> list[Tensor]:
    """Confined compression to 0.94 of the length."""
    lengths = [1.0 - 0.06 * (k + 1) / increments for k in range(increments)]
    return [torch.diag(torch.tensor([one, 1.0, 1.0], dtype=torch.float64)) for one in lengths]


def sheared(increments: int = 8) -> list[Tensor]:
    """Simple shear to 0.1 of a body that is compressed, and turned by 40 degrees on the way."""
    path = []
    for k in range(1, increments + 1):
        share = k / increments
        angle = math.radians(40.0) * share
        turn = torch.eye(3, dtype=torch.float64)
        turn[0, 0] = turn[2, 2] = math.cos(angle)
        turn[0, 2], turn[2, 0] = math.sin(angle), -math.sin(angle)
        shear = torch.diag(torch.tensor([0.99, 0.98, 0.99], dtype=torch.float64))
        shear[0, 1] = 0.1 * share
        path.append(turn @ shear)
    return path


PATHS = {"uniaxial": uniaxial(), "sheared": sheared()}


@pytest.mark.parametrize("name", list(PATHS))
def test_stress_and_state_variables_follow_pytorch_through_umat_and_vumat(program: Path, law: str, name: str) -> None:
    model, known, path = LAWS[law], parameters_of(law), PATHS[name]
    elastic = f_old = torch.eye(3, dtype=torch.float64)
    internal = torch.tensor([one.start for one in model.laws.internal_variables], dtype=torch.float64)
    flowed = 0.0
    for found, f_new in zip(answers(program, law, path), path, strict=True):
        trial = f_new @ torch.linalg.inv(f_old) @ elastic
        with pc.using_backend("torch"), torch.no_grad():
            if len(internal):
                elastic, internal = model.return_map(trial, **known, internal=internal, dt=TIME_STEP)
                tau = model.stress(elastic, **known, internal=internal)
            else:
                elastic = model.return_map(trial, **known)
                tau = model.stress(elastic, **known)
        stiffness = known["youngs_modulus"]
        cauchy = tau / torch.linalg.det(f_new)
        torch.testing.assert_close(found.state[:9].reshape(3, 3), elastic, rtol=0, atol=1e-12)
        torch.testing.assert_close(found.state[9:], internal, rtol=0, atol=1e-12)
        torch.testing.assert_close(found.stress, cauchy, rtol=0, atol=1e-11 * stiffness)
        u, _, v = torch.linalg.svd(f_new)
        turn = u @ v
        torch.testing.assert_close(found.turning, turn.T @ cauchy @ turn, rtol=0, atol=1e-11 * stiffness)
        flowed = max(flowed, float((elastic - trial).abs().max()))
        f_old = f_new
    assert flowed > 1e-4 or (law, name) == ("sand", "uniaxial")  # confined sand does not yield


def test_ddsdde_is_what_differences_of_the_umat_find(program: Path, law: str) -> None:
    path = PATHS["sheared"]
    tangent, volume = answers(program, law, path)[-1].tangent, torch.linalg.det(path[-1])
    eye, stiffness = torch.eye(3, dtype=torch.float64), parameters_of(law)["youngs_modulus"]
    for k, (i, j) in enumerate(ORDER):
        strain = torch.zeros(3, 3, dtype=torch.float64)
        strain[i, j] += 0.5
        strain[j, i] += 0.5
        sides = []
        for step in (1e-6, -1e-6):
            moved = (eye + step * strain) @ path[-1]
            sides.append(answers(program, law, [*path[:-1], moved])[-1].stress * torch.linalg.det(moved) / volume)
        expected = (sides[0] - sides[1]) / 2e-6
        torch.testing.assert_close(matrix(tangent[:, k], ORDER), expected, rtol=0, atol=1e-7 * stiffness)
