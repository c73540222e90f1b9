"""Uncertainty of an estimation beyond the linear problem, from typed options: profiles, or samples of a posterior."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pcnclaws.atomic import replaced_file
from pcnclaws.commands.configuration import whole_number
from pcnclaws.commands.progress_bar import progress_bar
from pcnclaws.commands.typed_configs import EstimateConfig
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.estimation.posterior import Posterior, require_emcee, sampled
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.profiles import Profile, profile
from pcnclaws.estimation.uncertainty import Uncertainty, is_told

LINEAR, PROFILE, SAMPLE = KINDS = ("linear", "profile", "sample")
# The ends of an interval from so many independent samples are right to a fifth of its width.
FEW = 100
# In the folder of a search: where its samples are kept until it is finished.
KEPT = "checkpoints/samples.npz"


@dataclass(frozen=True)
class Explored:
    """What the residual itself says around an estimate, beside the linear problem.

    linear  intervals of the linear problem, by label
    """

    linear: Mapping[str, tuple[float, float]]
    profiles: tuple[Profile, ...] = ()
    posterior: Posterior | None = None

    def lines(self) -> list[str]:
        """Verdicts in words."""
        found = []
        for one in self.profiles:
            sides = [side for side, ends in zip(("below", "above"), one.bounded, strict=True) if not ends]
            if sides:
                where = " and ".join(sides)
                found.append(
                    f"the profile of {one.label} has no end {where}: its interval is as far as it was followed"
                )
        if self.posterior is not None:
            few = "" if self.posterior.effective >= FEW else ": too few, more samples= will move the intervals"
            found.append(f"the posterior's samples are worth {self.posterior.effective:.0f} independent ones{few}")
        return found

    def values(self) -> dict[str, Any]:
        """As plain values, for the result file."""
        values: dict[str, Any] = {"linear_intervals_95": {label: list(ends) for label, ends in self.linear.items()}}
        if self.posterior is None:
            values["profiles"] = {
                one.label: {
                    "values": list(one.values),
                    "deviance": list(one.deviance),
                    "interval_95": list(one.interval),
                    "bounded": list(one.bounded),
                }
                for one in self.profiles
            }
        else:
            one = self.posterior
            values |= {"samples": len(one.values), "effective": one.effective, "acceptance": one.acceptance}
        return values


def uncertainty_asked(config: EstimateConfig) -> str:
    """The kind of intervals; whatever does not go with it is refused before the search begins."""
    kind = config.uncertainty
    if kind not in KINDS:
        raise unknown_name("uncertainty", kind, KINDS)
    whole_number(config.samples, "samples", least=100)
    if kind != LINEAR and config.refinements:
        raise UserError(f"uncertainty={kind} is not accepted with refinements; accepted: uncertainty=linear")
    if kind == SAMPLE:
        require_emcee()
    return kind


def explored(
    config: EstimateConfig,
    problem: EstimationProblem,
    u: np.ndarray,
    found: Uncertainty,
    *,
    folder: Path,
) -> tuple[Uncertainty, Explored]:
    """The intervals that `uncertainty` asks for in place of those of the linear problem, and how they were made."""
    linear = {one.label: one.interval for one in found.estimates}
    if config.uncertainty == PROFILE:
        # start velocities and spins are sought for the sake of the others
        wanted = [number for number, unknown in enumerate(problem.unknowns.sought) if not unknown.is_motion]
        with progress_bar("profiles", 2 * len(wanted)) as advance:
            each = [profile(problem, u, found, number, advance) for number in wanted]
        seen = Explored(linear, profiles=tuple(one for one in each if one is not None))
        intervals = {one.label: one.interval for one in seen.profiles}
    else:
        count = whole_number(config.samples, "samples")
        with progress_bar("samples", count) as advance:
            posterior = sampled(
                problem, u, found, simulations=count, seed=int(config.seed), kept=folder / KEPT, progress=advance
            )
        seen = Explored(linear, posterior=posterior)
        intervals = {label: ends for label in posterior.labels if (ends := posterior.interval(label)) is not None}
    estimates = []
    for unknown, one in zip(problem.unknowns.sought, found.estimates, strict=True):
        if one.label in intervals:
            low, high = intervals[one.label]
            one = replace(one, interval=(low, high), identifiable=is_told(unknown, low, high))
        estimates.append(one)
    return replace(found, estimates=estimates), seen


def leave_explored(stem: Path, seen: Explored, truth: Mapping[str, float], title: str, picture: bool) -> list[Path]:
    """<stem>_profiles.png, or <stem>_samples.npz and <stem>_samples.png; returns what was written."""
    from pcnclaws.rendering.uncertainties import ProfilePanel, posterior_picture, profile_picture  # loads matplotlib

    written = []
    if seen.posterior is not None and seen.posterior.labels:
        path = stem.with_name(f"{stem.name}_samples.npz")
        with replaced_file(path) as part:
            np.savez_compressed(part, **dict(zip(seen.posterior.labels, seen.posterior.values.T, strict=True)))
        written.append(path)
        if picture:
            drawn = stem.with_name(f"{stem.name}_samples.png")
            written.append(posterior_picture(seen.posterior.labels, seen.posterior.values, truth, title, drawn))
    if seen.profiles and picture:
        panels = [
            ProfilePanel(
                label=one.label,
                values=one.values,
                deviance=one.deviance,
                interval=one.interval,
                linear=seen.linear[one.label],
                truth=truth.get(one.label),
            )
            for one in seen.profiles
        ]
        written.append(profile_picture(panels, title, stem.with_name(f"{stem.name}_profiles.png")))
    return written
