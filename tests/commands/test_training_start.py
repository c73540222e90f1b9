"""What segments start from where the data hold no full states, and which of the settings are the user's then."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from conftest import Outcome
from training_bodies import recorded

from pcnclaws.commands.training_start import settled_start
from pcnclaws.commands.typed import plain
from pcnclaws.commands.typed_configs import TrainConfig
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.records import SceneRecord

OF_INITIAL = {"iterations": 120, "batch_segments": 2, "check_every": 30, "start": "initial"}
LENGTHS = {"first": 150, "last": 400}


@pytest.fixture(scope="module")
def records() -> list[SceneRecord]:
    return recorded(3)


@pytest.fixture(scope="module")
def positions_only(records: list[SceneRecord]) -> list[SceneRecord]:
    return [replace(record, keyframes=None) for record in records]


class Settle:
    """A task that notes the settled options of every job, and what it says of them."""

    def __init__(self, scenes: list[SceneRecord] | None) -> None:
        self.scenes, self.training, self.notes = scenes, list[dict[str, Any]](), list[str]()

    def __call__(self, config: TrainConfig) -> None:
        settled, notes = settled_start(config, LawSimulator(analytic_laws(MATERIALS["elasticity"])), self.scenes)
        self.training.append(plain(settled.training))
        self.notes += notes


@pytest.mark.parametrize(
    ("options", "changed"),
    [
        (("experiment=elasticity_multi",), {}),
        (
            # as by default with keyframes, and yet chosen
            ("training.iterations=200", "training.segment_length.first=20"),
            {"iterations": 200, "segment_length": {"first": 20, "last": 400}},
        ),
        (("training.segment_length={first: 20, last: 20}",), {"segment_length": {"first": 20, "last": 20}}),
        (("training=thorough",), {"iterations": 1500, "check_every": 150}),
        (("debug=fast",), {"iterations": 2, "check_every": 1}),
        (
            ("experiment=nclaws_elasticity",),
            {
                "iterations": 300,
                "check_every": 10,
                "batch_segments": None,
                "segment_length": {"first": 25, "last": 200},
            },
        ),
    ],
)
def test_without_keyframes_all_that_nobody_states_is_that_of_training_initial(
    in_process: Callable[..., Outcome],
    positions_only: list[SceneRecord],
    options: tuple[str, ...],
    changed: dict[str, Any],
) -> None:
    settle = Settle(positions_only)
    assert in_process(settle, "train", *options).status == 0
    for option, value in {**OF_INITIAL, "segment_length": LENGTHS, **changed}.items():
        assert settle.training[0][option] == value, option
    assert "trains on positions only, since no scene has keyframes after its start: training.start" in settle.notes[0]


def test_every_job_of_a_sweep_states_its_own_options(
    in_process: Callable[..., Outcome], positions_only: list[SceneRecord]
) -> None:
    settle = Settle(positions_only)
    assert in_process(settle, "train", "training=thorough,spline", "--multirun").status == 0
    assert [training["iterations"] for training in settle.training] == [1500, 400]


@pytest.mark.parametrize("option", ["training=keyframes", "training.start=keyframes"])
def test_keyframes_that_were_asked_for_and_are_not_there_are_refused(
    in_process: Callable[..., Outcome], records: list[SceneRecord], positions_only: list[SceneRecord], option: str
) -> None:
    done = in_process(Settle([records[0], positions_only[1]]), "train", option)
    assert done.status == 2
    assert "training.start=keyframes is not accepted: not every scene (scene 'body_1'" in done.err
    assert "accepted: training=initial" in done.err
    assert in_process(Settle(records), "train", option).status == 0


def test_full_states_at_both_ends_alone_are_no_keyframes_to_start_from(
    in_process: Callable[..., Outcome], records: list[SceneRecord]
) -> None:
    keyframes = records[0].keyframes
    assert keyframes is not None
    ends = keyframes.at(np.array([0, -1]))
    settle = Settle([replace(records[0], keyframes=ends)])
    assert in_process(settle, "train").status == 0
    assert settle.training[0]["start"] == "initial"
    generated = Settle(None)
    assert in_process(generated, "train", "data.keyframe_every=500").status == 0
    assert generated.training[0]["start"] == "initial"
    assert "data.keyframe_every=500 leaves none within simulation.steps=500" in generated.notes[0]
    assert in_process(generated, "train").status == 0
    assert generated.training[1]["start"] == "keyframes"
