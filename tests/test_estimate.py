"""The estimate command: what it finds, what it leaves, and what it refuses."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from observed_bodies import TRUTH, start
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from pcnclaws.data.hdf5 import read_scenes, write_scenes
from pcnclaws.estimate import estimate
from pcnclaws.estimation.inverse import InverseModule
from pcnclaws.guards import WORDS
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.observe import observe
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")


@pytest.fixture(scope="module")
def record() -> SceneRecord:
    return simulate_records([start("elasticity")], analytic_laws(MATERIALS["elasticity"]), FramePlan(100, 5))[0]


@pytest.fixture
def estimated(in_process, record, tmp_path: Path):
    """Runs the command on an elastic cube with the analytic law."""
    write_scenes(tmp_path / "x.h5", [record])

    def run(*arguments: str):
        given = ["material=elasticity", "law=analytic", "observation.file=x.h5", "output=new/e.json", "screening=4"]
        return in_process(estimate, "estimate", *given, *arguments)

    return run


def test_it_finds_the_truth_and_leaves_a_table_a_file_pictures_and_the_motion(estimated, tmp_path, caplog) -> None:
    outcome = estimated("initial_guess.youngs_modulus=4e4", "initial_guess.poissons_ratio=0.5")
    assert outcome.status == 0, outcome.err
    assert "initial_guess.poissons_ratio=0.5 is at the edge" in caplog.text
    found = json.loads((tmp_path / "new" / "e.json").read_text())
    assert found["guards"].keys() == WORDS.keys()
    for name, true in TRUTH["elasticity"].items():
        one = found["parameters"][name]
        assert one["estimate"] == pytest.approx(true, rel=1e-3)
        assert one["interval_95"][0] < true < one["interval_95"][1]
        assert (one["identifiable"], one["truth"]) == (True, true)
    assert found["mse"] < 1e-12
    assert (found["fit"]["fitted"], found["verdicts"]) == (True, [])
    assert {"seconds", "history", "correlation", "noise", "law_error", "provenance"} < set(found)
    names = {path.name for path in (tmp_path / "new").iterdir()}
    assert names == {"e.json", "e_convergence.png", "e_fit.png", "e_simulated.h5", "e"}
    assert {path.name for path in (tmp_path / "new" / "e").iterdir()} == {"tensorboard", "search.yaml"}
    shown = EventAccumulator(str(tmp_path / "new" / "e" / "tensorboard")).Reload()
    for name in TRUTH["elasticity"]:
        ends = [shown.Scalars(f"interval/{name}/{end}")[-1].value for end in ("low", "high")]
        assert ends == pytest.approx(found["parameters"][name]["interval_95"], rel=1e-6)
        assert shown.Scalars(name)[-1].value == pytest.approx(found["parameters"][name]["estimate"], rel=1e-6)
    assert "estimate/text_summary" in shown.Tags()["tensors"]
    again = read_scenes(tmp_path / "new" / "e_simulated.h5")[0]
    np.testing.assert_allclose(again.parameters["youngs_modulus"], 1e5, rtol=1e-3)
    for word in ("guess", "estimate", "95 % interval", "truth", "youngs_modulus [Pa]"):
        assert word in outcome.out


def test_points_without_labels_are_seen_by_a_camera_and_explained(estimated, in_process, tmp_path: Path) -> None:
    seen = ["file=x.h5", "kind=points", "points=100", "camera=[1,1,1]", "noise=5e-4", "output=p.npz", "picture=false"]
    assert in_process(observe, "observe", *seen, "every=2").status == 0
    points = ["observation.file=p.npz", "observation.kind=points", "scene.particles=x.h5", "screening=0"]
    outcome = estimated(*points, "initial_guess.youngs_modulus=7e4", "initial_guess.poissons_ratio=0.2")
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "new" / "e.json").read_text())
    assert found["parameters"]["youngs_modulus"]["estimate"] == pytest.approx(1e5, rel=0.05)
    assert found["motion"]["surface_offset"]["unit"] == "m"
    assert (found["fit"]["fitted"], found["fit"]["scatter_from"]) == (True, "neighbouring points")
    assert (tmp_path / "new" / "e_fit.png").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["observation.kind=cloud"], "observation.kind='cloud' is not known; accepted: markers, points"),
        (["observation.kind=points"], "p.npz: points need a body; accepted: scene.shape=cube"),
        (["unknown.surface_offset=true"], "unknown.surface_offset"),
        (
            ["observation.kind=points", "scene.shape=cube", "unknown.surface_offset=maybe"],
            "accepted: true, false, auto",
        ),
        (["observation.kind=points", "scene.shape=cube", "observation.frame=fit"], "for points, which have no labels"),
    ],
)
def test_options_of_points_are_refused_in_one_line(options: list[str], message: str, estimated, tmp_path) -> None:
    np.savez(tmp_path / "p.npz", time=np.array([0.0, 0.1]), position=np.full((2, 8, 3), 0.25))
    outcome = estimated("observation.file=p.npz", *options)
    assert outcome.status == 2
    assert message in outcome.err


@pytest.mark.slow
def test_the_gradient_descent_of_the_paper_comes_near(estimated, tmp_path: Path) -> None:
    guess = ["initial_guess.youngs_modulus=7e4", "initial_guess.poissons_ratio=0.2", "screening=0", "picture=false"]
    outcome = estimated("estimator=adam", "estimator.iterations=40", *guess)
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "new" / "e.json").read_text())
    assert found["parameters"]["youngs_modulus"]["estimate"] == pytest.approx(1e5, rel=0.1)
    assert found["history"][-1]["mse"] < 0.05 * found["history"][0]["mse"]


def test_gradient_descent_halves_a_step_into_divergence(estimated, tmp_path: Path) -> None:
    guess = ["initial_guess.youngs_modulus=7e4", "initial_guess.poissons_ratio=0.2", "screening=0", "picture=false"]
    outcome = estimated("estimator=adam", "estimator.iterations=6", "estimator.learning_rate=6", *guess)
    assert outcome.status == 0, outcome.err
    history = json.loads((tmp_path / "new" / "e.json").read_text())["history"]
    assert np.isfinite([one["mse"] for one in history]).all()
    # the second one: a whole step would have been one to 20 MPa
    assert 7e4 < history[1]["values"][0] < 1.5e7


@pytest.mark.slow
def test_a_sweep_again_estimates_what_is_missing_or_has_changed(in_process, record, tmp_path: Path) -> None:
    write_scenes(tmp_path / "x.h5", [record])
    options = ("material=elasticity", "law=analytic", "observation.file=x.h5", "screening=0", "picture=false")
    options += ("trajectory=false", "initial_guess.youngs_modulus=4e4,9e4", "output=e_${initial_guess.youngs_modulus}")

    def swept(*more: str) -> tuple[int, str]:
        outcome = in_process(estimate, "estimate", "--multirun", *options, *more)
        assert outcome.status == 0, outcome.err
        return outcome.out.count("holds this estimate, finished"), outcome.out[outcome.out.index("sweep of 2 jobs") :]

    finished, table = swept()
    assert finished == 0
    assert swept() == (2, table)
    (tmp_path / "e_40000.0").unlink()
    assert swept() == (1, table)
    assert swept("overwrite=true")[0] == swept("initial_guess.poissons_ratio=0.2")[0] == 0
    write_scenes(tmp_path / "x.h5", [record])  # another recording, for all that is known
    assert swept("initial_guess.poissons_ratio=0.2")[0] == 0


def test_an_interrupted_search_goes_on_where_it_was(estimated, tmp_path: Path, monkeypatch) -> None:
    guess = ["initial_guess.youngs_modulus=4e4", "screening=0", "picture=false"]
    assert estimated(*guess, "output=whole.json").status == 0
    step, taken = InverseModule._gauss_newton, []

    def interrupted(self: InverseModule) -> None:
        if len(taken) == 3:
            raise KeyboardInterrupt
        taken.append(1)
        step(self)

    with monkeypatch.context() as patch:
        patch.setattr(InverseModule, "_gauss_newton", interrupted)
        outcome = estimated(*guess, "output=part.json")
    assert (outcome.status, outcome.err) == (1, "error: interrupted\n")
    assert not (tmp_path / "part.json").exists()
    assert (tmp_path / "part" / "checkpoints" / "last.ckpt").exists()
    assert estimated(*guess, "output=part.json").status == 0
    whole, part = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("whole", "part"))
    assert part["history"] == whole["history"]
    assert not (tmp_path / "part" / "checkpoints").exists()


def test_markers_of_a_table_with_a_noise_and_an_unknown_start(estimated, record, tmp_path: Path) -> None:
    chosen = np.arange(0, 64, 3)
    noise = 2e-4 * np.random.default_rng(1).standard_normal(record.position.shape)
    lines = ["time,marker,x,y,z"]
    for frame in range(0, len(record.time), 2):
        for marker in chosen:
            x, y, z = (record.position + (noise if frame else 0.0))[frame, marker]
            lines.append(f"{record.time[frame]:.6f},m{marker},{x:.6f},{y:.6f},{z:.6f}")
    (tmp_path / "m.csv").write_text("\n".join(lines) + "\n")
    body = ["scene.shape=cube", "scene.centre=[0.5,0.24,0.5]", "scene.side=0.2", "scene.particles_per_edge=4"]
    body += ["scene.lattice=faces"]
    outcome = estimated("observation.file=m.csv", *body)
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "new" / "e.json").read_text())
    for name, true in TRUTH["elasticity"].items():
        low, high = found["parameters"][name]["interval_95"]
        assert low < true < high
        assert high - low < 0.3 * true
    assert found["motion"]["velocity_y"]["estimate"] == pytest.approx(-2.0, abs=0.02)
    assert found["noise"] == pytest.approx(2e-4, rel=0.2)
    assert found["fit"]["scatter"] == pytest.approx(2e-4, rel=0.2)
    assert found["fit"]["fitted"] is True


@pytest.mark.slow
def test_a_discrepancy_gives_intervals_where_the_motion_is_not_fitted_and_changes_nothing_where_it_is(
    estimated, record, tmp_path: Path
) -> None:
    noise = 5e-4 * np.random.default_rng(1).standard_normal(record.position.shape).astype(np.float32)
    noise[0] = 0.0
    short = ["screening=0", "estimator.iterations=3", "trajectory=false", "picture=false", "overwrite=true"]

    def result(seen: SceneRecord, *options: str) -> dict[str, Any]:
        write_scenes(tmp_path / "x.h5", [seen])
        outcome = estimated(*short, *options)
        assert outcome.status == 0, outcome.err
        return json.loads((tmp_path / "new" / "e.json").read_text())

    right = replace(record, position=record.position + noise)
    assert result(right)["parameters"] == result(right, "discrepancy=true")["parameters"]
    wrong = result(replace(right, time=2.0 * record.time), "discrepancy=true")
    assert "not_fitted" in wrong["verdicts"]
    assert any("the intervals take it for an error of the model of" in line for line in wrong["verdicts"])
    assert wrong["fit"]["discrepancy"]["size"] > 1e-3
    assert wrong["motion"] == {}
    held = [one["interval_95"] for one in wrong["parameters"].values() if one["identifiable"]]
    assert all(low < high for low, high in held)


def test_a_motion_that_is_not_fitted_has_a_verdict_and_no_interval(estimated, record, tmp_path: Path) -> None:
    noise = 5e-4 * np.random.default_rng(1).standard_normal(record.position.shape).astype(np.float32)
    noise[0] = 0.0
    wrong = replace(record, position=record.position + noise, time=2.0 * record.time)
    write_scenes(tmp_path / "x.h5", [wrong])
    outcome = estimated("screening=0", "estimator.iterations=3", "trajectory=false")
    assert outcome.status == 0, outcome.err
    lines = outcome.out.replace("\n", " ")
    assert "the motion is not fitted: residual" in lines
    assert "the positions scatter by at most 0.5" in lines
    assert "usual causes: axes (y is up), frame rate" in lines
    found = json.loads((tmp_path / "new" / "e.json").read_text())
    assert "not_fitted" in found["verdicts"]
    assert any(line.startswith("the motion is not fitted: ") for line in found["verdicts"])
    assert found["fit"]["fitted"] is False
    assert found["fit"]["scatter"] == pytest.approx(5e-4, rel=0.15)
    assert found["fit"]["residual"] > 10.0 * found["fit"]["scatter"]
    for one in found["parameters"].values():
        assert (one["interval_95"], one["identifiable"]) == (None, False)
    assert {path.name for path in (tmp_path / "new").iterdir()} >= {"e_convergence.png", "e_fit.png"}


def test_free_flight_gives_no_number(estimated, tmp_path: Path) -> None:
    rising = start("elasticity", velocity=(0.0, 2.0, 0.0))
    write_scenes(
        tmp_path / "x.h5", simulate_records([rising], analytic_laws(MATERIALS["elasticity"]), FramePlan(40, 5))
    )
    outcome = estimated()
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "new" / "e.json").read_text())
    assert all(one["estimate"] is None and not one["identifiable"] for one in found["parameters"].values())
    assert "youngs_modulus cannot be told from this motion" in outcome.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["observation.file=null"], "observation.file=null is not accepted"),
        (["observation.file=y.h5"], "y.h5: no such file"),
        (["observation.scene=b"], "scene='b' is not known"),
        (["observation.window=[3,4]"], "observation.window=[3, 4] holds no observed position"),
        (["simulation.time_step=auto"], "simulation.time_step=auto is not accepted here; accepted: a positive"),
        (["observation.window=3"], "observation.window=3 is not accepted"),
        (["material=sand"], "observed of material 'elasticity'; accepted: sand"),
        (["initial_guess.youngs_modulus=-1"], "initial_guess.youngs_modulus=-1 is not accepted"),
        (["initial_guess.friction_angle=30"], "option='initial_guess.friction_angle' is not known"),
        (["fixed.poissons_ratio=0.7"], "fixed.poissons_ratio=0.7 is not accepted"),
        (["fixed.poissons_ratio=0.3", "fixed.youngs_modulus=1e5"], "leaves nothing to estimate"),
        (["estimator=newton"], "did you mean"),
        (["vary=w"], "vary='w' is not known"),
        (["unknown.motion=perhaps"], "unknown.motion=perhaps is not accepted"),
        (["scene.shape=cube", "scene.side=0.05"], "from the body; accepted: at most one grid cell"),
        (["output=x.h5"], "is the file of observation.file"),
        (["unknown.walls=true", "estimator=adam"], "unknown.walls=true is not accepted with estimator=adam; accepted"),
        (["unknown.friction=true", "simulation.boundary=slip"], "unknown.friction=true is not accepted with boundary"),
        (
            ["unknown.gravity=true", "simulation.gravity=[0,0,0]"],
            "unknown.gravity=true is not accepted without gravity",
        ),
        (["discrepancy=true", "observation.kind=points", "scene.shape=cube"], "discrepancy=true is not accepted with"),
        (["unknown.size=true"], "unknown.size=true needs markers on a body; accepted: scene.shape=cube, ..."),
        (["uncertainty=profiles"], "uncertainty='profiles' is not known; accepted: linear, profile, sample"),
        (
            ["uncertainty=profile", "refinements=[2,3]", "scene.shape=cube"],
            "uncertainty=profile is not accepted with refinements; accepted: uncertainty=linear",
        ),
        (["uncertainty=sample", "samples=10"], "samples=10 is not accepted; accepted: a whole number from 100"),
        (["refinements=2"], "refinements=2 is not accepted; accepted: numbers above 1 that increase"),
        (["refinements=[2,1.5]"], "refinements=[2, 1.5] is not accepted; accepted: numbers above 1 that increase"),
        (["refinements=[2]"], "refinements=[2] is not accepted with the particles of a file"),
        (["refinements=[2]", "estimator=adam"], "refinements=[2] is not accepted with estimator=adam"),
        (
            ["refinements=[1.77]", "scene.shape=cube", "scene.side=0.2", "scene.centre=[0.5,0.24,0.5]"],
            "refinements=[1.77]: ",
        ),
        (["device=gpu"], "device='gpu' is not known; accepted: auto, cpu, cuda"),
        (["observation.noise=0"], "observation.noise=0 is not accepted; accepted: above 0"),
        (["observation.noise=true"], "observation.noise=True is not accepted"),
        (["screening=-1"], "screening=-1 is not accepted"),
    ],
)
def test_wrong_input_is_one_line_exit_2_and_no_result(arguments: list[str], message: str, estimated, tmp_path) -> None:
    outcome = estimated(*arguments)
    assert outcome.status == 2, outcome.err
    assert message in outcome.err
    assert len(outcome.err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["x.h5"]


@pytest.mark.slow
def test_finer_grids_find_the_spacing_of_the_motion(estimated, tmp_path) -> None:
    """Of a cube with particles on its faces, which weighs as if it were a third larger; x and z meet no wall."""
    body = ["scene.shape=cube", "scene.centre=[0.5,0.24,0.5]", "scene.side=0.2", "scene.particles_per_edge=6"]
    outcome = estimated(*body, "unknown.walls=true", "unknown.size=true", "discrepancy=true", "refinements=[1.5,2]")
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "new" / "e.json").read_text())
    spacing = found["motion"]["grid_spacing"]
    assert spacing["identifiable"]
    assert spacing["estimate"] == pytest.approx(0.05, rel=0.25)
    assert found["motion"]["size"]["estimate"] == pytest.approx(1.0 / 3.0, abs=0.1)
    assert len(found["history"]) == found["iterations"] + 1 + 3
    assert read_scenes(tmp_path / "new" / "e_simulated.h5")[0].settings.grid_spacing == pytest.approx(0.025)


@pytest.mark.slow
def test_two_bodies_of_different_stiffness_are_told_at_once(estimated, tmp_path) -> None:
    one = start("elasticity")
    apart = np.concatenate((one.position - np.array((0.2, 0.0, 0.0)), one.position + np.array((0.2, 0.02, 0.0))))
    both = replace(
        one,
        position=apart,
        velocity=np.tile(one.velocity, (2, 1)),
        volume=np.tile(one.volume, 2),
        varying={"youngs_modulus": np.repeat((1e5, 1.5e5), len(one.position))},
    )
    recorded = simulate_records([both], analytic_laws(MATERIALS["elasticity"]), FramePlan(100, 5))
    assert set(recorded[0].parameters) == {"poissons_ratio"}  # a record has one value of each
    write_scenes(tmp_path / "x.h5", recorded)
    outcome = estimated("vary=bodies", "initial_guess.youngs_modulus=8e4")
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "new" / "e.json").read_text())["parameters"]
    assert [found[f"youngs_modulus[body_{k}]"]["estimate"] for k in (0, 1)] == pytest.approx([1e5, 1.5e5], rel=1e-3)
    again = read_scenes(tmp_path / "new" / "e_simulated.h5")[0]
    np.testing.assert_allclose(again.position[-1], recorded[0].position[-1], atol=1e-5)
    assert (tmp_path / "new" / "e_convergence.png").exists()


@pytest.mark.parametrize("damage", ["truncated", "all NaN", "millimetres"])
def test_damaged_observations_are_refused(damage: str, estimated, record, tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    if damage == "truncated":
        path.write_bytes(path.read_bytes()[:3000])
    elif damage == "millimetres":
        write_scenes(path, [replace(record, position=1e3 * record.position)])
    else:
        later = record.position.copy()
        later[:] = np.nan
        write_scenes(path, [replace(record, position=later)])
    outcome = estimated()
    assert outcome.status == 2
    assert len(outcome.err.splitlines()) == 1
    assert "x.h5" in outcome.err
    assert ("metres expected" in outcome.err) == (damage == "millimetres")
