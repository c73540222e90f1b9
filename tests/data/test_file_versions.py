"""Which version of the trajectory file a scene needs, and that either gives the scene back."""

import shutil
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from recordings import recording

from pcnclaws.data.hdf5 import read_scenes, write_scenes
from pcnclaws.errors import UserError
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.loads import Load
from pcnclaws.mpm.settings import SimulationSettings

SURROUNDED = SimulationSettings(
    5e-4,
    0.25,
    gravity=(0.0, -1.0, 0.5),
    domain=((-1.0, 0.0, -1.0), (1.0, 3.0, 1.0)),
    friction=0.2,
    colliders=(
        Collider.sphere((0.5, 0.2, 0.5), 0.1, friction=0.3, velocity=(0.0, 1.0, 0.0), end=2.0),
        Collider.box((-0.5, 0.0, 0.0), (0.0, 0.1, 0.2), contact="sticky"),
    ),
    loads=(Load((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), force=(1.0, 0.0, 0.0), start=0.1),),
)


@pytest.mark.parametrize(
    ("settings", "version"),
    [
        (SimulationSettings(), 1),
        (SimulationSettings(grid_spacing=1 / 30, boundary=VERSION_1_STICK), 1),
        (SimulationSettings(boundary="slip"), 2),
        (SimulationSettings(domain=None), 2),
        (SURROUNDED, 2),
        (replace(SURROUNDED, start_time=0.3), 2),
    ],
)
def test_settings_come_back_from_the_first_version_that_holds_them(
    settings: SimulationSettings, version: int, tmp_path: Path
) -> None:
    one = replace(recording(), settings=settings)
    given = np.random.default_rng(0).normal(size=(len(one.time), len(settings.colliders), 3))
    one = replace(one, impulses=given) if settings.colliders else one
    write_scenes(tmp_path / "x.h5", [one])
    with h5py.File(tmp_path / "x.h5") as file:
        assert file.attrs["version"] == version
    shutil.copy(tmp_path / "x.h5", tmp_path / "of_others.h5")  # which a child reads
    for name in ("x.h5", "of_others.h5"):
        (read,) = read_scenes(tmp_path / name)
        assert read.settings == settings
        assert (read.name, read.material, read.parameters) == (one.name, one.material, one.parameters)
        assert read.keyframes is not None
        assert one.keyframes is not None
        for whole, again in ((one, read), (one.keyframes, read.keyframes)):
            arrays = {name: value for name, value in vars(whole).items() if isinstance(value, np.ndarray)}
            for field, values in arrays.items():
                np.testing.assert_array_equal(getattr(again, field), values)
                assert getattr(again, field).dtype == values.dtype


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda scene: scene.attrs.modify("walls", "slip, sticky"), "the same contact of six walls"),
        (lambda scene: scene.attrs.modify("walls", ", ".join(["slippy"] * 6)), "did you mean 'slip'"),
        (lambda scene: scene.attrs.create("domain", np.zeros((2, 2))), "@domain is not 2 x 3 finite numbers"),
        (lambda scene: scene["colliders/0"].attrs.modify("shape", "ball"), "colliders/0.shape='ball' is not known"),
        (lambda scene: scene["colliders/1"].attrs.modify("low", [np.nan] * 3), "three finite numbers"),
        (lambda scene: scene["loads/0"].attrs.modify("forces", 1.0), "did you mean 'force'"),
    ],
)
def test_what_is_wrong_with_the_surroundings_is_one_line(change, fault: str, tmp_path: Path) -> None:
    write_scenes(tmp_path / "x.h5", [replace(recording(), settings=SURROUNDED)])
    with h5py.File(tmp_path / "x.h5", "r+") as file:
        scenes = file["scenes"]
        assert isinstance(scenes, h5py.Group)
        change(next(iter(scenes.values())))
    with pytest.raises(UserError) as refused:
        read_scenes(tmp_path / "x.h5")
    assert fault in str(refused.value)
    assert "\n" not in str(refused.value)
