"""The AOTInductor package of a law gives what PyTorch gives, to rounding, for any number of particles."""

import warnings
from pathlib import Path
from typing import Any

import pytest
import torch
import torch._inductor
from torch import Tensor

import pcnclaws as pc
from benchmarks.remembering_material import CLAY
from pcnclaws.export import export
from pcnclaws.laws.exported_program import LawProgram, program_package

EXACT = 1e-13


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


@pytest.mark.slow
@pytest.mark.parametrize("law", ["law=analytic material=elasticity"])
def test_a_package_runs_from_python_without_the_law(law: str, in_process: Any) -> None:
    done = in_process(export, "export", *law.split(), "output=law.pt2")
    assert done.status == 0, done.err
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        program = torch._inductor.aoti_load_package("law.pt2")
    model = pc.analytic_law("elasticity")
    for count in (2, 5, 40):
        trial, parameters = states(count), parameters_of(model, count)
        found = program(trial, parameters)
        errors = differences(found, model, trial, parameters)
        print(count, errors)
        assert max(errors) < 10 * EXACT


def test_what_no_package_is_made_of_is_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(pc.UserError, match="format=pt2: the law of clay remembers or takes time"):
        program_package(pc.analytic_law(CLAY))
    monkeypatch.setattr("pcnclaws.laws.exported_program.find_compiler", lambda: None)
    with pytest.raises(pc.UserError, match="format=pt2 needs a C\\+\\+ compiler"):
        program_package(pc.analytic_law("sand"))
    assert not list(tmp_path.iterdir())
