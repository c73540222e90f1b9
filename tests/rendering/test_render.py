"""The command render: what a picture shows is counted in its pixels."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib import colormaps
from PIL import Image

import pcnclaws as pc
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.render import render
from pcnclaws.rendering.colouring import Colouring
from pcnclaws.rendering.montage import Montage
from pcnclaws.rendering.panels import Place, camera_for, panel
from pcnclaws.simulation.particle_fields import ParticleFields


@pytest.fixture(scope="module")
def motions() -> list[pc.Motion]:
    """Sand that falls, with F; and an elastic cube beside it, positions and velocities alone."""
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.3, 0.5), particles_per_edge=4)
    sand = pc.Scene(body, pc.analytic_law("sand"), velocity=(0.0, -2.0, 0.0), friction_angle=30.0, name="sand")
    rubber = pc.Scene(body, pc.analytic_law("elasticity"), velocity=(0.5, -1.0, 0.0), name="rubber")
    return [sand.simulate(80, 20, deformation=True), rubber.simulate(120, 20)]


@pytest.fixture
def drawn(in_process, motions, tmp_path: Path):
    for name, motion in zip(("a", "b"), motions, strict=True):
        write_scenes(tmp_path / f"{name}.h5", [motion.record])
    return lambda *arguments: in_process(render, "render", *arguments)


@pytest.mark.parametrize(
    "colour", ["material", "body", "speed", "strain", "stress", "pressure", "friction_angle", "equivalent_strain"]
)
def test_a_sheet_for_each_colour(colour: str, drawn, tmp_path: Path) -> None:
    outcome = drawn("trajectory=a.h5", f"colour={colour}", "size=80", "times=2", "output=x.png")
    assert (outcome.status, outcome.out, outcome.err) == (0, "wrote x.png: a\n", "")
    assert np.asarray(Image.open(tmp_path / "x.png").convert("RGB")).std() > 10.0


def test_colours_are_those_of_the_field_in_one_scale(motions) -> None:
    fields = [ParticleFields(motion.record) for motion in motions]
    colouring = Colouring(fields, "speed", "magma", (0.0, 4.0))
    for number, motion in enumerate(motions):
        speed = np.linalg.norm(motion.velocity[2].numpy(), axis=1)
        found = colouring.at(number, 2)
        assert found is not None
        np.testing.assert_allclose(found, colormaps["magma"](speed / 4.0)[:, :3], atol=1e-6)
    assert colouring.scale is not None
    assert colouring.scale.label == "speed [m/s]"


def test_motions_side_by_side_and_overlaid_are_where_they_are_at_a_time(motions) -> None:
    records = [motion.record for motion in motions]
    camera = camera_for(records, 120)
    fields = [ParticleFields(record) for record in records]
    beside = Montage(records, ["a", "b"], camera, Colouring(fields), oversample=1)
    assert beside.times() == pytest.approx([0.01 * k for k in range(7)])
    assert beside.times(3) == pytest.approx([0.0, 0.03, 0.06])
    # the first motion has ended: it stays where it is
    late = [Montage(records, ["a", "b"], camera, Colouring(fields), oversample=1).panels(t) for t in (0.04, 0.06)]
    assert np.array_equal(late[0][0], late[1][0])
    assert not np.array_equal(late[0][1], late[1][1])
    overlaid = Montage(records, ["a", "b"], camera, Colouring(fields, apart=True), overlaid=True, oversample=1)
    (both,) = overlaid.panels(0.06)
    empty = both.shape[0] * both.shape[1]
    shown = [np.count_nonzero((panel != both).any(2)) for panel in late[1]]
    assert all(0 < count < empty for count in shown)


def test_overlaid_motions_have_colours_of_their_own_and_a_legend(motions) -> None:
    records = [motion.record for motion in motions]
    fields, camera = [ParticleFields(record) for record in records], camera_for(records, 100)
    legend = Montage(records, ["a", "b"], camera, Colouring(fields, apart=True), overlaid=True).legend
    assert [name for name, _ in legend] == ["a", "b"]
    assert legend[0][1] != legend[1][1]
    assert not Montage(records, ["a", "b"], camera, Colouring(fields)).legend


def test_colliders_are_where_they_are_in_a_domain_of_any_size() -> None:
    pixels = []
    for scale in (1.0, 2.0):  # the same scene in other lengths is the same picture
        body = pc.Body.cube(side=0.2 * scale, centre=(0.5 * scale, 0.6 * scale, 0.5 * scale), particles_per_edge=4)
        floor = pc.Collider.plane(point=(0, 0.3 * scale, 0), normal=(0.3, 1, 0))
        box = pc.Settings(domain=((0, 0, 0), (scale,) * 3), grid_spacing=0.05 * scale, wall_distance=0.1 * scale)
        record = pc.Scene(body, pc.analytic_law("elasticity"), settings=box, colliders=[floor]).simulate(1, 1).record
        pixels.append(panel(record, 0, camera_for([record], 120)).astype(int))
    assert np.abs(pixels[1] - pixels[0]).mean() < 0.1


def test_plastic_strain_is_the_internal_variable_of_that_name() -> None:
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.3, 0.5), particles_per_edge=4)
    record = pc.Scene(body, pc.analytic_law("sand")).simulate(20, 10, deformation=True).record
    assert record.keyframes is not None
    strain = np.tile(np.linspace(0.0, 1.0, 64, dtype=np.float32), (3, 1))
    remembered = replace(record, keyframes=replace(record.keyframes, internal={"plastic_strain": strain}))
    colouring = Colouring([ParticleFields(remembered)], "plastic_strain", ends=(0.0, 1.0))
    found = colouring.at(0, 1)
    assert found is not None
    np.testing.assert_allclose(found, colormaps["viridis"](strain[0])[:, :3], atol=1e-6)


def test_the_camera_turns_rises_and_zooms(motions) -> None:
    record = motions[0].record
    eye = camera_for([record], 100, Place(90.0, 0.0)).eye
    assert eye[0] > 3.0
    assert eye[2] == pytest.approx(0.5)
    near, far = (camera_for([record], 100, Place(zoom=zoom)) for zoom in (2.0, 1.0))
    assert near.pixels_per_unit == pytest.approx(2.0 * far.pixels_per_unit)
    assert near.height == far.height


def test_a_gif_of_all_frames_and_one_of_so_many_seconds(drawn, tmp_path: Path) -> None:
    assert drawn("trajectory=a.h5", "colour=speed", "size=80", "frame_rate=10", "output=x.gif").status == 0
    with Image.open(tmp_path / "x.gif") as film:
        assert getattr(film, "n_frames", 1) == 5
        assert film.info["duration"] == 100
    outcome = drawn("trajectory=[a.h5,b.h5]", "size=80", "frame_rate=10", "seconds=0.3", "output=y.gif")
    assert outcome.out == "wrote y.gif: a, b, 3 pictures, 0.3 s\n"
    with Image.open(tmp_path / "y.gif") as film:
        assert (getattr(film, "n_frames", 1), film.width) == (3, 160)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # the reader leaves its pipes open
def test_an_mp4_has_the_pictures_of_the_film(drawn, tmp_path: Path) -> None:
    imageio = pytest.importorskip("imageio_ffmpeg")
    assert drawn("trajectory=a.h5", "size=81", "frame_rate=20", "output=x.mp4").status == 0
    frames = imageio.read_frames(str(tmp_path / "x.mp4"))
    about = next(frames)
    assert about["fps"] == pytest.approx(20.0)
    assert about["size"][0] == 82  # a whole number of pairs, as the format has them
    assert len(list(frames)) == 5


def test_pyvista_draws_the_same_scene(drawn, tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    pictures = []
    for renderer in ("matplotlib", "pyvista"):
        done = drawn("trajectory=a.h5", f"renderer={renderer}", "size=160", "times=1", f"output={renderer}.png")
        assert done.status == 0, done.err
        pictures.append(np.asarray(Image.open(tmp_path / f"{renderer}.png").convert("RGB")).astype(float))
    grey = [np.ptp(picture, axis=2) > 40.0 for picture in pictures]  # sand has a colour, the box has none
    assert (grey[0] & grey[1]).sum() > 0.9 * max(one.sum() for one in grey)
    assert np.abs(pictures[0] - pictures[1]).max() > 10.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "trajectory=null is not accepted; accepted: the path of a trajectory file"),
        (("trajectory=c.h5",), "c.h5: no such file"),
        (("trajectory=a.h5", "colour=sped"), "did you mean 'speed'?"),
        (("trajectory=b.h5", "colour=strain"), "F is in 0 of 7 frames (simulate keyframe_every=20"),
        (("trajectory=a.h5", "colour=plastic_strain"), "keep the internal variables: none"),
        (("trajectory=[a.h5,b.h5]", "colour=friction_angle"), "colour='friction_angle' is not known"),
        (("trajectory=a.h5", "colour_map=virdis", "colour=speed"), "did you mean 'viridis'?"),
        (("trajectory=a.h5", "colour_range=[1,0]", "colour=speed"), "colour_range=[1, 0] is not accepted"),
        (("trajectory=a.h5", "layout=overlayed"), "did you mean 'overlaid'?"),
        (("trajectory=a.h5", "renderer=vtk"), "renderer='vtk' is not known"),
        (("trajectory=a.h5", "elevation=90"), "elevation=90 is not accepted; accepted: a number from -89 to 89"),
        (("trajectory=a.h5", "size=1.5"), "size=1.5 is not accepted; accepted: a whole number from 64 to 4096"),
        (("trajectory=a.h5", "seconds=2"), "seconds=2 has no effect on a sheet"),
        (("trajectory=a.h5", "output=x.avi"), "output=x.avi ends like a file of another format"),
        (("trajectory=a.h5", "output=x"), "output=x ends in no known format; accepted: .png"),
        (("trajectory=[a.h5,b.h5]", "names=[a]"), "one for each of the 2 trajectories"),
    ],
)
def test_wrong_input_is_one_line(arguments, message: str, drawn, tmp_path: Path) -> None:
    outcome = drawn("output=x.png", *arguments) if "output" not in str(arguments) else drawn(*arguments)
    assert outcome.status == 2
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.h5", "b.h5"]


@pytest.mark.parametrize(
    ("module", "arguments", "extra"),
    [("imageio_ffmpeg", "output=x.mp4", "video"), ("pyvista", "renderer=pyvista", "pyvista")],
)
def test_a_missing_extra_is_named_with_the_command_that_installs_it(module, arguments, extra, drawn, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    outcome = drawn("trajectory=a.h5", arguments)
    assert outcome.status == 2
    assert f"pip install 'pcnclaws[{extra}]'" in outcome.err
