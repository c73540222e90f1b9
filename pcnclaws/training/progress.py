"""Progress of a training run on the terminal: iterations, speed, loss and the time left."""

import time
from typing import Any

from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from pcnclaws.training.budget import WallClock

# Seconds between two looks at the loss: a look waits for the device.
REFRESH = 1.0


class TrainingProgress(Callback):
    """One bar for the whole run, and one line for every check."""

    def __init__(self, iterations: int, console: Console, clock: WallClock) -> None:
        self.iterations, self.console, self.clock = iterations, console, clock
        self._bar: Progress | None = None
        self._shown = self._began = 0.0
        self._first = 0

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._first, self._began = trainer.global_step, time.monotonic()
        columns = (
            TextColumn("training"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[note]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        self._bar = Progress(
            *columns,
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
            speed_estimate_period=120.0,
        )
        self._bar.add_task("training", total=self.iterations, completed=self._first, note="")
        self._bar.start()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        now = time.monotonic()
        if self._bar is None or now - self._shown < REFRESH:
            return
        self._shown = now
        loss = float(trainer.callback_metrics["loss"])
        self._bar.update(
            self._bar.task_ids[0],
            completed=trainer.global_step,
            note=f"{self._speed(trainer):.2f} it/s  loss {loss:.2e} m²",
        )

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        metrics, done = trainer.callback_metrics, trainer.global_step
        left = min((self.iterations - done) / max(self._speed(trainer), 1e-9), self.clock.left)
        total = "" if self.clock.budget else f"/{self.iterations}"
        self.console.print(
            f"iteration {done}{total}  loss {float(metrics['loss']):.2e} m²  check "
            f"{float(metrics['validation_mse']):.2e} m²  {self._speed(trainer):.2f} it/s  "
            f"left {_clock(left)}",
            highlight=False,
        )

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._stop()

    def on_exception(self, trainer: Trainer, pl_module: LightningModule, exception: BaseException) -> None:
        self._stop()

    def _stop(self) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _speed(self, trainer: Trainer) -> float:
        """Iterations a second, checks included."""
        return (trainer.global_step - self._first) / max(time.monotonic() - self._began, 1e-9)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
