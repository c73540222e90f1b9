"""The C++ header of a law gives what PyTorch gives, to rounding: values, return map, consistent tangent."""

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

import pcnclaws as pc
from benchmarks.remembering_material import CLAY, PUTTY
from pcnclaws.commands.law_header import write_header
from pcnclaws.commands.law_source import LawSource
from pcnclaws.compiled.build import find_compiler
from pcnclaws.export import export
from pcnclaws.laws.elasticity import FixedCorotated
from pcnclaws.laws.exported_header import header_text

CALLER = Path(__file__).parents[2] / "examples" / "08_from_cpp" / "caller.cpp"
FLAGS = ("-std=c++17", "-O0", "-pedantic", "-Wall", "-Wextra", "-Werror")
DT = 1e-3
LAWS: dict[str, Callable[[], pc.ConstitutiveModel]] = {
    "sand that ships": lambda: pc.load_law("sand"),
    "sand": lambda: pc.analytic_law("sand"),
    "plasticine that ships": lambda: pc.load_law("plasticine"),
    "elasticity that ships": lambda: pc.load_law("elasticity"),
    "tresca": lambda: pc.analytic_law("tresca"),
    "stored energy": lambda: _stirred(pc.neural_law("neo_hookean", "pcnclaws_energy", 8)),
    "free flow": lambda: _stirred(pc.neural_law("plasticine", "pcnclaws_free_flow", 8)),
    "no prior": lambda: _stirred(pc.neural_law("sand", "pcnclaws_no_prior", 8)),
    "hardening": lambda: pc.analytic_law(CLAY),
    "flow that takes time": lambda: pc.analytic_law(PUTTY),
}
# Where derivatives have fewer digits, in PyTorch as well: a divided difference of numbers that nearly meet leaves half
# of those that the law's own sums have, and a strain of 1e-7 has lost as many to the 1 that it is added to.
TOLERANCES = {"nearly equal stretches": 1e-4, "small": 1e-8}
FAST = ("sand that ships", "elasticity that ships", "hardening")


def _stirred(model: pc.ConstitutiveModel) -> pc.ConstitutiveModel:
    """A law whose networks say something."""
    torch.manual_seed(3)
    for weight in model.parameters():
        torch.nn.init.normal_(weight, std=0.1)
    return model


def compiled(model: pc.ConstitutiveModel, folder: Path) -> Path:
    """The example program with a header of the law."""
    compiler = find_compiler()
    if compiler is None:
        pytest.skip("needs a C++ compiler")
    (folder / "law.hpp").write_text(header_text(model, "it"))
    defined = ('-DLAW_HEADER="law.hpp"', "-DLAW=pcnclaws_it", f"-I{folder}")
    done = subprocess.run(
        [*compiler, *FLAGS, *defined, str(CALLER), "-o", str(folder / "caller")], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "caller"


def states() -> dict[str, Tensor]:
    """Trial deformation gradients, the degenerate ones among them."""
    torch.manual_seed(5)
    eye = torch.eye(3, dtype=torch.float64)
    turn = torch.linalg.qr(torch.randn(2, 3, 3, dtype=torch.float64))[0]
    turn = turn * torch.linalg.det(turn)[:, None, None]

    def stretched(*stretches: float) -> Tensor:
        return turn[0] @ torch.diag(torch.tensor(stretches, dtype=torch.float64)) @ turn[1]

    shear = eye.clone()
    shear[0, 1] = 0.3
    return {
        "identity": eye,
        "rotation": turn[0],
        "compressed alike": 0.97 * eye,
        "stretched alike": stretched(1.02, 1.02, 1.02),
        "two equal stretches": stretched(0.93, 0.93, 1.01),
        "two equal stretches along the axes": torch.diag(torch.tensor([0.93, 1.01, 0.93], dtype=torch.float64)),
        "nearly equal stretches": stretched(0.93, 0.93 * (1.0 + 1e-11), 0.93 * (1.0 - 3e-9)),
        "small": eye + 1e-7 * turn[1],
        "shear": shear,
        "large": stretched(0.4, 0.9, 2.5),
        "graded": stretched(1e-3, 1.0, 30.0),
        **{f"general {k}": eye + 0.1 * torch.randn(3, 3, dtype=torch.float64) for k in range(4)},
    }


def values_of(model: pc.ConstitutiveModel) -> dict[str, float]:
    return {name: low + 0.37 * (high - low) for name, (low, high) in model.ranges.items()}


def eager(model: pc.ConstitutiveModel, trial: Tensor, before: Tensor | None) -> Tensor:
    """What the program prints of states (states, 3, 3), from PyTorch: a row each."""
    known: dict[str, Any] = values_of(model)

    def flow(f: Tensor) -> tuple[Tensor, Tensor | None]:
        found = model.return_map(f, internal=before, dt=DT, **known)
        return found if isinstance(found, tuple) else (found, None)

    def of_f(f: Tensor, after: Tensor | None) -> Tensor:
        return model.stress(f, internal=after, **known)

    def jacobian(function: Callable[[Tensor], Tensor], at: Tensor) -> Tensor:
        at = at.detach().requires_grad_()
        found = function(at).flatten(1)
        return torch.stack([torch.autograd.grad(found[:, k].sum(), at, retain_graph=True)[0] for k in range(9)], 1)

    after, internal = flow(trial)
    parts = [
        after,
        internal,
        of_f(after, internal),
        jacobian(lambda f: flow(f)[0], trial),
        jacobian(lambda f: of_f(*flow(f)), trial),
        jacobian(lambda f: of_f(f, internal), after),
    ]
    return torch.cat([part.detach().flatten(1) for part in parts if isinstance(part, Tensor)], 1)


@pytest.mark.parametrize("name", [pytest.param(name, marks=[] if name in FAST else pytest.mark.slow) for name in LAWS])
def test_a_program_in_cpp_gives_values_and_tangents_to_rounding(name: str, tmp_path: Path) -> None:
    model = LAWS[name]()
    program = compiled(model, tmp_path)
    named = states()
    trial, count = torch.stack(list(named.values())), len(model.internal_names)
    before = torch.full((len(trial), count), 0.6, dtype=torch.float64) if count else None
    first = [*values_of(model).values(), *[0.6] * count, DT]
    text = "\n".join(" ".join(map(repr, [*first, *state])) for state in trial.flatten(1).tolist())
    done = subprocess.run([str(program)], input=text, capture_output=True, text=True, check=True)
    found = torch.tensor([[float(n) for n in line.split()] for line in done.stdout.splitlines()], dtype=torch.float64)
    with pc.using_backend("torch"):
        expected = eager(model, trial, before)
    assert found.shape == expected.shape
    unit, sizes = values_of(model)["youngs_modulus"], [9, count, 9, 81, 81, 81]
    scales = [1.0, 1.0, unit, 1.0, unit, unit]
    for k, what in enumerate(named):
        parts = zip(found[k].split(sizes), expected[k].split(sizes), scales, strict=True)
        errors = [float((a - b).abs().max() / b.abs().max().clamp_min(scale)) for a, b, scale in parts if len(b)]
        print(f"{name}, {what}: {max(errors):.1e}")
        assert max(errors) < TOLERANCES.get(what, 1e-12), (what, errors)


def test_the_command_writes_a_header_named_after_its_file(in_process: Callable[..., Any]) -> None:
    done = in_process(export, "export", "law=analytic", "material=plasticine", "output=my-clay.hpp")
    assert (done.status, done.err) == (0, "")
    text = Path("my-clay.hpp").read_text()
    assert "namespace pcnclaws_my_clay {" in text
    assert "double yield_stress = 5000.0;  // [Pa], a finite number at least 0 Pa; usual: 2000 to 8000" in text
    assert not [line for line in text.splitlines() if line.startswith("#include") and "<" not in line]


def test_a_law_without_a_kernel_gives_no_header_and_leaves_no_file(tmp_path: Path) -> None:
    source = LawSource(pc.neural_law("sand", "pcnclaws_paper", 4), None)
    with pytest.raises(pc.UserError, match="format=cpp: the law PaperPlasticNet has no kernel") as refused:
        write_header(source, tmp_path / "x.hpp")
    assert "\n" not in str(refused.value)
    assert not list(tmp_path.iterdir())


class Rounded(pc.Elasticity):
    """A law whose coefficients are made by what no C++ is made of."""

    physical_parameters = FixedCorotated.physical_parameters

    def coefficients(self, parameters: Any) -> Any:
        return {"mu": torch.round(parameters["youngs_modulus"])}

    def principal_stress(self, h: Any, p: Any) -> Any:
        return [p.mu * strain for strain in h]


def test_an_operation_that_no_header_is_made_of_is_named() -> None:
    own = pc.Material("rounded", Rounded, None, {"youngs_modulus": (1e5, 2e5), "poissons_ratio": (0.1, 0.3)})
    with pytest.raises(pc.UserError, match="the law Rounded: its coefficients use 'round' of PyTorch"):
        header_text(pc.analytic_law(own), "x")
