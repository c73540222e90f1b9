"""What TensorBoard shows of a finished search, beside the curves of its iterations."""

import math
from collections.abc import Sequence
from pathlib import Path

from torch.utils.tensorboard import SummaryWriter

from pcnclaws.atomic import one_line_writing
from pcnclaws.estimation.uncertainty import Estimate

ENDS = ("low", "high")


def log_intervals(folder: Path, estimates: Sequence[Estimate], iterations: int, has_intervals: bool) -> None:
    """Writes the 95 % intervals as scalars interval/UNKNOWN/low and high, and all estimates as a table of its own page.

    folder         the folder of the search, whose curves are in tensorboard/
    iterations     that the search has taken
    has_intervals  whether the motion is fitted, without which there are none
    """
    rows = ["| | estimate | 95 % interval |", "|---|---|---|"]
    with one_line_writing(folder / "tensorboard"), SummaryWriter(str(folder / "tensorboard")) as writer:
        for estimate in estimates:
            told = estimate.identifiable
            known = told and has_intervals and all(map(math.isfinite, estimate.interval))
            for end, value in zip(ENDS, estimate.interval, strict=True) if known else ():
                writer.add_scalar(f"interval/{estimate.label}/{end}", value, iterations)
            low, high = estimate.interval
            interval = f"{low:.4g} to {high:.4g}" if known else "none"
            rows.append(f"| {estimate.label} | {f'{estimate.value:.4g}' if told else 'not told'} | {interval} |")
        writer.add_text("estimate", "\n".join(rows), iterations)
