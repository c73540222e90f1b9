"""The lattice of a body: what it does to its motion, how dense it is, and the line about one that is too sparse."""

import math
from pathlib import Path

import numpy as np
import pytest

from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.configuration import start_from
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import particles
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulate import simulate
from pcnclaws.simulation.particle_spacing import particle_spacing, particles_a_cell
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart


def test_a_lattice_of_centres_has_the_mass_distribution_of_the_cube() -> None:
    for lattice, moment in (("centres", 1.0 - 1.0 / 100.0), ("faces", 11.0 / 9.0)):
        cube = particles(lattice=lattice)
        assert len(cube.position) == 1000
        np.testing.assert_allclose(cube.volume, 0.125 / 1000, rtol=1e-14)
        second = (cube.volume[:, None] * np.square(cube.position - 0.5)).sum(0)
        np.testing.assert_allclose(second / (0.5**5 / 12.0), moment, rtol=1e-12)
    assert particles(lattice="centres").position.min() == pytest.approx(0.275)
    ball = particles("sphere", side=0.4, particles_per_edge=20, lattice="centres")
    assert ball.volume.sum() == pytest.approx(math.pi / 6.0 * 0.4**3)
    assert ball.volume[0] == pytest.approx(0.02**3, rel=0.02)
    with pytest.raises(UserError, match="scene.lattice='corners' is not known"):
        particles(lattice="corners")


@pytest.mark.parametrize(("lattice", "within"), [("centres", (0.98, 1.02)), ("faces", (1.08, 1.2))])
def test_a_free_bar_vibrates_with_the_period_of_its_length(lattice: str, within: tuple[float, float]) -> None:
    """2 L / sqrt(E / rho) without Poisson's effect, where the lattice carries the mass where the bar has it."""
    side, speed, settings = 0.5, 10.0, SimulationSettings(gravity=(0.0, 0.0, 0.0))
    bar = particles(particles_per_edge=10, lattice=lattice)
    shape = np.cos(np.pi * (bar.position[:, 0] - 0.5 + 0.5 * side) / side)
    velocity = np.zeros_like(bar.position)
    velocity[:, 0] = 0.05 * shape
    parameters = {"youngs_modulus": 1000.0 * speed**2, "poissons_ratio": 0.0}
    start = SceneStart("bar", "elasticity", settings, parameters, bar.position, velocity, bar.volume)
    (record,) = simulate_records([start], analytic_laws(MATERIALS["elasticity"]), FramePlan(180, 2))
    amplitude = (record.position[:, :, 0] - record.position[0, :, 0]) @ shape
    down = int(np.flatnonzero((amplitude[1:-1] > 0.0) & (amplitude[2:] <= 0.0))[0]) + 1
    share = amplitude[down] / (amplitude[down] - amplitude[down + 1])
    half = record.time[down] + share * (record.time[down + 1] - record.time[down])
    assert within[0] < 2.0 * half / (2.0 * side / speed) < within[1]


def test_the_density_of_particles_is_that_of_their_lattice() -> None:
    def density(*options: str) -> float:
        return particles_a_cell(start_from(compose_config("simulate", list(options))))

    assert density() == pytest.approx(1.0)
    assert density("scene.lattice=faces") == pytest.approx(0.729)
    assert density("scene.particles_per_edge=20") == pytest.approx(8.0)
    assert density("scene.shape=sphere", "scene.particles_per_edge=20") == pytest.approx(8.0, rel=0.02)
    random = np.random.default_rng(0).random((3000, 3))
    assert particle_spacing(random, np.full(3000, 1.0 / 3000)) == pytest.approx(3000 ** (-1.0 / 3.0))
    assert particle_spacing(random[:1], np.full(1, 1e-3)) == pytest.approx(0.1)


def test_particles_more_than_a_cell_apart_are_named_with_advice(in_process, caplog, tmp_path: Path) -> None:
    options = ("law=analytic", "material=elasticity", "picture=false", "simulation.steps=5")
    done = in_process(simulate, "simulate", *options, "scene.particles_per_edge=6", "output=x.h5")
    assert done.status == 0
    (line,) = caplog.messages
    for word in ("scene 'cube'", "1.67 cells apart (0.0833 m)", "0.22 a cell", "at most 0.05 m", "better 0.025 m"):
        assert word in line
    assert "simulation.grid_spacing=0.0833)" in line
    assert "216 particles, 0.22 a cell" in done.out
    caplog.clear()
    # of particles in files, too, whatever volume they claim
    grid = np.stack(np.meshgrid(*[0.3 + 0.1 * np.arange(4)] * 3), axis=-1).reshape(-1, 3)
    np.savez(tmp_path / "p.npz", position=grid, velocity=np.zeros((64, 3)), volume=np.full(64, 1e-6))
    for file in ("p.npz", "x.h5"):
        assert in_process(simulate, "simulate", *options, f"scene.particles={file}", "output=y.h5").status == 0
    assert ["2 cells apart" in line or "1.67 cells apart" in line for line in caplog.messages] == [True, True]
    caplog.clear()
    done = in_process(simulate, "simulate", *options, "output=y.h5")
    assert (caplog.messages, "1000 particles, 1 a cell, 2 frames" in done.out) == ([], True)
