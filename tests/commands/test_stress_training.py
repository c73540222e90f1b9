"""python -m pcnclaws.train data.stress=FILE: a law from measured stress, that other commands take, or one line."""

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest
import torch
from conftest import Outcome

import pcnclaws as pc
from pcnclaws.compiled.backend import using_backend
from pcnclaws.guards import WORDS
from pcnclaws.simulate import simulate
from pcnclaws.train import train

MEASURED = Path(__file__).parents[2] / "docs" / "measured"
FOAM = f"data.stress=[{MEASURED}/foam/foam_leap_UT.csv,{MEASURED}/foam/foam_leap_UC.csv]"
MODEL = ("material=elasticity", "model=pcnclaws_stretches", "model.width=4")


def test_a_foam_is_one_command_and_its_law_is_simulated(in_process: Callable[..., Outcome], tmp_path: Path) -> None:
    options = ("experiment=measured_foam", FOAM, "stress.iterations=25", "output=foam", 'stress.weights=["*_UC: 2"]')
    done = in_process(train, "train", *options)
    assert (done.status, done.err) == (0, "")
    assert "wrote foam/stress.png" in done.out
    metrics = json.loads((tmp_path / "foam" / "metrics.json").read_text())
    assert metrics["guards"].keys() == WORDS.keys()
    assert metrics["largest_relative_RMS_trained"] < 0.05
    assert [path["name"] for path in metrics["paths"]] == ["foam_leap_UT", "foam_leap_UC"]
    curve = metrics["paths"][0]["curves"][0]
    (specimen,) = metrics["specimens"]
    known = {"youngs_modulus": specimen["youngs_modulus"], "poissons_ratio": 0.0}
    stretched = torch.diag(torch.tensor([curve["at"][-1], 1.0, 1.0]))
    with using_backend("torch"):
        stress = float(pc.load_law("foam").stress(stretched, **known)[0, 0]) / curve["at"][-1]
    assert stress == pytest.approx(curve["predicted"][-1], rel=1e-3)
    again = in_process(train, "train", *options)
    assert "foam holds this run, finished" in again.out

    parameters = [f"parameters.{name}={value}" for name, value in known.items()]
    scene = ("scene.side=0.3", "scene.particles_per_edge=3", "simulation.backend=torch", "simulation.steps=20")
    dropped = in_process(simulate, "simulate", "material=elasticity", "law=foam", *parameters, *scene, "output=x.h5")
    assert (dropped.status, "used outside" in dropped.err) == (0, False), dropped.err


def test_each_specimen_has_a_run_folder_of_its_own(in_process: Callable[..., Outcome], tmp_path: Path) -> None:
    with h5py.File(MEASURED / "rubber" / "hyperelastic.h5") as all_of_them, h5py.File("two.h5", "w") as two:
        for study in ("Kawabata_1981", "Meunier_2008"):
            all_of_them.copy(study, two)
    options = (*MODEL, "data.stress=two.h5", 'stress.units=["*: MPa"]', "stress.iterations=25", "picture=false")
    done = in_process(train, "train", *options, "stress.leave_out=[Kawabata_1981/PS]", "output=run")
    assert (done.status, done.err) == (0, "")
    assert "det F = 1 at every point: the bodies are taken as incompressible" in done.out
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert [path["trained"] for path in metrics["paths"]] == [False, True, True, True]
    assert [one["folder"] for one in metrics["specimens"]] == ["specimens/Kawabata_1981", "specimens/Meunier_2008"]
    assert metrics["largest_relative_RMS_trained"] < 0.05
    laws = [pc.load_law(f"run/specimens/{name}") for name in ("Kawabata_1981", "Meunier_2008")]
    first, second = (dict(law.elasticity.named_parameters()) for law in laws)
    assert all(torch.equal(first[name], second[name]) for name in first if name.startswith("amounts"))
    assert not torch.equal(first["scale"], second["scale"])
    assert laws[0].ranges["poissons_ratio"] == (0.4, 0.5)


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (
            ("material=elasticity", FOAM),
            "model=pcnclaws and material=elasticity is not accepted; accepted",
        ),
        ((*MODEL, "data.stress=none.csv"), "data.stress=none.csv: no such file"),
        (
            (*MODEL, "data.stress=3"),
            "data.stress=3 is not accepted; accepted: the path of a CSV or HDF5",
        ),
        ((*MODEL, FOAM, "training.iterations=3"), "training.iterations=3 has no effect beside data.stress"),
        (("stress.leave_out=[x]",), "stress.leave_out=['x'] has no effect without data.stress"),
        ((*MODEL, FOAM, "stress.leave_out=[UT]"), "stress.leave_out: no path is called 'UT'; accepted: foam_leap_UT"),
        ((*MODEL, FOAM, 'stress.leave_out=["*"]'), "stress.leave_out leaves no path to train on"),
        ((*MODEL, FOAM, 'stress.weights=["*: -1"]'), "stress.weights: factor '-1' is not accepted"),
        ((*MODEL, FOAM, 'stress.weights=["*"]'), "accepted: a list of 'PATTERN: VALUE'"),
        ((*MODEL, FOAM, 'stress.reference=["*: 4"]'), "stress.reference: side '4' is not known; accepted: 1, 2, 3"),
        (
            (*MODEL, FOAM, "stress.poissons_ratio=0.6"),
            "stress.poissons_ratio=0.6 is not accepted; accepted: null",
        ),
        (
            (*MODEL, f"data.stress={MEASURED}/rubber/hyperelastic.h5"),
            "no @unit of the stress; accepted: Pa, kPa, MPa or GPa there, or in stress.units",
        ),
    ],
)
def test_wrong_input_is_one_line(in_process: Callable[..., Outcome], options: tuple[str, ...], fault: str) -> None:
    done = in_process(train, "train", *options, "output=run")
    assert done.status == 2
    assert fault in done.err
    assert len(done.err.strip().splitlines()) == 1
    assert not Path("run/config.yaml").exists()
