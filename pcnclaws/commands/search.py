"""Search for options: Optuna chooses the jobs of a sweep after what came of those before.

The study is a file of plain values beside the logs of sweeps. What is asked for depends on the seed and on the finished
trials alone, so that a search that was interrupted goes on as if it had not been.
"""

import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import IntervalSweep, Override

from pcnclaws.commands.jobs import Jobs
from pcnclaws.commands.sweeps import Job
from pcnclaws.data.locks import written_alone
from pcnclaws.errors import UserError, unknown_name

SWEEPER = "hydra.sweeper"
DIRECTIONS, SAMPLERS = ("minimize", "maximize"), ("tpe", "random")
STUDY, JOURNAL, JOB = "search", "study.journal", "job"
# Runs jobs with these overrides, the first of which has that number.
Run = Callable[[list[list[str]], int], list[Job]]


@dataclass(frozen=True)
class SearchSettings:
    """Options of hydra.sweeper; UserError for those that are not accepted."""

    metric: str | None
    direction: str
    trials: int
    at_once: int
    sampler: str
    seed: int
    study: str | None

    def __post_init__(self) -> None:
        for option, choices in (("direction", DIRECTIONS), ("sampler", SAMPLERS)):
            if getattr(self, option) not in choices:
                raise unknown_name(f"{SWEEPER}.{option}", getattr(self, option), choices)
        for option, least in (("trials", 1), ("at_once", 1), ("seed", 0)):
            value = getattr(self, option)
            if not isinstance(value, int) or value < least:
                raise UserError(f"{SWEEPER}.{option}={value} is not accepted; accepted: a whole number from {least}")


class Search:
    """A search and its study.

    arguments  the command line: options with one value are fixed, the others are sought
    entry      name of the command
    outputs    the option paths.outputs
    """

    def __init__(self, settings: SearchSettings, arguments: Sequence[str], entry: str, outputs: str) -> None:
        self.settings = settings
        parsed = OverridesParser.create().parse_overrides(list(arguments))
        self._space = {one.get_key_element(): _distribution(one) for one in parsed if one.is_sweep_override()}
        self._fixed = [one.input_line or "" for one in parsed if not one.is_sweep_override()]
        if not self._space:
            raise UserError(
                "hydra/sweeper=search has nothing to seek; accepted: an option with several values, or with a range, "
                "as in 'training.learning_rate=tag(log,interval(1e-4,1e-2))'"
            )
        asked = [entry, sorted(arguments), settings.metric, settings.direction, settings.sampler, settings.seed]
        name = f"{entry}_{sha256(json.dumps(asked).encode()).hexdigest()[:12]}"
        self.folder = Path(settings.study or Path(outputs) / "sweeps" / name)

    def run(self, run: Run, jobs: Jobs) -> None:
        """Runs what is missing of the search, and says what was best; the table has the jobs of before, too.

        raises  UserError for a metric that the command does not have
        """
        with written_alone(self.folder, f"{SWEEPER}.study={self.folder}"):
            study = self._study()
            for job in (Job(**trial.user_attrs[JOB]) for trial in _ended(study)):
                jobs.remember(job)
            while trials := self._next(study):
                done = run([self._overrides(trial) for trial in trials], len(_ended(study)))
                for trial, job in zip(trials, done, strict=True):
                    self._tell(study, trial, job)
            print(self._best(study))

    def _study(self) -> Any:
        optuna = _optuna()
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        file = import_module("optuna.storages.journal").JournalFileBackend(str(self.folder / JOURNAL))
        storage = optuna.storages.JournalStorage(file)
        direction = self.settings.direction
        study = optuna.create_study(storage=storage, study_name=STUDY, direction=direction, load_if_exists=True)
        for trial in study.get_trials(states=[optuna.trial.TrialState.RUNNING]):  # of a process that has ended
            study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
            study.enqueue_trial(trial.params)
        return study

    def _next(self, study: Any) -> list[Any]:
        """The trials that run at the same time, those that were interrupted first; none where all are done."""
        ended, trials = len(_ended(study)), []
        for number in range(ended, min(self.settings.trials, ended + self.settings.at_once)):
            study.sampler = self._sampler(number)
            trials.append(study.ask(self._space))
        return trials

    def _sampler(self, number: int) -> Any:
        samplers = _optuna().samplers
        seed = self.settings.seed + number
        if self.settings.sampler == "random":
            return samplers.RandomSampler(seed=seed)
        with warnings.catch_warnings():  # constant_liar: of the trials that run at the same time
            warnings.simplefilter("ignore")
            return samplers.TPESampler(seed=seed, constant_liar=self.settings.at_once > 1)

    def _overrides(self, trial: Any) -> list[str]:
        return [*self._fixed, *_options(trial.params)]

    def _tell(self, study: Any, trial: Any, job: Job) -> None:
        value = None if job.status else self._value(job.numbers)
        trial.set_user_attr(JOB, job._asdict())
        if value is None or not math.isfinite(value):
            study.tell(trial, state=_optuna().trial.TrialState.FAIL)
        else:
            study.tell(trial, value)

    def _value(self, numbers: Mapping[str, float | None]) -> float | None:
        names = {name.partition(" [")[0]: name for name in numbers}
        metric = self.settings.metric or next(iter(names), None)
        if metric is None:
            raise UserError("hydra/sweeper=search needs a number to go by, and this command has none; accepted: train")
        if metric not in names:
            raise unknown_name(f"{SWEEPER}.metric", metric, names)
        return numbers[names[metric]]

    def _best(self, study: Any) -> str:
        done = study.get_trials(states=[_optuna().trial.TrialState.COMPLETE])
        if not done:
            return f"no job has a result; the search is kept in {self.folder}"
        best = study.best_trial
        options = " ".join(_options(best.params))
        return f"best of {len(done)} jobs: {best.value:.4g} with {options}; the search is kept in {self.folder}"


def _optuna() -> Any:
    """Optuna, which is there where this is called."""
    return import_module("optuna")


def _options(parameters: Mapping[str, Any]) -> list[str]:
    """What a trial says, as options; numbers with as many digits as one types again."""
    return [
        f"{name}={value:.6g}" if isinstance(value, float) else f"{name}={value}" for name, value in parameters.items()
    ]


def _ended(study: Any) -> list[Any]:
    """The trials whose jobs have ended, well or not."""
    return [trial for trial in study.get_trials(deepcopy=False) if JOB in trial.user_attrs]


def _distribution(override: Override) -> Any:
    """What an option may be: a number in an interval, on a logarithmic scale where tagged so, or one of its values."""
    distributions, value = _optuna().distributions, override.value()
    if not isinstance(value, IntervalSweep):
        return distributions.CategoricalDistribution(list(override.sweep_string_iterator()))
    low, high, log = value.start, value.end, "log" in value.tags
    try:
        if isinstance(low, int) and isinstance(high, int):
            return distributions.IntDistribution(low, high, log=log)
        return distributions.FloatDistribution(float(low or 0.0), float(high or 0.0), log=log)
    except ValueError as fault:
        raise UserError(f"{override.input_line}: {fault}; accepted: an interval from low to high") from fault
