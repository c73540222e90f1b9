"""The text of the page of the measured beam, with places for its numbers."""

INTRODUCTION = """\
# The measured beam

A beam of silicone, 3 x 3 x 10 cm, clamped at one end, is let go from straight; motion capture sees three
markers on its tip. From that one recording E and viscosity are estimated. Then the second recording, with 52
g hung on the edge of the tip, is predicted before anything is fitted to it, and a third one with 101 g, which
we have not seen, is written down. Everything on this page but for this text is made by

    python -m benchmarks problem=real_beam

from the [recordings](../benchmarks/real_beam/measured/README.md) ([json]({place}/real_beam.json), with
command, hardware, versions and commit).

![Motions of the tip: fitted, predicted, and to be measured]({place}/motions.png)
"""
MODEL = """\
## What is simulated

MLS-MPM with APIC, {cells} cells over the width, two particles along the edge of a cell, nu {nu:g}. The clamp
is a sticky collider around z <= 0, with two layers of cells of the beam inside. The weight is mass of the
particles on the lower edge of the tip: it pulls *and* has inertia, along the beam, too, where a weight on a
thread would swing. The law is neo-Hookean, with a viscosity of shear whose stress follows the rate of strain
within 2 ms ([law.py](../benchmarks/real_beam/law.py)): a Newtonian one of this size would need time steps a
tenth as long, and APIC damps in each of them. Motions between the simulated ones come by scaling with
sqrt(E), and by interpolation in viscosity and gravity ([surrogate.py](../benchmarks/real_beam/surrogate.py)).
Markers move with the tip as one piece. Where the face of the clamp and the axis of the beam are in the frame
of the cameras is not known, and is estimated along with the release: a marker-to-body registration by the
motion.
"""
ESTIMATES = """\
## E and viscosity from the beam's own weight

Estimate and 95 % interval. *Creep*: the place of rest moves on by a share of the sag, 1 - exp(-t / T) of it
at t after the release; a third and a fourth number, for what two leave.
"""
INTERVALS = """\
Intervals: least squares over x and z of three markers in every frame after the release. What the fit of two
numbers leaves, {rms:.2f} mm RMS where markers are good to 0.003 mm, is alike from frame to frame, so that
intervals come from the scores' covariance of Newey and West over lags of 1 s, with the critical values of
Kiefer and Vogelsang. Intervals of white noise would be {narrower:.1f} times as narrow for E, and
{narrower_eta:.0f} times for the viscosity. They say how well this model is fitted; the columns on the right,
outside of them, say how far the model is from the beam.

**The grid's part of the damping.** The fitted motion rings with {ours:.3f} of the critical damping (measured:
{theirs:.3f}); the same beam without viscosity has {grid:.3f}, which is APIC's: {part:.0%}. The viscosity
above is what is left to add; the material's own would be about {larger:.2f} times as large.
"""
BARS = """\
## The loaded beam, predicted

Sag: the first marker of the tip in the last second. Frequency and damping: a damped oscillation over the
first 2 s. RMS: of the first marker's height over these, of half the range that it moves through. The release
of the loaded recording is read off where its marker begins to move; *release fitted* shifts the prediction in
time alone. Bars: 5 %, 5 %, 15 %; what misses its bar is marked *missed*.
"""
WHY = """\
Fitted to the loaded recording afterwards, E is {young:+.1%} and the viscosity {eta:.1f} times that of the
first: no E and viscosity have both. The beam is softer under the larger load than its own weight tells (both
sags creep, as the table above says; rubber is softer at larger strains, too, which these two recordings alone
do not separate), and its damping hardly depends on the frequency, while that of a viscosity is proportional
to it. The loaded beam does not start as one that is let go from straight, either: within the first 0.1 s it
falls and is caught again. No law of this page knows of these, and the RMS, which adds up a phase that runs
away, an offset and an envelope, shows all of them.
"""
HEAVY = """\
## 101 g, not seen by us

[{file}]({place}/{file}) has the columns of the recordings, [{band}]({place}/{band}) the lower and upper ends
of a band that should hold 90 % of the points. The beam is let go at 0.5 s of the file's clock; a recording is
to be shifted so that it begins to move then. Sag {sag:.1f} mm ({low:.1f} to {high:.1f} mm at the end),
{frequency:.2f} Hz, damping {damping:.3f}.

Here both recordings are used, with creep: E goes on falling with the moment at the clamp, by 0 to 1.2 times
as much as between them; the viscosity goes on along the power of the frequency that leads from one to the
other, give or take 20 %; the release is known to 5 ms. What the fit leaves of the loaded recording, scaled by
sag and period, is the discrepancy, and places of the markers differ from recording to recording as they do
between the two. A band made in the same way for 52 g holds {covered:.0%} of that recording, which it has
seen.
"""
SHEAR = """\
A beam as thick as this one bends by shear, too: Timoshenko's sag is {more:.0%} larger than Euler-Bernoulli's,
and an E that is read off with the latter is too small by so much.
"""
GRID = """\
## Grid and Poisson's ratio

E {young:g} kPa without viscosity; sag and frequency of the middle of the tip's face.
"""
ERRORS = """\
Two errors pull in opposite directions. The clamp holds nodes, between which the field is not quite held, so
that coarse beams are softer at the root; cells lock, so that coarse beams are stiffer, the more the nearer nu
is to 0.5. An E that was estimated on one grid holds on that grid: it carries this difference, {sag:+.1%} of
the sag and {frequency:+.1%} of the frequency between the grid of the fit and the finest one. All of it is one
and the same factor for the bare and the loaded beam to {ratio:.1%}, so that it is not what the prediction
misses.
"""
RATIOS = """\
On {cells} cells, with the same E. Locking and what nu does to the beam itself act as one stiffness: with nu
{nu:g} the sag alone would make E {change:+.1%}, while the product of sag and squared frequency stays within
{product:.1%}. Sag and frequency do not tell nu from E, and the estimates above are for nu {used:g}, whose
convergence is in the table.

## Not done

The same through a neural law; a weight that swings on its thread; damping that does not grow with the
frequency; softening with strain. The last two are likely what the prediction misses.
"""
