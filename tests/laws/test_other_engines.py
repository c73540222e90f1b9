"""The snippets of docs/taking_along.md that call a law between kernels of Warp and Taichi."""

import re
from pathlib import Path
from typing import Any

import pytest
import torch

import pcnclaws as pc

PAGE = Path(__file__).parents[2] / "docs" / "taking_along.md"
PARAMETERS: dict[str, Any] = {"youngs_modulus": 4e5, "poissons_ratio": 0.25, "friction_angle": 30.0}
IGNORED = ("ignore::DeprecationWarning", "ignore::UserWarning", "ignore::FutureWarning")


def run_snippet(engine: str, folder: Path) -> dict[str, Any]:
    """The names that the snippet of an engine leaves; it is a file, as kernels are made of their source."""
    pytest.importorskip(engine, reason=f"{engine} is not installed")
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (text,) = (block for block in blocks if f"import {engine} as" in block)
    file = folder / f"with_{engine}.py"
    file.write_text(text)
    names: dict[str, Any] = {"__name__": file.stem, "__file__": str(file)}
    exec(compile(text, str(file), "exec"), names)  # noqa: S102  # our own documentation
    return names


@pytest.mark.slow
@pytest.mark.filterwarnings(*IGNORED)
def test_warp_finds_the_stress_and_its_derivatives(tmp_path: Path) -> None:
    left = run_snippet("warp", tmp_path)
    gradient = torch.from_numpy(left["gradient"].numpy()).requires_grad_()
    law = pc.load_law("sand")
    trial = torch.eye(3, dtype=torch.float64) + 1e-3 * gradient
    stress = law.stress(law.return_map(trial, **PARAMETERS), **PARAMETERS)
    torch.testing.assert_close(torch.from_numpy(left["stress"].numpy()), stress.detach(), rtol=1e-9, atol=1e-4)
    total = torch.einsum("nii->", stress)
    assert float(left["total"].numpy()[0]) == pytest.approx(float(total.detach()), rel=1e-9)
    (expected,) = torch.autograd.grad(total, gradient)
    torch.testing.assert_close(torch.from_numpy(left["gradient"].grad.numpy()), expected, rtol=1e-9, atol=1e-4)


@pytest.mark.slow
@pytest.mark.filterwarnings(*IGNORED)
def test_taichi_finds_the_stress(tmp_path: Path) -> None:
    left = run_snippet("taichi", tmp_path)
    law, gradient = pc.load_law("sand"), left["gradient"].to_torch()
    elastic = torch.eye(3, dtype=torch.float64).repeat(100, 1, 1)
    for _ in range(10):
        elastic = law.return_map((torch.eye(3, dtype=torch.float64) + 1e-3 * gradient) @ elastic, **PARAMETERS)
    expected = law.stress(elastic, **PARAMETERS)
    assert float(expected.abs().max()) > 1e3
    torch.testing.assert_close(left["stress"].to_torch(), expected, rtol=1e-8, atol=1e-3)
