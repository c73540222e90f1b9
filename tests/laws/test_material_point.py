"""A material point of finite element codes, made of an exported header: Cauchy stress, tangent, Fortran."""

import ctypes
import math
import shutil
import subprocess
from pathlib import Path

import pytest
import torch
from torch import Tensor

import pcnclaws as pc
from pcnclaws.compiled.build import find_compiler
from pcnclaws.laws.exported_header import header_text

EXAMPLE = Path(__file__).parents[2] / "examples" / "09_from_fortran"
ORDER = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
PROPERTIES = {"youngs_modulus": 4e5, "poissons_ratio": 0.25, "yield_stress": 5e3}
DOUBLES = ctypes.POINTER(ctypes.c_double)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("point")
    (folder / "law.hpp").write_text(header_text(pc.analytic_law("plasticine"), "it"))
    return folder


def build(folder: Path, *options: str) -> None:
    compiler = find_compiler()
    if compiler is None:
        pytest.skip("needs a C++ compiler")
    flags = ("-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", '-DLAW_HEADER="law.hpp"', "-DLAW=pcnclaws_it")
    source = str(EXAMPLE / "material_point.cpp")
    done = subprocess.run([*compiler, *flags, f"-I{folder}", source, *options], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.fixture(scope="module")
def library(folder: Path) -> ctypes.CDLL:
    build(folder, "-shared", "-fPIC", "-o", str(folder / "point.so"))
    return ctypes.CDLL(str(folder / "point.so"))


def by_address(tensor: Tensor) -> "ctypes._Pointer[ctypes.c_double]":
    assert tensor.is_contiguous()
    assert tensor.dtype == torch.float64
    return ctypes.cast(tensor.data_ptr(), DOUBLES)


def point(library: ctypes.CDLL, f_old: Tensor, f_new: Tensor, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """State, stress and tangent after an increment; matrices are given as Fortran keeps them."""
    state, stress, tangent = state.clone(), torch.zeros(6).double(), torch.zeros(6, 6).double()
    properties = torch.tensor(list(PROPERTIES.values()), dtype=torch.float64)
    old, new = f_old.T.contiguous(), f_new.T.contiguous()
    library.pcnclaws_material_point(
        *map(by_address, (properties, old, new)), ctypes.c_double(0.1), *map(by_address, (state, stress, tangent))
    )
    return state, stress, tangent.T


def matrix(components: Tensor) -> Tensor:
    full = torch.zeros(3, 3, dtype=torch.float64)
    for k, (i, j) in enumerate(ORDER):
        full[i, j] = full[j, i] = components[k]
    return full


def expected(f_new: Tensor, f_old: Tensor, elastic: Tensor) -> tuple[Tensor, Tensor]:
    """Elastic F and Cauchy stress from PyTorch."""
    law = pc.analytic_law("plasticine")
    with pc.using_backend("torch"):
        after = law.return_map(f_new @ torch.linalg.inv(f_old) @ elastic, **PROPERTIES)  # pyright: ignore[reportArgumentType]
        return after, law.stress(after, **PROPERTIES) / torch.linalg.det(f_new)  # pyright: ignore[reportArgumentType]


def test_increments_give_cauchy_stress_and_the_tangent_that_differences_find(library: ctypes.CDLL) -> None:
    torch.manual_seed(0)
    eye = torch.eye(3, dtype=torch.float64)
    assert library.pcnclaws_property_count() == 3
    f_old, state, elastic = eye, torch.zeros(library.pcnclaws_state_count()).double(), eye
    for _ in range(3):
        f_new = f_old + 0.01 * torch.randn(3, 3, dtype=torch.float64)
        after, cauchy = expected(f_new, f_old, elastic)
        found, stress, tangent = point(library, f_old, f_new, state)
        torch.testing.assert_close(found[:9].reshape(3, 3), after, rtol=0, atol=1e-14)
        torch.testing.assert_close(matrix(stress), cauchy, rtol=0, atol=1e-9)
        volume = torch.linalg.det(f_new)
        for k, (i, j) in enumerate(ORDER):
            strain = torch.zeros(3, 3, dtype=torch.float64)
            strain[i, j] += 0.5
            strain[j, i] += 0.5
            sides = []
            for step in (1e-6, -1e-6):
                moved = (eye + step * strain) @ f_new
                sides.append(expected(moved, f_old, elastic)[1] * torch.linalg.det(moved) / volume)
            torch.testing.assert_close(matrix(tangent[:, k]), (sides[0] - sides[1]) / 2e-6, rtol=0, atol=1e-2)
        assert (after - f_new).abs().max() > 1e-4  # it flows
        f_old, state, elastic = f_new, found, after


def test_a_rotation_turns_the_stress_of_fixed_axes_and_not_that_of_turning_ones(library: ctypes.CDLL) -> None:
    angle = 0.7
    turn = torch.tensor([[math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0],
                         [0.0, 0.0, 1.0]], dtype=torch.float64)  # fmt: skip
    stretch = torch.tensor([[1.01, 0.004, 0.001], [0.004, 0.99, 0.002], [0.001, 0.002, 1.0]], dtype=torch.float64)
    eye, zero = torch.eye(3, dtype=torch.float64), torch.zeros(9).double()
    _, unturned, _ = point(library, eye, stretch, zero)
    _, turned, _ = point(library, eye, turn @ stretch, zero)
    torch.testing.assert_close(matrix(turned), turn @ matrix(unturned) @ turn.T, rtol=0, atol=1e-9)
    new, u = (turn @ stretch).T.contiguous(), torch.stack([stretch[i, j] for i, j in ORDER])
    library.pcnclaws_turn_with_body(*map(by_address, (new, u, turned)))
    torch.testing.assert_close(turned, unturned, rtol=0, atol=1e-9)


@pytest.mark.skipif(shutil.which("gfortran") is None, reason="gfortran is not installed")
def test_fortran_drives_one_element_through_the_umat(folder: Path) -> None:
    build(folder, "-c", "-o", str(folder / "material_point.o"))
    sources = [str(EXAMPLE / name) for name in ("material_point.f90", "umat.f90", "vumat.f90", "element.f90")]
    command = ["gfortran", "-Wall", *sources, "material_point.o", "-lstdc++", "-o", "element"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    given = " ".join(map(repr, PROPERTIES.values()))
    done = subprocess.run([folder / "element"], input=given, capture_output=True, text=True, check=True)
    rows = [[float(number) for number in line.split()] for line in done.stdout.splitlines()]
    assert len(rows) == 20
    elastic, f_old = torch.eye(3, dtype=torch.float64), torch.eye(3, dtype=torch.float64)
    for axial, side, stress, iterations, left in rows:
        f_new = torch.diag(torch.tensor([axial, side, side], dtype=torch.float64))
        elastic, cauchy = expected(f_new, f_old, elastic)
        assert float(cauchy[0, 0]) == pytest.approx(stress, rel=1e-9)
        assert abs(float(cauchy[1, 1])) < 1e-3
        assert left < 1e-3
        assert iterations <= 6  # as Newton's method does with a consistent tangent
        f_old = f_new
    # the bound on |dev tau| is sqrt(3/2) of it in uniaxial stress
    axial, side, stress, *_ = rows[-1]
    assert -stress * axial * side**2 == pytest.approx(math.sqrt(1.5) * PROPERTIES["yield_stress"], rel=1e-6)
