"""Sweeper that searches. It stands here because Hydra takes plugins from the package `hydra_plugins` alone."""

from typing import Any

from hydra.core.plugins import Plugins
from hydra.plugins.launcher import Launcher
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig


class SearchSweeper(Sweeper):
    """Hydra's side of a search: its launcher runs the jobs, see pcnclaws.commands.search.

    settings  options of conf/hydra/sweeper/search.yaml
    """

    def __init__(self, **settings: Any) -> None:
        self.settings = settings

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        self.hydra_context, self.config = hydra_context, config
        self._command, self._outputs = str(config.hydra.job.name), str(config.paths.outputs)
        self._jobs: Any = getattr(task_function, "__self__", None)  # of pcnclaws.commands.jobs
        self._launcher: Launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> None:
        """Runs the jobs that the search chooses; `arguments` are fixed options, and those that are sought."""
        from pcnclaws.commands.search import Search, SearchSettings  # other programs of Hydra load this file, too

        def run(overrides: list[list[str]], first: int) -> list[Any]:
            self.validate_batch_is_legal(overrides)
            return [one.return_value for one in self._launcher.launch(overrides, initial_job_idx=first)]

        Search(SearchSettings(**self.settings), arguments, self._command, self._outputs).run(run, self._jobs)
