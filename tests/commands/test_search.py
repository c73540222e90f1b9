"""Searches: Optuna chooses the jobs of a sweep, and an interrupted search goes on as if it had not been."""

import math
import sys
from typing import Any

import pytest

from pcnclaws.errors import SimulationDiverged

RATES = "training.learning_rate=tag(log,interval(1e-4,1e-2))"
SEARCH = ("--multirun", "hydra/sweeper=search", RATES, "model.width=8,16", "hydra.sweeper.metric=error")


class Killed(BaseException):
    """Ends a search where it stands, as a signal does."""


def runner(killed_at: int | None = None):
    """A task with its best result at a learning rate of 1e-3, which fails above 5e-3; and the options of its jobs."""
    ran: list[tuple[float, int]] = []

    def task(config: Any) -> dict[str, float]:
        rate = config.training.learning_rate
        ran.append((rate, config.model["width"]))
        if len(ran) == killed_at:
            raise Killed
        if rate > 5e-3:
            raise SimulationDiverged("it left")
        return {"seconds": 1.0, "error [m^2]": math.log10(rate / 1e-3) ** 2}

    return task, ran


def statuses(out: str) -> list[str]:
    return [line.split()[-2] for line in out.splitlines() if "training.learning_rate-" in line]


@pytest.mark.slow
def test_a_search_goes_on_from_where_it_was_interrupted(in_process, tmp_path):
    pytest.importorskip("optuna")
    options = (*SEARCH, "hydra.sweeper.trials=12")
    task, whole = runner()
    first = in_process(task, "train", *options, "hydra.sweeper.study=whole")
    assert len(whole) == 12
    assert len(set(whole)) == 12
    assert all(1e-4 <= rate <= 1e-2 and width in (8, 16) for rate, width in whole)

    task, before = runner(killed_at=11)
    with pytest.raises(Killed):
        in_process(task, "train", *options)
    task, after = runner()
    again = in_process(task, "train", *options)
    assert [*before[:-1], *after] == whole
    assert statuses(again.out) == statuses(first.out)
    assert again.status == first.status == (1 if "failed" in statuses(first.out) else 0)

    best = min((rate for rate, _ in whole), key=lambda rate: abs(math.log(rate / 1e-3)))
    assert f"with training.learning_rate={best:g}" in again.out
    task, more = runner()
    in_process(task, "train", *SEARCH, "hydra.sweeper.trials=13")
    assert len(more) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("hydra.sweeper.metric=err",), "hydra.sweeper.metric='err' is not known; accepted: error, seconds; did you"),
        (("hydra.sweeper.trials=0",), "hydra.sweeper.trials=0 is not accepted; accepted: a whole number from 1"),
        (("hydra.sweeper.sampler=tpx",), "hydra.sweeper.sampler='tpx' is not known; accepted: random, tpe; did you"),
    ],
)
def test_a_wrong_search_is_refused(arguments, message, in_process):
    pytest.importorskip("optuna")
    task, _ = runner()
    outcome = in_process(task, "train", *SEARCH[:4], *arguments)
    assert outcome.status == 2
    assert f"error: {message}" in outcome.err


def test_a_search_of_nothing_is_refused(in_process):
    pytest.importorskip("optuna")
    outcome = in_process(lambda config: None, "train", *SEARCH[:2], "seed=1")
    assert outcome.status == 2
    assert "hydra/sweeper=search has nothing to seek" in outcome.err


def test_a_search_without_optuna_names_the_command_that_installs_it(in_process, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    outcome = in_process(lambda config: None, "train", *SEARCH)
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "pip install 'pcnclaws[sweep]'" in outcome.err


def test_an_interval_without_a_search_is_refused(in_process):
    outcome = in_process(lambda config: None, "train", "--multirun", RATES)
    assert outcome.status == 2
    assert "is an interval to search in; accepted: a list of values, or hydra/sweeper=search" in outcome.err
