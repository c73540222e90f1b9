"""Parameters from motion: exact derivatives, the truth found again, and an honest word where nothing can be found."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from observed_bodies import TRUTH, observed, problem_of, solved, start, unknowns_of

from pcnclaws.errors import UserError
from pcnclaws.estimation.inverse import EstimatorSettings, InverseModule
from pcnclaws.estimation.law_error import calibrated_error, known_law_error
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.screening import screened_start, stable_start
from pcnclaws.estimation.start_motion import with_first_motion
from pcnclaws.estimation.transforms import Free, Transform, transform_of
from pcnclaws.estimation.uncertainty import ROUNDING, projected_error, uncertainty
from pcnclaws.estimation.unknowns import connected_bodies
from pcnclaws.geometry.velocity_gradients import spin_gradient
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.parameters import PARAMETERS, POISSONS_RATIO, YOUNGS_MODULUS
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
MATERIAL = pytest.mark.parametrize("material", list(TRUTH))


@pytest.mark.parametrize("transform", [*map(transform_of, PARAMETERS.values()), Free(0.5)])
def test_a_coordinate_and_its_number_are_one_to_one(transform: Transform | Free) -> None:
    u = np.linspace(-3.0, 3.0, 7)
    values = transform.value(u)
    assert np.all(np.diff(values) > 0.0)
    np.testing.assert_allclose([transform.coordinate(value) for value in values.tolist()], u, atol=1e-9)
    numeric = (transform.value(u + 1e-6) - transform.value(u - 1e-6)) / 2e-6
    np.testing.assert_allclose(transform.slope(u), numeric, rtol=1e-6)


def test_a_guess_at_a_bound_is_put_inside_and_any_other_is_left_alone() -> None:
    nu = transform_of(POISSONS_RATIO)
    assert 0.4 < nu.inside(0.5) < 0.49
    assert nu.inside(0.13) == 0.13
    assert transform_of(YOUNGS_MODULUS).inside(0.0) > 100.0
    assert np.isfinite(nu.coordinate(nu.inside(0.5)))


@MATERIAL
def test_the_jacobian_is_that_of_finite_differences(material: str) -> None:
    observation = observed(start(material, velocity=(0.5, -2.0, 0.3)), steps=80, dtype=torch.float64)
    unknowns = unknowns_of(observation, motion=True, time_offset=True)
    problem = problem_of(observation, unknowns, torch.float64)
    values = [0.8 * TRUTH[material].get(unknown.name, 0.1) for unknown in unknowns.sought]
    values[-1] = 1.3e-4  # between two steps, of the clock
    u, reach = unknowns.coordinates(values), 1e-5
    at = problem.linearise(u)
    # motion and clock know nothing of the material
    for k in unknowns.physical if material != "elasticity" else range(len(unknowns)):
        reached = reach * np.eye(len(u))[k]
        change = problem.motion(u + reached) - problem.motion(u - reached)
        numeric = change.transpose(0, 2, 1).ravel() / (2.0 * reach)
        assert np.abs(at.jacobian[k] - numeric).max() < 2e-3 * np.abs(numeric).max(), unknowns.sought[k].label


@MATERIAL
def test_the_three_ways_to_the_error_agree(material: str) -> None:
    observation = observed(start(material), dtype=torch.float64)
    problem = problem_of(observation, dtype=torch.float64)
    u = problem.unknowns.coordinates([0.7 * value for value in TRUTH[material].values()])
    at = problem.linearise(u)
    coordinates = torch.tensor(u, requires_grad=True)
    loss = problem.loss(coordinates)
    (gradient,) = torch.autograd.grad(loss, coordinates)
    assert problem.mse([u])[0] == pytest.approx(at.mse, rel=1e-12)
    assert float(loss.detach()) == pytest.approx(at.mse, rel=1e-12)
    np.testing.assert_allclose(gradient, 2.0 * at.jacobian @ at.residual / len(at.residual), rtol=1e-6)


@pytest.mark.parametrize("material", ["elasticity", pytest.param("plasticine", marks=pytest.mark.slow), "sand"])
def test_the_truth_is_found_again(material: str) -> None:
    problem = problem_of(observed(start(material)))
    u, at = solved(problem, [0.5 * value for value in TRUTH[material].values()])
    np.testing.assert_allclose(problem.unknowns.values(u), list(TRUTH[material].values()), rtol=1e-3)
    found = uncertainty(at, problem.unknowns, u, ROUNDING)
    for estimate, true in zip(found.estimates, TRUTH[material].values(), strict=True):
        assert estimate.identifiable
        assert estimate.interval[0] < true < estimate.interval[1]


@pytest.mark.slow
def test_start_velocity_spin_and_clock_are_found_along() -> None:
    scene = start("elasticity")
    spin, centre = np.array((1.0, 2.0, -1.5)), scene.position.mean(0)
    affine = np.tile(spin_gradient(spin.tolist()), (64, 1, 1))
    scene = replace(scene, velocity=scene.velocity + np.cross(spin, scene.position - centre), affine=affine)
    observation = observed(scene, steps=150, every=5)
    # the clock of the observation began 1.2 steps after the simulation did; its first frame is known to be the start
    late = replace(observation.between(1e-9, 1.0), initial_velocity=None, initial_affine=None)
    late = replace(late, time=late.time - 6e-4)
    unknowns = unknowns_of(late, motion=True, time_offset=True)
    guess = np.array([0.7 * TRUTH["elasticity"].get(unknown.name, 0.0) for unknown in unknowns.sought])
    first = with_first_motion(late, unknowns, guess)
    # the floor slows the body down within the frames that this takes for flight
    np.testing.assert_allclose(first[2:8], [0.5, -2.0, 0.0, *spin], atol=0.6)
    u, _ = solved(problem_of(late, unknowns), first.tolist())
    expected = [*TRUTH["elasticity"].values(), 0.5, -2.0, 0.0, *spin, 6e-4]
    np.testing.assert_allclose(unknowns.values(u), expected, rtol=2e-3, atol=2e-3)


@pytest.mark.slow
def test_noise_gaps_and_few_markers_widen_the_intervals_and_these_hold_the_truth() -> None:
    observation, generator = observed(start("elasticity"), steps=160, every=20), np.random.default_rng(3)
    whole = problem_of(observation)
    u, at = solved(whole, [0.7e5, 0.15])
    sharp = uncertainty(at, whole.unknowns, u, 0.0)
    target = observation.target + 1e-3 * generator.standard_normal(observation.target.shape)
    target[:, generator.random(64) < 0.8] = np.nan
    target[2, :30] = np.nan
    noisy = problem_of(replace(observation, target=target))
    u, at = solved(noisy, [0.7e5, 0.15])
    found = uncertainty(at, noisy.unknowns, u, ROUNDING)
    assert found.noise == pytest.approx(1e-3, rel=0.25)
    for estimate, before, true in zip(found.estimates, sharp.estimates, TRUTH["elasticity"].values(), strict=True):
        assert estimate.interval[0] < true < estimate.interval[1]
        assert estimate.interval[1] - estimate.interval[0] > 50.0 * (before.interval[1] - before.interval[0])


def test_intervals_of_white_noise_cover_as_often_as_they_say() -> None:
    observation, generator = observed(start("elasticity"), steps=120, every=20), np.random.default_rng(5)
    problem = problem_of(observation)
    truth = problem.unknowns.coordinates(list(TRUTH["elasticity"].values()))
    at = problem.linearise(truth)
    covered = []
    for _ in range(200):  # of the linear problem at the truth: what is tested is the covariance
        noise = 1e-3 * generator.standard_normal(at.residual.shape)
        step = np.linalg.lstsq(at.jacobian.T, noise, rcond=None)[0]
        there = at._replace(residual=noise - at.jacobian.T @ step)
        found = uncertainty(there, problem.unknowns, truth - step, 0.0)
        covered += [
            estimate.interval[0] < true < estimate.interval[1]
            for estimate, true in zip(found.estimates, TRUTH["elasticity"].values(), strict=True)
        ]
    assert 0.92 < np.mean(covered) <= 1.0


def test_a_law_error_of_one_kind_moves_estimates_as_far_as_it_says() -> None:
    problem = problem_of(observed(start("elasticity")))
    truth = problem.unknowns.coordinates(list(TRUTH["elasticity"].values()))
    at = problem.linearise(truth)
    found = uncertainty(at, problem.unknowns, truth, 1e-4)
    deviation = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(projected_error(at, deviation), 1e-4, rtol=1e-2)
    # however many positions there are, an error of the law is not averaged out
    twice = at._replace(residual=np.tile(at.residual, 2), jacobian=np.tile(at.jacobian, 2), part=np.tile(at.part, 2))
    again = uncertainty(twice, problem.unknowns, truth, 1e-4)
    np.testing.assert_allclose(np.sqrt(np.diag(again.covariance)), deviation, rtol=1e-2)


@MATERIAL
def test_a_search_that_stops_on_its_way_says_so_and_its_intervals_reach_the_minimum(material: str) -> None:
    problem = problem_of(observed(start(material)))
    truth = problem.unknowns.coordinates(list(TRUTH[material].values()))
    here = truth + np.array([0.01, -0.01, 0.01])[: len(truth)]
    found = uncertainty(problem.linearise(here), problem.unknowns, here, ROUNDING)
    for estimate, true in zip(found.estimates, TRUTH[material].values(), strict=True):
        assert estimate.identifiable
        assert not estimate.converged
        assert abs(estimate.ahead / true - 1.0) < 0.6 * abs(estimate.value / true - 1.0)
    at_truth = uncertainty(problem.linearise(truth), problem.unknowns, truth, ROUNDING)
    for estimate, ends in zip(found.estimates, at_truth.estimates, strict=True):
        assert ends.converged
        assert ends.ahead == pytest.approx(ends.value, rel=1e-4)
        assert estimate.interval[0] < ends.value < estimate.interval[1]


def test_free_flight_tells_nothing_and_says_so() -> None:
    problem = problem_of(observed(start("elasticity", velocity=(0.1, 1.0, 0.0)), steps=40))
    truth = problem.unknowns.coordinates(list(TRUTH["elasticity"].values()))
    found = uncertainty(problem.linearise(truth), problem.unknowns, truth, ROUNDING)
    assert not any(estimate.identifiable for estimate in found.estimates)
    assert np.isinf(np.diag(found.covariance)).all()


def test_plasticine_that_never_yields_tells_no_yield_stress() -> None:
    problem = problem_of(observed(start("plasticine", yield_stress=1e6)))
    truth = problem.unknowns.coordinates([3e5, 0.3, 1e6])
    found = uncertainty(problem.linearise(truth), problem.unknowns, truth, ROUNDING)
    assert [estimate.identifiable for estimate in found.estimates] == [True, True, False]


@pytest.mark.slow
def test_what_is_fixed_stays_and_is_not_estimated() -> None:
    observation = observed(start("sand"))
    unknowns = unknowns_of(observation, fixed={"poissons_ratio": 0.2})
    assert [unknown.name for unknown in unknowns.sought] == ["youngs_modulus", "friction_angle"]
    u, _ = solved(problem_of(observation, unknowns), [2e5, 20.0])
    np.testing.assert_allclose(unknowns.values(u), [3e5, 30.0], rtol=1e-3)
    with pytest.raises(UserError, match="leaves nothing to estimate"):
        unknowns_of(observation, fixed=TRUTH["sand"])
    with pytest.raises(UserError, match="fixed='yield_stress' is not known"):
        unknowns_of(observation, fixed={"yield_stress": 1.0})


@pytest.mark.slow
def test_a_graded_body_and_two_bodies_are_estimated_at_once() -> None:
    one = start("elasticity")
    graded = observed(one)
    unknowns = unknowns_of(graded, vary="x")
    assert [unknown.label for unknown in unknowns.sought][:2] == ["youngs_modulus[low_x]", "youngs_modulus[high_x]"]
    values = [6e4, 1.6e5, 0.2, 0.3]
    truth = problem_of(graded, unknowns).motion(unknowns.coordinates(values))
    u, _ = solved(problem_of(replace(graded, target=truth.astype(float)), unknowns), [1e5, 1e5, 0.25, 0.25])
    np.testing.assert_allclose(unknowns.values(u), values, rtol=1e-3)

    apart = np.concatenate((one.position - np.array((0.2, 0.0, 0.0)), one.position + np.array((0.2, 0.02, 0.0))))
    both = replace(one, position=apart, velocity=np.tile(one.velocity, (2, 1)), volume=np.tile(one.volume, 2))
    pair = observed(both)
    unknowns = unknowns_of(pair, vary="bodies")
    truth = problem_of(pair, unknowns).motion(unknowns.coordinates(values))
    u, _ = solved(problem_of(replace(pair, target=truth.astype(float)), unknowns), [1e5, 1e5, 0.25, 0.25])
    np.testing.assert_allclose(unknowns.values(u), values, rtol=1e-3)
    np.testing.assert_array_equal(connected_bodies(apart[::-1], pair.spacing), np.repeat((1, 0), 64))


def test_screening_finds_a_start_that_a_bad_guess_is_far_from() -> None:
    problem = problem_of(observed(start("elasticity")))
    guess = problem.unknowns.coordinates([1.5e6, 0.45])
    best, errors = screened_start(problem, guess, 16)
    assert min(errors) < 0.2 * errors[0]
    u, _ = solved(problem, problem.unknowns.values(best).tolist())
    np.testing.assert_allclose(problem.unknowns.values(u), [1e5, 0.25], rtol=1e-3)


def test_a_guess_that_is_too_stiff_for_the_time_step_is_softened_until_it_runs() -> None:
    problem = problem_of(observed(start("elasticity")))
    stiff = problem.unknowns.coordinates([1e8, 0.3])
    assert problem.instability(stiff) > 1.0
    assert problem.mse([stiff]) == [np.inf]
    assert problem.linearise(stiff).mse == np.inf
    softer = stable_start(problem, stiff)
    assert problem.instability(softer) <= 1.0
    assert np.isfinite(problem.mse([softer])[0])


@pytest.mark.slow
def test_the_calibrated_error_covers_the_differences_that_it_was_made_from() -> None:
    scenes = [start("elasticity", youngs_modulus=modulus) for modulus in (8e4, 1.2e5, 1.6e5)]
    laws = analytic_laws(MATERIALS["elasticity"])
    records = simulate_records(scenes, laws, FramePlan(120, 10))
    exact = calibrated_error(MATERIALS["elasticity"], laws, records)
    assert exact["law_error"] < 1e-6
    assert exact["objects"] == 3
    softer = [
        replace(record, parameters={**record.parameters, "youngs_modulus": 0.9 * e})
        for record, e in zip(records, (8e4, 1.2e5, 1.6e5), strict=True)
    ]
    wrong = calibrated_error(MATERIALS["elasticity"], laws, softer)
    np.testing.assert_allclose(
        [difference[0] for difference in wrong["relative_differences"]], 1.0 / 0.9 - 1.0, rtol=1e-2
    )
    assert wrong["law_error"] > 100.0 * exact["law_error"]


def test_the_analytic_law_has_the_error_of_rounding() -> None:
    assert known_law_error(None) == ROUNDING


def test_gradient_descent_goes_halfway_back_from_a_gradient_that_is_not_finite() -> None:
    module = InverseModule(problem_of(observed(start("elasticity"))), np.zeros(2), EstimatorSettings("adam"))
    optimiser = module.configure_optimizers()
    module.coordinates.grad = torch.ones(2, dtype=torch.float64)
    module.on_before_optimizer_step(optimiser)
    optimiser.step()
    np.testing.assert_allclose(module.u, [-0.1, -0.1], rtol=1e-6)
    module.coordinates.grad = torch.tensor((float("nan"), 1.0), dtype=torch.float64)
    module.on_before_optimizer_step(optimiser)
    optimiser.step()
    np.testing.assert_allclose(module.u, [-0.05, -0.05], rtol=1e-6)


def test_central_differences_which_serve_on_a_gpu_are_near_the_exact_derivatives() -> None:
    seen = observed(start("elasticity"), 60, dtype=torch.float64)
    problem = problem_of(seen, unknowns_of(seen, motion=True), dtype=torch.float64)
    u = problem.unknowns.coordinates([*TRUTH["elasticity"].values(), 0.5, -2.0, 0.0, 0.0, 0.0, 0.0])
    exact = problem.linearise(u).jacobian
    rates = problem.differences(u, range(len(u)))
    assert set(rates) == set(range(len(u)))
    for k, rate in rates.items():
        changed = problem.comparison.assigned(rate).change(rate).numpy()
        assert np.linalg.norm(changed - exact[k]) < 0.02 * np.linalg.norm(exact[k])


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_a_search_on_a_gpu_ends_where_that_on_a_cpu_does() -> None:
    seen = observed(start("sand"))
    found = []
    for device in ("cpu", "cuda"):
        problem = EstimationProblem(
            analytic_laws(MATERIALS["sand"]), seen, unknowns_of(seen), Execution(torch.float32, device)
        )
        u, at = solved(problem, [2e5, 0.25, 27.0])
        found.append(problem.unknowns.values(u))
        assert at.mse < 1e-11
    np.testing.assert_allclose(found[1], found[0], rtol=2e-3)
