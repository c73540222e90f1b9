"""Constitutive models of a program: particle-first, differentiable, in the precision of what they are given."""

from typing import Any, ClassVar

import pytest
import torch
from torch.autograd import gradcheck

import pcnclaws as pc
from pcnclaws.compiled.backend import using_backend
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.parameters import YOUNGS_MODULUS

SAND: dict[str, Any] = {"youngs_modulus": 3e5, "poissons_ratio": 0.3, "friction_angle": 30.0}


def deformations(*shape: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    random = torch.Generator().manual_seed(0)
    return torch.eye(3, dtype=dtype) + 0.05 * torch.randn(*shape, 3, 3, dtype=dtype, generator=random)


@pytest.fixture(scope="module")
def sand() -> pc.ConstitutiveModel:
    return pc.load_law("sand")


def test_what_a_law_says_of_itself(sand):
    assert sand.material is MATERIALS["sand"]
    assert sand.parameter_names == ("youngs_modulus", "poissons_ratio", "friction_angle")
    assert sand.internal_names == ()
    assert sand.ranges["friction_angle"][0] >= 18.0
    assert pc.analytic_law("sand").ranges == MATERIALS["sand"].ranges
    assert not any(weight.requires_grad for weight in sand.parameters())


@pytest.mark.parametrize("material", ["sand", "plasticine", "elasticity", "tresca"])
def test_the_analytic_law_particle_first(material):
    law, laws, given = pc.analytic_law(material), analytic_laws(MATERIALS[material]), deformations(4, 5)
    values: dict[str, Any] = MATERIALS[material].defaults
    flat = given.reshape(20, 3, 3).permute(1, 2, 0)
    each = {name: torch.full((20,), value, dtype=torch.float64) for name, value in values.items()}
    stress = law.stress(given, **values)
    assert stress.shape == given.shape
    torch.testing.assert_close(stress.reshape(20, 3, 3).permute(1, 2, 0), laws.elasticity(flat, each))
    elastic = law.return_map(given, **values)
    expected = flat if laws.plasticity is None else laws.plasticity(flat, each)
    torch.testing.assert_close(elastic.reshape(20, 3, 3).permute(1, 2, 0), expected)


def test_numbers_tensors_and_values_of_each_particle_are_the_same(sand):
    given = deformations(2, 3)
    once = sand.stress(given, **SAND)
    each = {name: torch.full((2, 3), value, dtype=torch.float64) for name, value in SAND.items()}
    torch.testing.assert_close(sand.stress(given, **each), once, rtol=0, atol=0)
    one = {name: torch.tensor([value], dtype=torch.float64) for name, value in SAND.items()}
    torch.testing.assert_close(sand.stress(given, **one), once, rtol=0, atol=0)
    torch.testing.assert_close(sand.stress(given[0, 0], **SAND), once[0, 0])


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_precision_in_is_precision_out(sand, dtype):
    for law in (sand, pc.analytic_law("sand")):
        given = deformations(6, dtype=dtype)
        assert law.stress(given, **SAND).dtype == law.return_map(given, **SAND).dtype == dtype
    assert next(sand.parameters()).dtype == torch.float32


@pytest.mark.parametrize("part", ["stress", "return_map"])
def test_derivatives_reach_deformation_parameters_and_weights(sand, part):
    given = deformations(3).requires_grad_()
    ratio = torch.tensor(0.3, dtype=torch.float64, requires_grad=True)
    angle = torch.full((3,), 30.0, dtype=torch.float64, requires_grad=True)

    def answer(deformation: torch.Tensor, ratio: torch.Tensor, angle: torch.Tensor) -> torch.Tensor:
        values = {"youngs_modulus": 3e5, "poissons_ratio": ratio, "friction_angle": angle}
        return getattr(sand, part)(deformation, **values) * (1e-5 if part == "stress" else 1.0)

    if part == "return_map":
        assert gradcheck(answer, (given, ratio, angle), eps=1e-7, atol=1e-5)
    else:
        assert gradcheck(lambda f, nu: answer(f, nu, angle.detach()), (given, ratio), eps=1e-7, atol=1e-5)
    law = pc.load_law("sand").requires_grad_()
    getattr(law, part)(given.detach(), **SAND).sum().backward()
    assert any(float(weight.grad.abs().max()) > 0 for weight in law.parameters() if weight.grad is not None)


WRONG = {
    "misspelt": (lambda law: law.stress(deformations(2), **SAND, friction_angel=3.0), "did you mean 'friction_angle'"),
    "missing": (lambda law: law.stress(deformations(2), youngs_modulus=1e5), "parameters.poissons_ratio is missing"),
    "range": (lambda law: law.stress(deformations(2), **{**SAND, "poissons_ratio": 0.5}), "below 0.5"),
    "one of many": (
        lambda law: law.stress(deformations(2), **{**SAND, "friction_angle": torch.tensor([30.0, -5.0])}),
        "friction_angle=-5.0",
    ),
    "count": (lambda law: law.stress(deformations(2), **{**SAND, "friction_angle": torch.ones(3)}), "(3,)"),
    "shape": (lambda law: law.stress(torch.zeros(3, 2), **SAND), "accepted: a tensor (..., 3, 3)"),
    "half": (lambda law: law.stress(torch.eye(3).half(), **SAND), "torch.float16"),
    "inside out": (lambda law: law.return_map(-deformations(2), **SAND), "F of particle 0 has the determinant -"),
    "nan": (lambda law: law.return_map(deformations(2) * float("nan"), **SAND), "determinant nan"),
}


@pytest.mark.parametrize("case", list(WRONG))
def test_wrong_input_is_refused_in_one_line(sand, case):
    ask, message = WRONG[case]
    with pytest.raises(pc.UserError) as caught:
        ask(sand)
    assert message in str(caught.value)


def test_laws_that_are_not_there_are_refused(tmp_path):
    with pytest.raises(pc.UserError, match=r"law='snad' is not known.*did you mean 'sand'.*run folder"):
        pc.load_law("snad")
    with pytest.raises(pc.UserError, match="material='snad' is not known"):
        pc.analytic_law("snad")
    with pytest.raises(pc.UserError, match="no weights ship for tresca"):
        pc.load_law("tresca")
    with pytest.raises(pc.UserError, match=r"config.yaml is missing"):
        pc.load_law(tmp_path)


class Rubber(pc.Elasticity):
    """tau_i = E h_i."""

    physical_parameters: ClassVar = (
        YOUNGS_MODULUS,
        pc.Parameter("softening", "s", "-", upper=1.0, lower_included=True),
    )

    def principal_stress(self, h, p):
        return [p.youngs_modulus * strain * (1.0 - p.softening * strain) for strain in h]


def test_a_material_of_ones_own_need_not_be_registered():
    ranges = {"youngs_modulus": (1e5, 2e5), "softening": (0.0, 0.5)}
    law = pc.analytic_law(pc.Material("rubber", Rubber, None, ranges))
    stretch = torch.diag(torch.tensor((1.1, 1.0, 0.9), dtype=torch.float64))
    with using_backend("torch"):  # no kernel for one answer
        stress = law.stress(stretch, youngs_modulus=1e5, softening=0.1)
    h = stretch.diagonal().log()
    torch.testing.assert_close(stress, torch.diag(1e5 * h * (1.0 - 0.1 * h)))
    with pytest.raises(pc.UserError, match="parameters.softening=1.5 is not accepted"):
        law.stress(stretch, youngs_modulus=1e5, softening=1.5)
