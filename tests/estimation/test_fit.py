"""No number without its fit: a motion that the model does not explain is named, a right model raises no alarm."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from observed_bodies import TRUTH, observed, problem_of, solved, start, unknowns_of

from pcnclaws.data.observation import Observation
from pcnclaws.estimation.first_frame import without_first_error
from pcnclaws.estimation.goodness_of_fit import Fit, fit_of
from pcnclaws.estimation.scatter import scatter_of
from pcnclaws.estimation.uncertainty import ROUNDING, uncertainty

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
NOISE = 1e-3
CENTRE = np.array((0.5, 0.24, 0.5))


@pytest.fixture(scope="module")
def recorded() -> dict[str, Observation]:
    """A cube that hits the floor, of three materials, in 23 frames."""
    return {material: observed(start(material), steps=110, every=5) for material in TRUTH}


def noisy(observation: Observation, noise: float = NOISE, seed: int = 0) -> Observation:
    """Positions with errors and gaps; the error of the first frame puts a marker beside its place ever after."""
    chance = np.random.default_rng(seed)
    target = observation.target + noise * chance.standard_normal(observation.target.shape)
    target += noise * chance.standard_normal(target.shape[1:])
    target[chance.random(target.shape[:2]) < 0.1] = np.nan
    target[0] = observation.target[0]
    return replace(observation, target=target)


def judged(
    observation: Observation, noise: float | None = None, motion: bool = False, iterations: int = 2, **guess: float
) -> Fit:
    """The fit of the best parameters of the observation's material."""
    unknowns = unknowns_of(observation, motion=motion)
    problem = problem_of(observation, unknowns)
    first = {"velocity_x": 0.5, "velocity_y": -2.0} | TRUTH[observation.material] | guess
    u, at = solved(problem, [first.get(unknown.name, 0.0) for unknown in unknowns.sought], iterations)
    return fit_of(problem, u, uncertainty(at, unknowns, u, ROUNDING, noise), noise)


def turned(observation: Observation) -> Observation:
    """Positions in the axes of a camera whose third axis points up."""
    x, y, z = np.moveaxis(observation.target - CENTRE, 2, 0)
    start_of = np.asarray(observation.initial_velocity)[:, [0, 2, 1]] * (1.0, -1.0, 1.0)
    return replace(observation, target=np.stack((x, -z, y), axis=2) + CENTRE, initial_velocity=start_of)


def faster(observation: Observation, by: float) -> Observation:
    """A frame rate that is wrong by a factor; the start velocity is known otherwise."""
    return replace(observation, time=observation.time / by)


def mirrored(observation: Observation) -> Observation:
    target = observation.target.copy()
    target[..., 0] = 1.0 - target[..., 0]
    target[0] = observation.target[0]
    return replace(observation, target=target)


def later(observation: Observation, by: float = 0.01) -> Observation:
    time = np.where(observation.time > 0.0, observation.time + by, 0.0)
    return replace(observation, time=time)


def exchanged(observation: Observation) -> Observation:
    """Two of the markers change their labels halfway."""
    target = observation.target.copy()
    target[12:, [3, 42]] = target[12:, [42, 3]]
    return replace(observation, target=target)


def under(observation: Observation, gravity: tuple[float, float, float]) -> Observation:
    return replace(observation, settings=replace(observation.settings, gravity=gravity))


def larger(observation: Observation, by: float = 1.1) -> Observation:
    """A body that is larger than the one that moved, which its markers follow."""
    return replace(
        observation,
        position=CENTRE + by * (observation.position - CENTRE),
        volume=by**3 * observation.volume,
        target=np.concatenate((observation.target[:1] * np.nan, observation.target[1:])),
    )


def of_material(material: str) -> Callable[[Observation], Observation]:
    return lambda observation: replace(observation, material=material)


SLOW = pytest.mark.slow
WRONG = [
    pytest.param("elasticity", turned, id="axes"),
    pytest.param("elasticity", lambda seen: faster(seen, 2.0), id="twice the frame rate", marks=SLOW),
    pytest.param("elasticity", lambda seen: faster(seen, 0.5), id="half the frame rate", marks=SLOW),
    pytest.param("elasticity", larger, id="larger body", marks=SLOW),
    pytest.param("sand", of_material("elasticity"), id="sand as elasticity"),
    pytest.param("elasticity", of_material("sand"), id="elasticity as sand", marks=SLOW),
    pytest.param("elasticity", mirrored, id="mirrored", marks=SLOW),
    pytest.param("elasticity", lambda seen: under(seen, (0.0, 0.0, -9.8)), id="gravity along z", marks=SLOW),
    pytest.param("elasticity", later, id="late", marks=SLOW),
]


@pytest.mark.parametrize(
    ("material", "noise"),
    [
        ("elasticity", NOISE),
        ("sand", NOISE),
        pytest.param("plasticine", NOISE, marks=SLOW),
        pytest.param("plasticine", 0.0, marks=SLOW),
        ("sand", 0.0),
    ],
)
def test_a_right_model_raises_no_alarm(material: str, noise: float, recorded) -> None:
    fit = judged(noisy(recorded[material], noise))
    assert fit.fitted
    assert fit.has_intervals
    assert fit.odd == ()
    assert fit.scatter is not None
    assert fit.scatter.size == pytest.approx(noise, rel=0.1, abs=1e-6)


@pytest.mark.parametrize(("material", "mistaken"), WRONG)
def test_a_wrong_model_is_told_by_what_it_leaves(
    material: str, mistaken: Callable[[Observation], Observation], recorded
) -> None:
    fit = judged(mistaken(noisy(recorded[material])), iterations=4)
    assert fit.fitted is False
    assert not fit.has_intervals


def test_exchanged_labels_are_told_apart_from_a_wrong_model(recorded) -> None:
    fit = judged(exchanged(noisy(recorded["elasticity"])))
    assert fit.fitted is False
    assert set(fit.odd) <= {3, 42} != set()


def test_a_noise_that_is_given_wins(recorded) -> None:
    seen = noisy(recorded["elasticity"])
    assert judged(seen, noise=NOISE, iterations=1).fitted
    assert judged(seen, noise=0.2 * NOISE, iterations=1).fitted is False
    # errors that are alike from frame to frame are no sign of a wrong model where the user knows their size
    chance = np.random.default_rng(1).standard_normal((3, *seen.target.shape[1:]))
    phase = np.linspace(0.0, 3.0, len(seen.time))[:, None, None]
    slow = chance[0] * np.sin(phase) + chance[1] * np.cos(phase) + chance[2] * np.sin(2.0 * phase)
    smooth = replace(seen, target=seen.target + 2.0 * NOISE * slow)
    assert judged(smooth, iterations=1).fitted is False
    assert judged(smooth, noise=3.0 * NOISE, iterations=1).fitted


def test_few_numbers_give_no_verdict_and_no_interval(recorded) -> None:
    seen = noisy(recorded["elasticity"])
    target = np.full_like(seen.target, np.nan)
    target[[0, 20], :3] = recorded["elasticity"].target[[0, 20], :3]
    target[20] += NOISE
    few = judged(replace(seen, target=target), motion=True, iterations=0)
    assert (few.freedom, few.fitted, few.has_intervals) == (1, None, True)
    target[20, 2] = np.nan
    fewer = judged(replace(seen, target=target), motion=True, iterations=0)
    assert (fewer.fitted, fewer.has_intervals) == (None, False)
    assert judged(replace(seen, target=target), motion=True, noise=NOISE, iterations=0).has_intervals


def test_the_scatter_is_found_on_uneven_times_beside_motion_and_impact() -> None:
    chance = np.random.default_rng(2)
    time = np.sort(chance.random(40))
    place = chance.random((12, 3))
    motion = np.sin(4.0 * time)[:, None, None] * place + 0.05 * (time > 0.5)[:, None, None]
    field = motion + NOISE * chance.standard_normal(motion.shape)
    field[chance.random(field.shape[:2]) < 0.2] = np.nan
    found = scatter_of(time, (field,), place)
    assert found is not None
    assert found.size == pytest.approx(NOISE, rel=0.15)
    # of three frames, which no difference in time can use, the markers beside each other tell it
    few = scatter_of(time[[3, 20, 35]], (field[[3, 20, 35]],), place)
    assert few is not None
    assert (few.known, few.size) == ("neighbouring markers", pytest.approx(NOISE, rel=0.4))
    assert scatter_of(time[:2], (field[:2, :5],), place[:5]) is None


def test_the_error_of_the_first_frame_is_no_sign_of_a_wrong_model() -> None:
    chance = np.random.default_rng(4)
    angle = np.linspace(0.0, 2.0 * np.pi, 30)  # a whole turn, and a stretch by 3
    turn = np.stack(
        [np.array(((np.cos(a), -np.sin(a), 0.0), (np.sin(a), np.cos(a), 0.0), (0.0, 0.0, 3.0))) for a in angle]
    )
    deformation = np.broadcast_to(turn[:, None], (30, 40, 3, 3))
    error = NOISE * chance.standard_normal((30, 40, 3))
    first = NOISE * chance.standard_normal((40, 3))
    rest = without_first_error(error + np.einsum("fmij,mj->fmi", deformation, first), deformation)
    assert np.sqrt(rest.variance) == pytest.approx(NOISE, rel=0.05)
    assert np.sqrt(np.mean(np.square(rest.field))) == pytest.approx(NOISE, rel=0.05)
    moved = without_first_error(error + np.linspace(0.0, 1e-2, 30)[:, None, None], deformation)
    assert np.sqrt(moved.variance) > 4.0 * NOISE
