"""How well each training scene is explained: which ones contradict the others, and what they are worth then."""

import math
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

# What a new error counts in the running mean of a scene's logarithmic errors: at least LEAST_SHARE, a mean of some
# twenty, since a false scene is false in some of its segments only, and its quiet ones would give it its weight back.
# The n-th counts FORGETTING/(n + FORGETTING): a scene that is seldom drawn forgets the untrained law all the same.
LEAST_SHARE, FORGETTING = 0.05, 4.0
# A scene whose error is this many times that of the median scene counts half in the robust loss; true scenes are
# within a factor of two of it at the end of a training, and of six on the way.
HALF = 3.0
# A scene that is explained so many times worse than the median one contradicts the others.
CONTRADICTS = 20.0
# Fewest scenes of which one can be said to be unlike the others.
FEWEST = 4


class SceneErrors:
    """Running means of the relative squared errors of the training scenes, by name.

    Logarithmic: the segments of a scene differ by powers of ten, and a law that learns leaves its old errors behind.
    """

    def __init__(self) -> None:
        self._logarithm: dict[str, float] = {}
        self._count: dict[str, int] = {}

    def note(self, names: Sequence[str], errors: Sequence[float]) -> None:
        """Takes the errors of a batch; those that are zero or not finite say nothing."""
        for name, error in zip(names, errors, strict=True):
            if math.isfinite(error) and error > 0.0:
                before, count = self._logarithm.get(name, math.log(error)), self._count.get(name, 0)
                share = max(LEAST_SHARE, FORGETTING / (count + FORGETTING))
                self._logarithm[name] = before + share * (math.log(error) - before)
                self._count[name] = count + 1

    def ratio(self, name: str) -> float:
        """Error of a scene over that of the median scene; 1 where nothing is known of it."""
        if len(self._logarithm) < FEWEST or name not in self._logarithm:
            return 1.0
        return math.exp(min(self._logarithm[name] - median(self._logarithm.values()), 300.0))

    def weights(self, names: Sequence[str]) -> list[float]:
        """What the scenes count in the robust loss, 1/(1 + (ratio/HALF)^2): hardly less than 1 where they agree."""
        return [1.0 / (1.0 + (self.ratio(name) / HALF) ** 2) for name in names]

    def contradicting(self) -> dict[str, float]:
        """The scenes that are explained worse than the others by more than CONTRADICTS, and how many times."""
        ratios = {name: self.ratio(name) for name in sorted(self._logarithm)}
        return {name: ratio for name, ratio in ratios.items() if ratio > CONTRADICTS}

    def state_dict(self) -> dict[str, Any]:
        return {"logarithm": dict(self._logarithm), "count": dict(self._count)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._logarithm = {str(name): float(value) for name, value in state.get("logarithm", {}).items()}
        self._count = {str(name): int(value) for name, value in state.get("count", {}).items()}
