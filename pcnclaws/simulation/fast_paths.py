"""Fast paths of simulations: what a scene does not need is not computed, each behind a switch that is on by default."""

from dataclasses import dataclass, fields


@dataclass(frozen=True)
class Skips:
    """The switches of `simulation.skip.*`; docs/skips.md says which are exact and how far off the others may be.

    free_fall    no step for a stress-free body without spin before its first contact: its motion is known
    grid_window  only the part of the grid that particles touch (compiled step); off: the whole grid
    history      velocities are kept only at the frames asked for, C and F only at keyframes; off: at every frame
    rest         no step for a scene that has come to rest, in simulations without gradients
    """

    free_fall: bool = True
    grid_window: bool = True
    history: bool = True
    rest: bool = True

    @classmethod
    def none(cls) -> "Skips":
        """All switches off: everything is computed."""
        return cls(**{switch.name: False for switch in fields(cls)})
