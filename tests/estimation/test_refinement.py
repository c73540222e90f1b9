"""Estimates on finer grids, the spacing that a motion is most like, and the size of a body."""

from dataclasses import replace

import numpy as np
import pytest
from observed_bodies import TRUTH, observed, problem_of, solved, start, unknowns_of

from pcnclaws.data.markers import followed_particles
from pcnclaws.data.observation import Observation
from pcnclaws.estimation.grid_spacing import along_spacing, curvature, most_alike, weights_of_parts
from pcnclaws.estimation.marker_weights import weights_of_growth
from pcnclaws.estimation.problem import EstimationProblem, Linearisation
from pcnclaws.estimation.refinement import Stage, corrected, followed
from pcnclaws.estimation.uncertainty import uncertainty
from pcnclaws.estimation.unknowns import GRID_SPACING, SIZE, Unknowns, components_of, make_unknowns
from pcnclaws.geometry.shapes import particles
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
MATERIAL = "elasticity"


def on_grid(markers: Observation, times: float, side: float = 0.2, per_edge: int = 4) -> Observation:
    """Markers on a cube of `per_edge` particles, `times` as many on a grid that is so many times as fine."""
    body = particles("cube", (0.5, 0.24, 0.5), side, round(per_edge * times), "centres")
    settings = SimulationSettings()
    settings = replace(settings, grid_spacing=settings.grid_spacing / times, time_step=settings.time_step / times)
    names = [str(n) for n in range(markers.target.shape[1])]
    particle, weight = followed_particles(markers.target[0], names, body.position, 0.05)
    assert markers.initial_velocity is not None
    return replace(
        markers,
        settings=settings,
        particle=particle,
        weight=weight,
        position=body.position,
        volume=body.volume,
        initial_velocity=np.broadcast_to(markers.initial_velocity[0], body.position.shape),
    )


def unknowns(observation: Observation, **sought: bool) -> Unknowns:
    parts = components_of("uniform", observation.position, observation.spacing)
    names = MATERIALS[MATERIAL].parameter_names
    return make_unknowns(names, {}, parts, parts, motion=False, time_offset=False, **sought)


def sized(times: float = 1.0, **sought: bool) -> EstimationProblem:
    observation = on_grid(observed(start(MATERIAL), steps=120, every=10), times)
    return problem_of(observation, unknowns(observation, **sought))


@pytest.fixture(scope="module")
def larger() -> EstimationProblem:
    """Markers of a cube that is 5 % larger than the one that they are put on."""
    plain = on_grid(observed(start(MATERIAL), steps=120, every=10), 1.0)
    problem = problem_of(on_grid(plain, 1.0, side=0.21), unknowns(plain))
    motion = problem.motion(problem.unknowns.coordinates(list(TRUTH[MATERIAL].values())))
    seen = replace(plain, target=motion)
    return problem_of(seen, unknowns(seen, size=True))


def test_a_body_that_is_larger_keeps_its_markers_in_their_places(larger: EstimationProblem) -> None:
    values = [*TRUTH[MATERIAL].values(), 0.1]
    first = larger.motion(larger.unknowns.coordinates(values))[0]
    np.testing.assert_allclose(first, larger.observation.target[0], atol=1e-6)


def test_weights_of_growth_have_no_sum_and_are_exact_for_affine_motions(larger: EstimationProblem) -> None:
    observation, size = larger.observation, 1.3
    weight = observation.weight + (1.0 / size - 1.0) * weights_of_growth(observation)
    np.testing.assert_allclose(weight.sum(1), 1.0, atol=1e-12)
    centre = observation.position.mean(0)
    matrix = np.array([[1.1, 0.2, 0.0], [0.0, 0.9, -0.1], [0.3, 0.0, 1.0]])
    moved = (centre + size * (observation.position - centre)) @ matrix.T
    found = np.einsum("mk,mkc->mc", weight, moved[observation.particle])
    np.testing.assert_allclose(found, observation.places @ matrix.T, atol=1e-12)


def test_the_size_of_a_body_is_found(larger: EstimationProblem) -> None:
    u, _ = solved(larger, [1.3e5, 0.2, 0.0], 6)
    modulus, ratio, size = larger.unknowns.values(u).tolist()
    assert size == pytest.approx(0.05, abs=1e-3)
    assert modulus == pytest.approx(TRUTH[MATERIAL]["youngs_modulus"], rel=5e-3)
    assert ratio == pytest.approx(TRUTH[MATERIAL]["poissons_ratio"], abs=3e-3)


def test_a_fine_grid_is_followed_by_the_derivatives_of_a_coarse_one() -> None:
    """Of markers of the fine grid itself: the coarse estimate is off, the one that goes on from it is not."""
    fine = sized(2.0)
    truth = list(TRUTH[MATERIAL].values())
    seen = fine.motion(fine.unknowns.coordinates(truth))
    coarse = sized()
    coarse = problem_of(replace(coarse.observation, target=seen), coarse.unknowns)
    fine = problem_of(replace(fine.observation, target=seen), fine.unknowns)
    u, at = solved(coarse, truth, 5)
    assert abs(coarse.unknowns.values(u)[0] / truth[0] - 1.0) > 0.03
    last = followed(Stage(coarse, u, at), fine)
    assert fine.unknowns.values(last.u)[0] == pytest.approx(truth[0], rel=5e-3)
    assert last.at.mse < 1e-2 * at.mse


def test_broyden_explains_the_last_step_and_changes_nothing_across_it() -> None:
    generator = np.random.default_rng(0)
    jacobian, step, change = (generator.standard_normal(shape) for shape in ((3, 7), (3,), (7,)))
    better = corrected(jacobian, step, change)
    np.testing.assert_allclose(step @ better, change)
    across = np.cross(step, generator.standard_normal(3))
    np.testing.assert_allclose(across @ better, across @ jacobian)


def test_the_spacing_of_a_motion_is_where_the_residual_is_smallest() -> None:
    """Residuals that are linear in the spacing and in the numbers, of a motion between two grids."""
    problems = [sized(times, grid_spacing=True) for times in (1.0, 2.0)]
    sought, rows = problems[0].unknowns, problems[0].comparison.rows
    (index,) = sought.index(GRID_SPACING)
    generator = np.random.default_rng(1)
    jacobian = generator.standard_normal((len(sought), rows))
    truth = sought.coordinates([*TRUTH[MATERIAL].values(), 0.04])
    others = [k for k in range(len(sought)) if k != index]
    own = np.delete(jacobian, index, axis=0)
    stages = []
    for problem in problems:
        u = truth.copy()
        u[index] = sought.sought[index].transform.coordinate(problem.observation.settings.grid_spacing)
        wrong = (u - truth)[index] * jacobian[index]
        u[others] -= np.linalg.lstsq(own.T, wrong, rcond=None)[0]
        rates = jacobian.copy()
        rates[index] = 0.0
        stages.append(Stage(problem, u, Linearisation((u - truth) @ jacobian, rates, np.zeros(rows))))
    found = along_spacing(*stages)
    np.testing.assert_allclose(found.u, truth, atol=1e-9)
    np.testing.assert_allclose(found.at.residual, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.at.jacobian, jacobian, atol=1e-9)


@pytest.fixture(scope="module")
def between_grids() -> list[Stage]:
    """Estimates on three grids of a motion of a spacing between the finer two, the last one 5 % beside its minimum."""
    truth = list(TRUTH[MATERIAL].values())
    own = sized(1.75)
    seen = own.motion(own.unknowns.coordinates(truth))
    problems = []
    for times in (1.0, 1.5, 2.0):
        plain = sized(times, walls=True, grid_spacing=True)
        problems.append(problem_of(replace(plain.observation, target=seen), plain.unknowns))
    coarsest, coarse, fine = problems
    u, at = solved(coarsest, [*truth, 0.0, 0.0, 0.0, 0.05], 2)
    first = Stage(coarsest, u, at)
    u, at = solved(coarse, coarse.unknowns.values(u).tolist(), 3)
    beside = fine.unknowns.values(followed(Stage(coarse, u, at), fine).u)
    beside[0] *= 1.05
    v = fine.unknowns.coordinates(beside.tolist())
    return [first, Stage(coarse, u, at), Stage(fine, v, at._replace(residual=fine.residual(v)))]


def test_a_search_that_ended_beside_the_minimum_is_led_to_it(between_grids: list[Stage]) -> None:
    truth, spacing = TRUTH[MATERIAL], 0.05 / 1.75
    line, found = (
        along_spacing(between_grids[1], between_grids[2]),
        most_alike(between_grids[0], between_grids[1], between_grids[2]),
    )
    before, after = (stage.problem.unknowns.values(stage.u) for stage in (line, found))
    assert abs(before[0] / truth["youngs_modulus"] - 1.0) > 0.02
    assert after[0] == pytest.approx(truth["youngs_modulus"], rel=5e-3)
    assert after[1] == pytest.approx(truth["poissons_ratio"], abs=5e-3)
    assert after[-1] == pytest.approx(spacing, rel=0.03)
    assert found.at.mse < line.at.mse


def test_the_spacing_does_not_fall_below_0(between_grids: list[Stage]) -> None:
    """Of residuals that grow where the grid is finer, most of all at no spacing."""
    coarsest, coarse, fine = between_grids
    change = coarse.at.residual - fine.at.residual
    worse, worst = (
        one._replace(at=one.at._replace(residual=one.at.residual + 10.0 * change)) for one in (coarse, fine)
    )
    found = most_alike(coarsest, worse, worst)
    assert found.problem.unknowns.values(found.u)[-1] == pytest.approx(0.0, abs=1e-12)


def test_a_doubt_adds_its_square_to_the_covariance(between_grids: list[Stage]) -> None:
    line = along_spacing(between_grids[1], between_grids[2])
    doubt = np.array([[0.3, -0.2, 0.0, 0.1, 0.0, 0.0], [0.0, 0.1, 0.0, 0.0, 0.0, 0.2]])
    plain, doubted = (uncertainty(line.at, line.problem.unknowns, line.u, 1e-9, doubt=d) for d in (None, doubt))
    felt = np.ix_(*2 * [np.isfinite(np.diag(plain.covariance))])
    np.testing.assert_allclose(doubted.covariance[felt] - plain.covariance[felt], (doubt.T @ doubt)[felt], atol=1e-12)


def test_a_marker_that_is_missed_by_more_than_others_counts_less() -> None:
    part = np.repeat(np.arange(5), 30)
    residual = np.where(part == 3, 1e-2, 1e-3)
    weight = weights_of_parts(Linearisation(residual, np.zeros((1, 150)), part))
    np.testing.assert_allclose(weight[part != 3], 1.0)
    np.testing.assert_allclose(weight[part == 3], 0.2)


@pytest.mark.parametrize("bend", [0.0, 3.0])
def test_the_doubt_is_what_a_parabola_differs_by_from_the_line(between_grids: list[Stage], bend: float) -> None:
    stages, spacings = [], [0.05, 0.05 / 1.5, 0.025]
    for stage, h in zip(between_grids, spacings, strict=True):
        stages.append(stage._replace(u=np.array([1.0 + 20.0 * h + bend * h**2, -7.0 * h, 0.0, 0.0, 0.0, 0.0])))
    sought = stages[0].problem.unknowns
    at, (first, second) = 0.01, spacings[1:]
    u = sought.coordinates([1e5, 0.2, 0.0, 0.0, 0.0, at])
    expected = [bend * (at - first) * (at - second), 0.0, 0.0, 0.0, 0.0, 0.0]
    coarsest, coarse, fine = stages
    np.testing.assert_allclose(curvature(coarsest, coarse, fine, u), expected, atol=1e-12)


def test_the_size_is_no_unknown_unless_asked_for() -> None:
    assert not unknowns_of(observed(start(MATERIAL), steps=10, every=10)).index(SIZE)
