"""What a law from outside of the package costs beside the built-in law that it resembles, in the same step."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rich.markup import escape
from rich.table import Table

from benchmarks.cases import Case, Prepared
from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, whole
from benchmarks.context import BenchmarkContext
from benchmarks.own_material import CohesiveDruckerPrager, MooneyRivlin
from benchmarks.remembering_material import HardeningVonMises
from benchmarks.yardstick import seconds, spread
from pcnclaws.laws.elasticity import NeoHookean, StVKHencky
from pcnclaws.laws.materials import Material
from pcnclaws.laws.plasticity import DruckerPrager, VonMises
from pcnclaws.laws.registry import register

# A law of one's own may cost this much more.
AT_MOST = 1.1
_MODULI = {"youngs_modulus": (2e5, 6e5), "poissons_ratio": (0.1, 0.4)}
_SAND = {**_MODULI, "friction_angle": (18.0, 38.0)}
_METAL = {**_MODULI, "yield_stress": (2e3, 8e3)}


class Pair(NamedTuple):
    """A law from outside and the built-in one beside it, in materials that differ in nothing else."""

    words: str
    own: Material
    built_in: Material


PAIRS = {
    "mooney_rivlin": Pair(
        "Mooney-Rivlin beside neo-Hooke",
        Material("own_rubber", MooneyRivlin, None, _MODULI),
        Material("beside_rubber", NeoHookean, None, _MODULI),
    ),
    "cohesion": Pair(
        "Drucker-Prager with cohesion beside Drucker-Prager",
        Material("own_soil", StVKHencky, CohesiveDruckerPrager, {**_SAND, "cohesion": (5e2, 5e3)}),
        Material("beside_soil", StVKHencky, DruckerPrager, _SAND),
    ),
    "hardening": Pair(
        "von Mises with hardening beside von Mises",
        Material("own_metal", StVKHencky, HardeningVonMises, {**_METAL, "hardening_modulus": (1e4, 5e4)}),
        Material("beside_metal", StVKHencky, VonMises, _METAL),
    ),
}
WORK = ("forward", "gradient")


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Times of both laws in turns and their ratio, forward, and forward and backward with the gradient of E.

    {"precision", "rows": [{"pair", "work", "scenes", "own_ms", "built_in_ms", "ratio", "at_most"}]}; times of a step
    """
    chosen, steps, samples = names(options, "pairs", PAIRS), whole(options, "steps"), whole(options, "samples")
    scenes = whole(options, "scenes")
    rows: list[dict[str, Any]] = []
    orders = [(pair, work) for pair in chosen for work in WORK]
    for number, (pair, work) in enumerate(orders):
        context.advance(number, len(orders), f"{PAIRS[pair].words}, {work}")
        calls = {}
        for which in ("own", "built_in"):
            material: Material = getattr(PAIRS[pair], which)
            register(material)
            prepared = Prepared(Case(material.name, scenes=scenes, seed=context.seed), context.device, steps)
            calls[which] = getattr(prepared, work)(steps)
            calls[which]()
        times: dict[str, list[float]] = {which: [] for which in calls}
        for sample in range(samples):
            for which in list(calls)[:: 1 if sample % 2 else -1]:
                times[which].append(1e3 / steps * seconds(calls[which], context.device))
        ratios = sorted(own / built_in for own, built_in in zip(times["own"], times["built_in"], strict=True))
        rows.append(
            {
                "pair": pair,
                "words": PAIRS[pair].words,
                "work": work,
                "scenes": scenes,
                **{f"{which}_ms": spread(taken) for which, taken in times.items()},
                "ratio": ratios[len(ratios) // 2],
                "at_most": AT_MOST,
            }
        )
    context.advance(len(orders), len(orders), "done")
    return {"precision": "float32", "rows": rows}


def tables(document: Mapping[str, Any]) -> list[Table]:
    """Time of a step with either law, and the median of their ratio."""
    table = table_of("a law of one's own beside a built-in one", "laws")
    for header in ("work", "own [ms]", "built in [ms]", "ratio", "at most"):
        table.add_column(escape(header), justify="right")
    for row in document["results"]["rows"]:
        times = (f"{row[f'{which}_ms']['median']:.3g}" for which in ("own", "built_in"))
        table.add_row(row["words"], row["work"], *times, f"{row['ratio']:.2f}", f"{row['at_most']:g}")
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """A bar for the ratio of each pair."""
    rows = document["results"]["rows"]
    figure, axis = chart(height=1.2 + 0.4 * len(rows))
    for place, row in enumerate(rows):
        axis.barh(place, row["ratio"], 0.7, color=COLOURS[WORK.index(row["work"])])
        axis.text(0.05, place, f"{row['ratio']:.2f}", va="center", color="white")
    axis.axvline(AT_MOST, color="0.4", linewidth=1.0, linestyle="--")
    axis.set_yticks(range(len(rows)), [f"{row['words']}, {row['work']}" for row in rows], fontsize=7)
    axis.invert_yaxis()
    decorate(axis, "time of a step, own law / built-in law", "")
    axis.grid(False, axis="y")
    return [save(figure, folder / f"{document['problem']}.png")]
