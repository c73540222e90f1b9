"""Laws, a parameter and a material that somebody brings: one file, and everything works with them."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from bodies import per_particle, seeded, uniform
from law_checks import COUNT, deformations

import pcnclaws as pc
from benchmarks.own_material import COHESION, SOIL, CohesiveDruckerPrager, MooneyRivlin
from pcnclaws.compiled.backend import using_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.errors import UserError
from pcnclaws.laws.base import Elasticity, Plasticity, Values
from pcnclaws.laws.elasticity import NeoHookean
from pcnclaws.laws.materials import Kind, Material, material_named
from pcnclaws.laws.operations import sum_of_squares, trace
from pcnclaws.laws.parameters import YOUNGS_MODULUS, Parameter, compression_wave_speed
from pcnclaws.laws.registry import Network, register
from pcnclaws.simulate import simulate
from pcnclaws.simulation.time_step import p_wave_modulus
from pcnclaws.tensors.linalg3 import matmul, transpose

COMPILED = pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler")


def _parameters() -> dict[str, torch.Tensor]:
    return per_particle(SOIL.defaults, COUNT)


@COMPILED
@pytest.mark.parametrize("law", [MooneyRivlin(), CohesiveDruckerPrager()], ids=["elastic", "plastic"])
def test_kernels_are_made_of_the_python_function(law: Elasticity | Plasticity) -> None:
    assert law.kernel is not None
    f, found = deformations(1, 0.1), []
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            inputs = [f.clone().requires_grad_(), *(v.clone().requires_grad_() for v in _parameters().values())]
            values = dict(zip(_parameters(), inputs[1:], strict=True))
            result = law(inputs[0], {name: values[name] for name in law.parameter_names})
            weight = uniform(seeded(4), *result.shape)
            found.append([result.detach(), *torch.autograd.grad(result, inputs, weight, materialize_grads=True)])
    for a, b in zip(*found, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-9, atol=1e-9 * float(b.abs().max()))


def test_the_stress_is_the_derivative_of_the_energy() -> None:
    """tau : D is the rate of the energy: dE along dF = D F."""
    law, f, rate = MooneyRivlin(), deformations(2, 0.2), uniform(seeded(3), 3, 3, COUNT)
    rate = 0.5 * (rate + transpose(rate))
    names = {name: value for name, value in _parameters().items() if name in law.parameter_names}
    step = 1e-6
    ahead, behind = (law.energy_density(f + s * step * matmul(rate, f), names) for s in (1.0, -1.0))
    power = (law.kirchhoff_stress(f, names) * rate).sum((0, 1))
    torch.testing.assert_close((ahead - behind) / (2.0 * step), power, rtol=1e-7, atol=1e-3)


def test_small_strain_has_the_moduli() -> None:
    names = {name: value for name, value in _parameters().items() if name != "cohesion" and name != "friction_angle"}
    f = deformations(5, 1e-6)
    stress, known = MooneyRivlin()(f, names), NeoHookean()(f, names)
    torch.testing.assert_close(stress, known, rtol=1e-4, atol=1e-5 * float(known.abs().max()))


class Branching(Elasticity):
    """A law that no kernel can be made of."""

    physical_parameters = (YOUNGS_MODULUS,)

    def principal_stress(self, h: Values, p: object) -> Values:
        return [p.youngs_modulus * torch.sin(strain) for strain in h]  # pyright: ignore[reportAttributeAccessIssue]


def test_what_cannot_become_a_kernel_runs_in_pytorch_and_says_so(caplog: pytest.LogCaptureFixture) -> None:
    f, law = deformations(1, 0.1), Branching()
    stress = law(f, {"youngs_modulus": torch.full((COUNT,), 1e5).double()})
    assert law.kernel is None
    assert torch.isfinite(stress).all()
    assert "the law Branching runs in PyTorch, without a kernel" in caplog.text


def test_a_law_that_branches_or_misspells_is_refused_in_one_line() -> None:
    f, given = deformations(1, 0.1), {"youngs_modulus": torch.full((COUNT,), 1e5).double()}

    class Deciding(Branching):
        def principal_stress(self, h: Values, p: Any) -> Values:
            return [p.youngs_modulus * strain if strain > 0.0 else strain for strain in h]

    class Misspelt(Branching):
        def principal_stress(self, h: Values, p: Any) -> Values:
            return [p.young_modulus * strain for strain in h]

    class Undeclared(Branching):
        def coefficients(self, parameters: Any) -> Any:
            return {"mu": parameters["shear_modulus"]}

    with pytest.raises(UserError, match=r"the law Deciding cannot run: it branches on a number; accepted: where"):
        Deciding()(f, given)
    with pytest.raises(
        UserError, match=r"the law Misspelt: p='young_modulus' is not known.*did you mean 'youngs_modulus'"
    ):
        Misspelt()(f, given)
    with pytest.raises(
        UserError, match=r"the law Undeclared: parameter='shear_modulus' is not known; accepted: youngs"
    ):
        Undeclared()(f, given)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"elastic": None}, "elastic=None is not accepted; accepted: a class of Elasticity"),
        ({"elastic": CohesiveDruckerPrager}, "accepted: a class of Elasticity"),
        ({"plastic": CohesiveDruckerPrager()}, "accepted: a class of Plasticity, or None"),
        ({"ranges": {**SOIL.ranges, "cohesoin": (1.0, 2.0)}}, "did you mean 'cohesion'"),
        ({"ranges": {**SOIL.ranges, "cohesion": (2.0, 1.0)}}, "accepted: two numbers, increasing"),
        (
            {"kinds": (Kind({}, SOIL.defaults), Kind(SOIL.ranges, {"cohesoin": 1.0}))},
            "kinds.1. does not fit in cohesoin",
        ),
        ({"density": 0.0}, "density=0.0 is not accepted; accepted: a positive number"),
        ({"density": float("nan")}, "density=nan is not accepted; accepted: a positive number"),
        ({"elastic": Elasticity, "plastic": None}, "its laws name no physical_parameters"),
    ],
)
def test_a_material_that_is_none_is_refused_in_one_line(change: dict[str, Any], fault: str) -> None:
    with pytest.raises(UserError, match=fault):
        pc.analytic_law(replace(SOIL, **change))


def test_a_body_is_as_heavy_as_its_material_unless_settings_or_particles_say_otherwise() -> None:
    """Four times the density halves the speed of sound, sqrt(E / rho), and so doubles the stable time step."""
    heavy = pc.analytic_law(replace(material_named("elasticity"), name="heavy_elasticity", density=4000.0))
    cube = pc.Body.cube(side=0.2, centre=(0.5, 0.5, 0.5), particles_per_edge=3)
    afloat = pc.Settings(gravity=(0, 0, 0))
    scene = pc.Scene(cube, heavy, settings=afloat)
    plain = pc.Scene(cube, pc.analytic_law("elasticity"), settings=afloat)
    assert scene.stable_time_step == pytest.approx(2.0 * plain.stable_time_step, rel=0.05)
    motion, of_settings = scene.simulate(2, 2), scene.with_(settings=pc.Settings(density=500.0)).simulate(2, 2)
    assert motion.record.settings.density == 4000.0
    assert of_settings.record.settings.density == 500.0
    grains = pc.Body.points(cube.position, cube.volume, density=700.0)
    start = pc.Scene(grains, heavy)._start
    assert start.density is not None
    assert start.density.tolist() == [700.0] * 27
    with pytest.raises(UserError, match="simulation.density=500 has no effect on particles that bring their density"):
        pc.Scene(grains, heavy, settings=pc.Settings(density=500.0))


def test_the_cohesive_law_bears_tension_and_no_more() -> None:
    h = torch.eye(3).double()[:, :, None] * torch.tensor([1e-5, 1.0]).double()
    f = torch.diag_embed(h.diagonal(dim1=0, dim2=1).exp()).permute(1, 2, 0)
    parameters = per_particle(SOIL.defaults, 2)
    after = CohesiveDruckerPrager()(f, parameters)
    assert torch.equal(after[:, :, 0], f[:, :, 0]), "below the tip nothing flows"
    tip = CohesiveDruckerPrager().coefficients(parameters)["tip"]
    torch.testing.assert_close(3.0 * after[0, 0, 1].log(), tip[1])


SHEAR = Parameter("shear_modulus", "G", "Pa", logarithmic=True, search=(1e2, 1e9))


class OneModulus(Elasticity):
    """Hencky elasticity with lambda = mu, stated by its shear modulus alone."""

    physical_parameters = (SHEAR,)

    def principal_energy(self, h: Values, p: Any) -> Any:
        return p.shear_modulus * (sum_of_squares(h) + 0.5 * trace(h) ** 2)


@pytest.mark.usefixtures("own_registry")
def test_a_law_with_moduli_of_its_own_has_its_wave_speed() -> None:
    material = Material("one_modulus", OneModulus, None, {"shear_modulus": (1e4, 1e5)})
    register(material)
    assert p_wave_modulus(material_named("one_modulus"), {"shear_modulus": 2e4}) == pytest.approx(
        6e4, rel=1e-12
    )  # lambda + 2 mu
    hooke = {"youngs_modulus": 1e5, "poissons_ratio": 0.3}
    assert p_wave_modulus(material_named("elasticity"), hooke) == pytest.approx(
        1000.0 * compression_wave_speed(1e5, 0.3, 1000.0) ** 2
    )
    scene = pc.Scene(pc.Body.cube(side=0.2, particles_per_edge=4), pc.analytic_law(material), shear_modulus=2e4)
    assert scene.cfl > 0.0
    assert torch.isfinite(scene.simulate(steps=10, every=5).position).all()
    with pytest.raises(UserError, match=r"simulation.time_step=0.1 is unstable; accepted: at most .* s at"):
        scene.with_(settings=pc.Settings(time_step=0.1)).simulate(steps=10, every=5)


@pytest.mark.usefixtures("own_registry")
def test_a_cell_of_a_notebook_that_is_run_again_replaces_what_it_registered() -> None:
    def cell(factor: float, parameter: Parameter) -> Material:
        class Mine(Elasticity):
            physical_parameters = (parameter,)

            def principal_energy(self, h: Values, p: Any) -> Any:
                return factor * p.shear_modulus * sum_of_squares(h)

        return Material("mine", Mine, None, {"shear_modulus": (1e4, factor * 1e5)})

    for factor in (1.0, 2.0):
        register(cell(factor, replace(SHEAR, glyph="G" * int(factor))))
        with using_backend("torch"):
            stress = pc.analytic_law("mine").stress(1.1 * torch.eye(3)[None].double(), shear_modulus=2e4)
        assert float(stress[0, 0, 0]) == pytest.approx(factor * 4e4 * math.log(1.1))
    with pytest.raises(UserError, match="material 'mine' is there already"):
        register(Material("mine", OneModulus, None, {"shear_modulus": (1e4, 1e5)}))
    taken = cell(1.0, Parameter("youngs_modulus", "E", "kPa"))
    with pytest.raises(UserError, match="parameter 'youngs_modulus' is there already"):
        register(replace(taken, name="other", ranges={"youngs_modulus": (1.0, 2.0)}))


PLUGIN = """
import sys
sys.path.insert(0, {folder!r})
from benchmarks import own_material
from pcnclaws.laws.registry import register
register(own_material.SOIL)
"""


@pytest.mark.usefixtures("own_registry")
def test_a_command_takes_a_material_from_a_plugin(
    in_process: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "soil_plugin.py").write_text(PLUGIN.format(folder=str(Path(__file__).parents[2])))
    small = ("law=analytic", "scene.particles_per_edge=4", "simulation.steps=20", "picture=false")
    done = in_process(
        simulate,
        "simulate",
        "plugins=[soil_plugin]",
        "material=cohesive_soil",
        "parameters.cohesion=2e3",
        *small,
        "output=x.h5",
    )
    assert done.status == 0, done.err  # pyright: ignore[reportAttributeAccessIssue]
    record = read_scenes(tmp_path / "x.h5")[0]
    assert (record.material, record.parameters["cohesion"]) == ("cohesive_soil", 2e3)
    wrong = in_process(
        simulate,
        "simulate",
        "plugins=[soil_plugin]",
        "material=cohesive_soil",
        "parameters.cohesion=-1",
        *small,
        "output=y.h5",
    )
    assert wrong.status == 2  # pyright: ignore[reportAttributeAccessIssue]
    assert "parameters.cohesion=-1.0 is not accepted; accepted: a finite number at least 0 Pa" in wrong.err  # pyright: ignore[reportAttributeAccessIssue]
    missing = in_process(simulate, "simulate", "plugins=[no_such_module]", *small, "output=z.h5")
    assert missing.status == 2  # pyright: ignore[reportAttributeAccessIssue]
    assert "plugins=no_such_module cannot be imported" in missing.err  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(
    ("thing", "words"),
    [
        (Material("sand", NeoHookean, None, {}), "material 'sand' is there already"),
        (Material("m", NeoHookean, None, {"youngs_modulus": (1e4, 1e5)}), r"ranges\['poissons_ratio'\] is missing"),
        (
            Material("m", NeoHookean, None, {"youngs_modulus": (1e4, 1e5), "poissons_ratio": (0.4, 0.6)}),
            r"ranges\['poissons_ratio'\]=\(0.4, 0.6\) is not accepted",
        ),
        (
            Material("m", NeoHookean, None, {"youngs_modulus": (1e4, 1e5), "poisons_ratio": (0.1, 0.2)}),
            r"ranges\['poissons_ratio'\] is missing",
        ),
        (Network("pcnclaws", NeoHookean, None), "network 'pcnclaws' is there already"),
    ],
)
def test_what_cannot_be_registered_is_refused(thing: Material | Network, words: str) -> None:
    with pytest.raises(UserError, match=words):
        register(thing)


def test_a_parameter_says_what_it_accepts_and_how_it_is_shown() -> None:
    assert COHESION.header == "c [Pa]"
    assert COHESION.shown(1500.0) == "c 1.5e+03 Pa"
    with pytest.raises(UserError, match="search=\\(-1.0, 2.0\\) is not accepted"):
        Parameter("x", "x", "Pa", logarithmic=True, search=(-1.0, 2.0))
    assert not COHESION.accepts(float("nan"))
    assert np.isclose(SOIL.defaults["cohesion"], 2750.0)
    assert json.dumps(SOIL.defaults)
