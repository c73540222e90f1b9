"""Double precision in, double precision out; single precision as before."""

import csv
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from recorded_scenes import recorded, small_cube

from pcnclaws.data.dataset import Timeline
from pcnclaws.data.generation import generate_data_set, read_split
from pcnclaws.data.hdf5 import read_scenes, write_scenes
from pcnclaws.data.sampling import DataSetPlan
from pcnclaws.errors import UserError
from pcnclaws.evaluation.frames import at_frames_of
from pcnclaws.geometry.shapes import particles
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.observe import observe
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import Keyframes, SceneRecord

TYPES = {"float32": torch.float32, "float64": torch.float64}


def arrays_of(record: SceneRecord) -> dict[str, np.ndarray]:
    """The arrays of numbers that a record holds, but for the times."""
    keyframes = record.keyframes
    assert keyframes is not None
    found = {name: getattr(record, name) for name in ("position", "volume", "initial_velocity", "velocity")}
    return found | {f"keyframes/{one.name}": getattr(keyframes, one.name) for one in fields(Keyframes)[1:-1]}


@pytest.fixture(scope="module", params=list(TYPES))
def record(request: pytest.FixtureRequest) -> SceneRecord:
    laws = analytic_laws(MATERIALS["sand"])
    return simulate_records(
        [small_cube(request.param)], laws, FramePlan(30, 5, 10, velocities=True), Execution(TYPES[request.param])
    )[0]


def test_records_and_their_files_have_the_precision_of_the_run(record: SceneRecord, tmp_path: Path) -> None:
    write_scenes(tmp_path / "x.h5", [record])
    (again,) = read_scenes(tmp_path / "x.h5")
    with h5py.File(tmp_path / "x.h5") as file:
        for name, values in arrays_of(record).items():
            dataset = file[f"scenes/{record.name}/{name}"]
            assert isinstance(dataset, h5py.Dataset)
            assert values.dtype == dataset.dtype == record.name
            np.testing.assert_array_equal(arrays_of(again)[name], values)
            assert arrays_of(again)[name].dtype == values.dtype
    frames = Timeline(again, "initial").frames(0, 20, 5)
    assert frames.dtype == record.name
    assert at_frames_of(again, again, 5).position.dtype == record.name


def test_numbers_beyond_single_precision_are_refused_in_double_precision_too(tmp_path: Path) -> None:
    (fine,) = recorded(small_cube(), dtype=torch.float64)
    for name, value in (("volume", 1e-60), ("initial_velocity", 1e60)):
        values = getattr(fine, name).copy()
        values[0] = value
        write_scenes(tmp_path / "x.h5", [replace(fine, **{name: values})])
        with pytest.raises(UserError, match=f"'{name}'"):
            read_scenes(tmp_path / "x.h5")


def test_markers_have_the_digits_of_the_recording(record: SceneRecord, in_process, tmp_path: Path) -> None:
    write_scenes(tmp_path / "x.h5", [record])
    assert in_process(observe, "observe", "file=x.h5", "markers=1", "output=m.csv", "picture=false").status == 0
    with (tmp_path / "m.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    seen = np.array([[float(row[axis]) for axis in "xyz"] for row in rows]).reshape(record.position.shape)
    difference = np.abs(seen - record.position).max()
    assert difference < 1e-15 if record.name == "float64" else 1e-9 < difference < 1e-7


def test_a_data_set_in_double_precision_is_made_again_where_it_is_single(tmp_path: Path) -> None:
    body = particles(particles_per_edge=3)
    plan = DataSetPlan(
        MATERIALS["sand"],
        body=body,
        steps=10,
        train_scenes=1,
        validation_scenes=1,
        keyframe_every=5,
        precision="float64",
    )
    files = generate_data_set(plan, tmp_path)
    (made,) = read_split(tmp_path, "train")
    assert {values.dtype.name for values in arrays_of(made).values()} == {"float64"}
    write_scenes(files["train"][0], [replace(made, position=made.position.astype(np.float32))])
    generate_data_set(plan, tmp_path)
    np.testing.assert_array_equal(read_split(tmp_path, "train")[0].position, made.position)
