"""Colours of particles by a field of theirs, in one scale for all motions and frames of a picture."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.colors import Colormap, Normalize

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.rendering.labels import material_colour
from pcnclaws.simulation.particle_fields import FIELDS, INTERNAL, ParticleFields

MATERIAL, BODY, PLASTIC = "material", "body", "plastic_strain"
# Everyday words for fields.
WORDS = {"strain": "hencky_norm", "stress": "von_mises_stress"}
SCALARS = tuple(name for name in FIELDS if name not in ("velocity", "deformation", "kirchhoff_stress", "cauchy_stress"))
BODIES = colormaps["tab10"]
# At most so many frames are looked at for the ends of the scale, which leave out this share of the particles.
LOOKED_AT, LEFT_OUT = 24, 0.005

Colours = Float[np.ndarray, "particles 3"]


class Scale(NamedTuple):
    """Colours of numbers, with the label of their axis."""

    ends: Normalize
    colours: Colormap
    label: str


class Colouring:
    """Colours of the particles of some motions.

    motions  the same fields of which are looked at
    word     material, body, speed, strain, stress, pressure, plastic_strain, a field, a parameter
    colours  name of a map of matplotlib
    ends     of the scale; None: those of the motions
    apart    with `material`, whether motions have colours of their own
    raises   UserError for an unknown word with the nearest known one, and for a field that a motion does not have
    """

    def __init__(
        self,
        motions: Sequence[ParticleFields],
        word: str = MATERIAL,
        colours: str = "viridis",
        ends: tuple[float, float] | None = None,
        apart: bool = False,
    ) -> None:
        self._motions, self._apart = motions, apart
        self._name = _field_of(word, motions)
        self.scale: Scale | None = None
        if colours not in colormaps:
            raise unknown_name("colour_map", colours, [name for name in colormaps if not name.endswith("_r")])
        if self._name not in (MATERIAL, BODY):
            low, high = self._ends() if ends is None else ends
            self.scale = Scale(Normalize(low, high, clip=True), colormaps[colours], motions[0].label(self._name))

    def at(self, motion: int, frame: int) -> Colours | None:
        """Colours of a frame of a motion, None for those of its material."""
        fields = self._motions[motion]
        if self._name == MATERIAL:
            if not self._apart or not motion:
                return None
            return np.tile(BODIES(motion % BODIES.N)[:3], (len(fields.record.volume), 1))
        if self.scale is None:
            body = fields.fixed[BODY]
            own = np.array([material_colour(fields.record.material), *(BODIES(k)[:3] for k in range(BODIES.N))])
            return own[body % len(own)]
        values = self._values(motion, frame)
        return self.scale.colours(self.scale.ends(values))[:, :3]

    def _values(self, motion: int, frame: int) -> np.ndarray:
        return self._motions[motion].at(frame, [self._name])[self._name].astype(np.float64)

    def _ends(self) -> tuple[float, float]:
        found = []
        for number, fields in enumerate(self._motions):
            count = len(fields.record.time)
            for frame in np.unique(np.rint(np.linspace(0, count - 1, min(LOOKED_AT, count))).astype(int)).tolist():
                found.append(self._values(number, frame))
        values = np.concatenate(found)
        low, high = (float(np.quantile(values, share)) for share in (LEFT_OUT, 1.0 - LEFT_OUT))
        if low == high:  # one colour for all: the middle of the map
            room = 0.1 * abs(low) or 1.0
            return low - room, high + room
        return low, high


def _field_of(word: str, motions: Sequence[ParticleFields]) -> str:
    """The field that a word names, and that all motions have."""
    name = WORDS.get(word, word)
    if name in (MATERIAL, BODY):
        return name
    for fields in motions:
        record = fields.record
        internal = [one for one in fields.moving if one.startswith(INTERNAL)]
        if name == PLASTIC:
            name = next((one for one in internal if "plastic" in one), name)
        if name in fields.missing:
            raise UserError(f"colour={word}: {record.label} has none: {fields.missing[name]}")
        known = {*SCALARS, *fields.fixed, *internal} - {"id", "initial_affine"}
        if name == PLASTIC:
            kept = ", ".join(internal) or "none"
            why = fields.missing.get("deformation", f"its restart states keep the internal variables: {kept}")
            raise UserError(f"colour={word}: {record.label} has none: {why}")
        if name not in known:
            raise unknown_name("colour", word, {*known, MATERIAL, *WORDS, PLASTIC})
    return name
