"""Small recorded scenes for tests."""

from pathlib import Path

import h5py
import numpy as np

from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.records import Keyframes, SceneRecord

SAND = {"youngs_modulus": 3e5, "poissons_ratio": 0.2, "friction_angle": 30.0}


def recording(
    name: str = "thrown",
    frames: int = 4,
    count: int = 5,
    every: int = 5,
    keyframes: bool = True,
    settings: SimulationSettings | None = None,
) -> SceneRecord:
    """A scene of sand particles that drift apart, with keyframes at the first and the third frame."""
    settings = settings or SimulationSettings()
    random = np.random.default_rng(7)
    time = np.arange(frames) * every * settings.time_step
    start, velocity = random.uniform(0.3, 0.7, (count, 3)), random.normal(size=(count, 3))
    position = (start + time[:, None, None] * velocity).astype(np.float32)
    velocities = np.tile(velocity.astype(np.float32), (frames, 1, 1))
    states = None
    if keyframes:
        at = np.array([0, 2])
        near_identity = np.eye(3) + 0.1 * random.normal(size=(2, count, 3, 3))
        states = Keyframes(
            at * every,
            position[at],
            velocities[at],
            random.normal(size=(2, count, 3, 3)).astype(np.float32),
            near_identity.astype(np.float32),
        )
    return SceneRecord(
        name,
        "sand",
        settings,
        SAND,
        time,
        position,
        np.full(count, 1e-4, np.float32),
        velocities[0],
        velocities,
        states,
    )


def hand_written(path: Path, name: str = "mine", frames: int = 3, count: int = 4) -> Path:
    """A trajectory file as a user writes it with h5py: the least that the format asks for."""
    with h5py.File(path, "w") as file:
        file.attrs["format"], file.attrs["version"] = "pcnclaws.trajectories", 1
        scene = file.create_group(f"scenes/{name}")
        scene.attrs.update(
            {
                "material": "sand",
                "time_step": 5e-4,
                "grid_nodes": 20,
                "gravity": [0, -9.8, 0],
                "wall_distance": 0.1,
                "boundary": "slip",
                "density": 1000,
                **SAND,
            }
        )
        scene["time"] = np.arange(frames) * 0.01
        scene["position"] = np.random.default_rng(3).uniform(0.3, 0.7, (frames, count, 3))
        scene["volume"] = np.full(count, 1e-4)
    return path


def written(path: Path, *records: SceneRecord) -> Path:
    """The path of a trajectory file with these scenes, or with one small one."""
    write_scenes(path, records or (recording(),))
    return path
