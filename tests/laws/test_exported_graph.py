"""The ONNX graph of a law gives what PyTorch gives, to rounding, for any number of particles."""

from importlib.util import find_spec
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.nn import functional

import pcnclaws as pc
from benchmarks.remembering_material import CLAY
from pcnclaws.export import export
from pcnclaws.laws import exported_graph
from pcnclaws.laws.exported_graph import LawValues, onnx_graph

LAWS = {
    "analytic elasticity": pc.analytic_law("elasticity"),
    "analytic plasticine": pc.analytic_law("plasticine"),
    "analytic sand": pc.analytic_law("sand"),
    "analytic neo-Hookean": pc.analytic_law("neo_hookean"),
    "shipped elasticity": pc.load_law("elasticity"),
    "shipped plasticine": pc.load_law("plasticine"),
    "shipped sand": pc.load_law("sand"),
}


def states(count: int) -> Tensor:
    """Deformation gradients, the degenerate and the extreme ones first."""
    torch.manual_seed(count)
    eye = torch.eye(3, dtype=torch.float64)
    turn, other = (torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64))[0] for _ in range(2))
    turn, other = turn * torch.linalg.det(turn), other * torch.linalg.det(other)
    equal, far = (
        turn @ torch.diag(torch.tensor(stretches, dtype=torch.float64)) @ other
        for stretches in ([0.95, 0.95, 1.02], [0.1, 1.0, 8.0])
    )
    general = eye + 0.1 * torch.randn(count, 3, 3, dtype=torch.float64)
    return torch.cat((torch.stack((eye, 0.97 * eye, equal, turn, far)), general))[:count]


def parameters_of(model: pc.ConstitutiveModel, count: int) -> Tensor:
    """Of each particle its own."""
    share = torch.linspace(0.2, 0.8, count, dtype=torch.float64)
    return torch.stack([low + share * (high - low) for low, high in model.ranges.values()], 1)


def expected(model: pc.ConstitutiveModel, trial: Tensor, parameters: Tensor) -> tuple[Tensor, Tensor]:
    known: dict[str, Any] = dict(zip(model.parameter_names, parameters.unbind(1), strict=True))
    with pc.using_backend("torch"), torch.no_grad():
        after = model.return_map(trial, **known)
        return after, model.stress(after, **known)


def assert_same(found: tuple[Tensor, ...], model: pc.ConstitutiveModel, trial: Tensor, parameters: Tensor) -> None:
    """F to 1e-13 of its size, tau to 1e-12 of Young's modulus times the size of its strain's stress."""
    after, stress = expected(model, trial, parameters)
    size = stress.abs().amax((1, 2), keepdim=True) + parameters[:, :1, None]
    assert float((found[0] - after).abs().max() / after.abs().max()) < 1e-13
    assert float(((found[1] - stress) / size).abs().max()) < 1e-12


@pytest.mark.parametrize("name", list(LAWS))
def test_the_function_that_becomes_a_graph_is_the_law(name: str) -> None:
    model, count = LAWS[name], 12
    trial, parameters = states(count), parameters_of(LAWS[name], count)
    with pc.using_backend("torch"), torch.no_grad():
        assert_same(LawValues(model)(trial, parameters), model, trial, parameters)


def test_the_error_function_of_runtimes_without_one_has_all_digits() -> None:
    x = torch.linspace(-12.0, 12.0, 10001, dtype=torch.float64)
    torch.testing.assert_close(exported_graph.gelu(x), functional.gelu(x), rtol=0, atol=1e-14)


def test_states_turned_inside_out_are_not_numbers() -> None:
    trial = torch.diag(torch.tensor([1.0, 1.0, -0.9], dtype=torch.float64)).expand(2, 3, 3)
    model = pc.analytic_law("sand")
    _, stress = LawValues(model)(trial, parameters_of(model, 2))
    assert bool(stress.isnan().all())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("analytic neo-Hookean", "law=analytic material=neo_hookean"),
        ("analytic plasticine", "law=analytic material=plasticine"),
        ("shipped elasticity", "law=elasticity"),
        ("shipped sand", "law=sand"),
    ],
)
def test_onnxruntime_computes_the_same(name: str, law: str, in_process: Any) -> None:
    onnxruntime, *_ = (
        pytest.importorskip(package, reason="needs pip install onnx onnxscript onnxruntime")
        for package in ("onnxruntime", "onnxscript", "onnx")
    )
    done = in_process(export, "export", *law.split(), "output=law.onnx")
    assert done.status == 0, done.err
    session = onnxruntime.InferenceSession("law.onnx", providers=["CPUExecutionProvider"])
    model = LAWS[name]
    for count in (1, 2, 5, 40):
        trial, parameters = states(count), parameters_of(model, count)
        found = session.run(["elastic", "stress"], {"trial": trial.numpy(), "parameters": parameters.numpy()})
        assert_same(tuple(map(torch.from_numpy, found)), model, trial, parameters)


def test_what_no_graph_is_made_of_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(pc.UserError, match="format=onnx: the law of clay remembers or takes time"):
        LawValues(pc.analytic_law(CLAY))
    monkeypatch.setattr(exported_graph, "find_spec", lambda name: None if name == "onnxscript" else find_spec("torch"))
    with pytest.raises(pc.UserError, match="format=onnx needs onnxscript.*pip install 'pcnclaws\\[onnx\\]'"):
        onnx_graph(pc.analytic_law("sand"))
