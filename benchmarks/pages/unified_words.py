"""The text of the page of the unified law, with places for its numbers."""

INTRODUCTION = """\
# One law for three kinds of body

    python -m pcnclaws.train experiment=unified_multi
    python -m pcnclaws.simulate material=unified law=outputs/runs/unified_multi \\
        parameters.plasticine_share=0 parameters.sand_share=1

The material `unified` holds elasticity, plasticine and sand: both moduli, τ_Y and φ, and how much of plasticine and of
sand is in the body, `plasticine_share` and `sand_share`, each from 0 to 1; elasticity has what they leave. Shares that
add up to more than 1 are divided by their sum. Its analytic laws ([laws/unified.py](../pcnclaws/laws/unified.py)) are,
with the shares p and s,

    τ = (1 - p - s) τ_FixedCorotated + (p + s) τ_Hencky
    h' = h + p (h'_VonMises - h) + s (h'_DruckerPrager - h)

so that a body of one kind is one of that material, to rounding, and what it does not read changes nothing. Between
kinds, the flow of a step is a part of what a kind would flow, and goes on in the next one: strain nears the yield
surface within steps, the sooner the larger the share, so that it depends on the time step. This is a way from one kind
to another that stays bounded, and no law of any known body.

`model=pcnclaws_unified` ([laws/neural_unified.py](../pcnclaws/laws/neural_unified.py)) is one pair of networks. Both
see the shares as further inputs; τ_Y and φ come in times the share of the kind that reads them. The last layer has rows
for each kind, which are mixed by the shares. Stress is otherwise that of the default model, and flow the default return
of plasticine and that of sand, by their shares: an elastic body does not yield, and Hencky energy can only be
released, whatever the weights are (tests/laws/test_unified.py). The mixture is that of the analytic laws: it is built
in, not learned.

A data set has scenes of one kind after the other, each drawn from the ranges of its own material: 36 to train on,
twelve of each kind. Weights do not ship: `law=pretrained material=unified` is refused. Written by `make tables` from
the JSON files in [results/unified](results/unified), which `make unified` makes."""

ERRORS = """\
## Errors on the nine reference objects

MSE [m²], beside the law of each material alone, `training=short` of 400 iterations from twelve scenes. The unified law
has the same recipe with {iterations} iterations of batches as large; the training took {minutes:.0f} minutes, beside
other programs on two cores."""

SEEDS = """\
Trainings of sand alone differ from seed to seed: eight of them reach {least} to {most}, the median is {median}. The one
beside is seed 0, the best of the eight."""

OTHER_TASKS = "Means over the scenes of all kinds, by the tasks of [evaluation.md](evaluation.md):"

BETWEEN = """\
## Between the kinds

Thrown cubes with other shares, {steps} steps of three motions each: the largest kinetic, elastic and potential energy
over that of the start, and the error to the analytic law's motion, the worst of the three."""

WHICH = """\
## Which material it is

The first {steps} steps of the nine objects, simulated by the analytic law of their material, and explained by the law
that ships of each of the three: Gauss-Newton of at most {iterations} iterations, from the best of mid-range and
{screening} other starts, without a guess ([json](results/unified/which_material.json), `python -m benchmarks
problem=which_material`). The same question of one motion is

    python -m pcnclaws.estimate -m material=elasticity,plasticine,sand observation.file=markers.csv scene.shape=cube

The columns are the residuals, the root of the mean squared error of a coordinate [mm]; the least is the answer. The law
of another material did not always reach its best fit within so few iterations."""

SEEN = "All particles, in {frames} frames, of known start velocity:"

SEEN_WITH_NOISE = """\
{markers} markers on the surface, in {frames} frames, each coordinate with a noise of {noise:g} mm, a tenth of them
missing; start velocity and spin are not known:"""
