"""Parameters from frames of unlabelled points on a surface, half of which is hidden."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from observed_bodies import TRUTH, solved, start
from observed_points import STEPS, motion, observation_of, problem_of_points, seen

from pcnclaws.data.point_frames import PointFrames
from pcnclaws.estimation.goodness_of_fit import fit_of
from pcnclaws.estimation.start_motion import with_first_motion
from pcnclaws.estimation.uncertainty import ROUNDING, uncertainty
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
SLOW = pytest.mark.slow
TRUE = list(TRUTH["elasticity"].values())


@pytest.fixture(scope="module")
def record() -> SceneRecord:
    return motion()


def test_derivatives_are_those_of_the_distance_to_the_moving_surface(tmp_path: Path) -> None:
    record = motion(dtype=torch.float64)
    observation = observation_of(record, seen(record, 30, noise=2e-3), tmp_path / "p.npz")
    problem = problem_of_points(observation, offset=True, dtype=torch.float64)
    u = problem.unknowns.coordinates([8e4, 0.2, 1e-3])
    at = problem.linearise(u)
    for k in range(len(u)):
        step = 1e-5 * np.eye(len(u))[k]
        difference = (problem.linearise(u + step).residual - problem.linearise(u - step).residual) / 2e-5
        # a point whose closest place changes from one triangle to another has no derivative
        off = np.abs(difference - at.jacobian[k])
        assert np.quantile(off, 0.98) < 1e-5 * max(np.abs(at.jacobian[k]).max(), 1e-3)


def test_reverse_mode_agrees_with_forward_mode(record: SceneRecord, tmp_path: Path) -> None:
    observation = observation_of(record, seen(record, 30, noise=2e-3), tmp_path / "p.npz")
    problem = problem_of_points(observation, offset=True)
    u = torch.tensor(problem.unknowns.coordinates([8e4, 0.2, 1e-3]), requires_grad=True)
    problem.loss(u).backward()
    at = problem.linearise(u.detach().numpy())
    assert u.grad is not None
    np.testing.assert_allclose(u.grad.numpy(), 2.0 * at.jacobian @ at.residual / len(at.residual), rtol=1e-3)


def test_the_closest_places_minimise_the_distance(record: SceneRecord, tmp_path: Path) -> None:
    observation = observation_of(record, seen(record, noise=2e-3), tmp_path / "p.npz")
    problem = problem_of_points(observation)
    observed, placed = problem.beside(problem.unknowns.coordinates(TRUE))
    assert observed.shape == placed.shape
    vertices = record.position[:, observation.particle[: len(observation.particle) // 2, 0]].astype(np.float64)
    assert observation.points is not None
    share = np.random.default_rng(1).dirichlet((1.0, 1.0, 1.0), (20, 1))
    for frame, points in enumerate(observed):
        some = (share[..., None] * vertices[frame][observation.points.faces]).sum(2).reshape(-1, 3)
        points = points[np.isfinite(points).all(1)]
        least = np.linalg.norm(points[:, None] - some, axis=2).min(1)
        mine = np.linalg.norm(points - placed[frame, : len(points)], axis=1)
        assert (mine <= least + 1e-6).all()


def test_without_noise_half_of_the_surface_gives_the_parameters(record: SceneRecord, tmp_path: Path) -> None:
    observation = observation_of(record, seen(record, 60), tmp_path / "p.npz")
    problem = problem_of_points(observation, offset=True)
    u, at = solved(problem, [4e4, 0.1, 0.0])
    found = problem.unknowns.values(u)
    np.testing.assert_allclose(found[:2], TRUE, rtol=1e-3)
    assert abs(found[2]) < 1e-6
    assert at.mse < 1e-12


def test_the_order_of_the_points_changes_nothing(record: SceneRecord, tmp_path: Path) -> None:
    points = seen(record, 40, noise=2e-3)
    chance = np.random.default_rng(3)
    order = np.lexsort((chance.random(len(points.frame)), points.frame))
    mixed = PointFrames(points.time, points.position[order], points.frame)
    one, other = (
        problem_of_points(observation_of(record, some, tmp_path / f"{k}.npz")) for k, some in enumerate((points, mixed))
    )
    u = one.unknowns.coordinates([8e4, 0.2])
    at, mixed_at = one.linearise(u), other.linearise(u)
    np.testing.assert_array_equal(at.residual[order], mixed_at.residual)
    np.testing.assert_array_equal(at.jacobian[:, order], mixed_at.jacobian)


@pytest.mark.parametrize("material", ["elasticity", *(pytest.param(m, marks=SLOW) for m in ("plasticine", "sand"))])
def test_intervals_hold_the_truth_and_the_motion_is_fitted(material: str, tmp_path: Path) -> None:
    record, truth = motion(material), list(TRUTH[material].values())
    observation = observation_of(record, seen(record, 100, noise=5e-4), tmp_path / "p.npz")
    problem = problem_of_points(observation, offset=True)
    u, at = solved(problem, [0.7 * truth[0], 0.8 * truth[1], *(1.2 * value for value in truth[2:]), 0.0])
    found = uncertainty(at, problem.unknowns, u, ROUNDING)
    for estimate, true in zip(found.estimates, truth, strict=False):
        low, high = estimate.interval
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        assert abs(true - middle) < 2.0 * half  # four standard errors
    fit = fit_of(problem, u, found)
    assert fit.fitted is True
    assert fit.scatter is not None
    assert fit.scatter.size == pytest.approx(5e-4, rel=0.2)


def test_a_wrong_model_is_told(record: SceneRecord, tmp_path: Path) -> None:
    observation = observation_of(record, seen(record, 150, noise=1e-3), tmp_path / "p.npz")
    wrong = replace(observation, settings=replace(observation.settings, gravity=(0.0, 0.0, -9.8)))
    problem = problem_of_points(wrong, offset=True)
    u, at = solved(problem, [*TRUE, 0.0], iterations=4)
    assert fit_of(problem, u, uncertainty(at, problem.unknowns, u, ROUNDING)).fitted is False


def test_points_of_the_background_are_counted(record: SceneRecord, tmp_path: Path) -> None:
    points = seen(record, 60, noise=1e-3)
    points.position[100::40] += 0.05  # outwards, whatever face they are on
    problem = problem_of_points(observation_of(record, points, tmp_path / "p.npz"))
    u = problem.unknowns.coordinates(TRUE)
    fit = fit_of(problem, u, uncertainty(problem.linearise(u), problem.unknowns, u, ROUNDING))
    assert (fit.fitted, fit.stray) == (False, len(points.position[100::40]))


@SLOW
def test_half_a_spacing_of_body_is_around_particles_in_the_centres_of_cells(tmp_path: Path) -> None:
    scene = replace(start("elasticity"), volume=np.full(64, (0.8 / 3.0) ** 3 / 64))
    laws = analytic_laws(MATERIALS["elasticity"])
    record = simulate_records([scene], laws, FramePlan(STEPS, 8), Execution(torch.float32))[0]
    observation = observation_of(record, seen(record, 60), tmp_path / "p.npz")
    assert observation.points is not None
    assert observation.points.offset == pytest.approx(0.1 / 3.0, abs=1e-6)
    problem = problem_of_points(observation, offset=True)
    u, _ = solved(problem, [6e4, 0.15, 0.0])
    np.testing.assert_allclose(problem.unknowns.values(u)[:2], TRUE, rtol=1e-3)


@SLOW
def test_a_surface_farther_out_is_found_and_shifts_nothing(record: SceneRecord, tmp_path: Path) -> None:
    observation = observation_of(record, seen(record, 60, offset=4e-3), tmp_path / "p.npz")
    problem = problem_of_points(observation, offset=True)
    u, _ = solved(problem, [*TRUE, 0.0])
    found = problem.unknowns.values(u)
    assert found[2] == pytest.approx(4e-3, abs=1e-5)
    np.testing.assert_allclose(found[:2], TRUE, rtol=2e-3)


def test_points_of_the_flight_give_a_start_of_the_search(record: SceneRecord, tmp_path: Path) -> None:
    observation = observation_of(record, seen(record, 150, noise=5e-4), tmp_path / "p.npz", False)
    problem = problem_of_points(observation, motion=True, offset=True)
    guess = with_first_motion(observation, problem.unknowns, np.array([*TRUE, *np.zeros(7)]))
    np.testing.assert_allclose(guess[2:5], [0.5, -2.0, 0.0], atol=0.2)
    np.testing.assert_allclose(guess[5:8], 0.0, atol=2.0)
    before = problem.linearise(problem.unknowns.coordinates([*TRUE, *np.zeros(7)]))
    assert problem.linearise(problem.unknowns.coordinates(guess.tolist())).mse < 0.1 * before.mse
