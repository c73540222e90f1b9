"""The text of the page of the measured beam, with places for its numbers."""

INTRODUCTION = """\
# The measured beam

A beam of silicone, 3 x 3 x 10 cm, clamped at one end, is let go; motion capture sees three markers on its
tip. From that one recording elasticity and damping are estimated. Then the second recording, with 52 g hung on
the edge of the tip, is predicted before anything is fitted to it, and a third one with 101 g, which we have
not seen, is written down. Everything on this page but for this text is made by

    python -m benchmarks problem=real_beam

from the [recordings](../benchmarks/real_beam/measured/README.md) ([json]({place}/real_beam.json), with
command, hardware, versions and commit).

![Motions of the tip: fitted, predicted, and to be measured]({place}/motions.png)
"""
MODEL = """\
## What is simulated

MLS-MPM with affine XPIC of order 2 (`simulation.transfer=axpic2`), {cells} cells over the width, two
particles along the edge of a cell, nu {nu:g}. The clamp is a sticky collider around z <= 0, with two layers of
cells of the beam inside. The weight is mass of the particles on the lower edge of the tip: it pulls *and* has
inertia, along the beam, too, where a weight on a thread would swing. The law is neo-Hookean, beside five
Maxwell elements of shear with relaxation times from 2 ms to 5 s, whose moduli fall with a power of these
times ([law.py](../benchmarks/real_beam/law.py)): long-term E, the modulus of the first element, and the
exponent. With the exponent 0 the loss factor hardly depends on the frequency; with a steep one the first
element alone is left, which is a viscosity; in between it is a spring beside a springpot, as rubber has it.
Motions for laws near that of a simulation are the simulation and what an oscillator with this law says of the
change ([surrogate.py](../benchmarks/real_beam/surrogate.py)): each fit of a power law with *held* is followed by
a simulation at its estimate, and repeated around it; a viscosity is simulated near its estimate; the other
rows of the next table are the oscillator's change from the power law. Markers move with the tip as one piece.
Where the face of the clamp and the axis of the beam are in the frame of the cameras is not known, and is
estimated along with the release: a marker-to-body registration by the motion. Nor do the markers tell whether
the beam was held straight: how far below that the tip was held is estimated, too (*held*).
"""
CHOICE = """\
## The law that the beam's own weight chooses

All of it from the first recording alone. *Left*: RMS over x and z of three markers in every frame after the
release.
"""
CHOSEN = """\
What is left of the power law is {power:.3f} mm, where a viscosity leaves {viscosity:.3f} mm, an even loss
factor {even:.3f} mm; {chosen_straight:.3f} mm if the tip is taken to have been straight. It is chosen by this
alone, and what is below is made with it. A loss factor that is the same at all frequencies is refused by the recording,
since a solid that loses so much also creeps, and the measured sag creeps less than that. The exponent lies in
between, and E in motion is {stiffer:.0%} above that in the long term. *Held* goes with it: a beam that is
softer in the long term than it rings must have sagged a little before it was let go. Nothing else in the
recordings tells so.
"""
ESTIMATES = """\
## The law from the beam's own weight

Estimate and 95 % interval. *Caught*: the share of the sag from which the free motion begins.
"""
INTERVALS = """\
Intervals: least squares over all frames. What the fit leaves is alike from frame to frame, so that intervals
come from the scores' covariance of Newey and West over lags of 1 s, with the critical values of Kiefer and
Vogelsang. Intervals of white noise would be {narrower:.1f} times as narrow for E, and {narrower_strength:.1f}
times for the strength. They say how well this model is fitted; the column on the right, outside of them, says
how far the model is from the beam.

**The grid's part of the damping.** The fitted motion rings with {ours:.3f} of the critical damping (measured:
{theirs:.3f}); the same beam without Maxwell elements has {grid:.4f}, which is the grid's: {part:.0%}.
"""
BARS = """\
## The loaded beam, predicted

Sag: the first marker of the tip in the last second. Frequency and damping: a damped oscillation over the
first 2 s. RMS: of the first marker's height over these, of half the range that it moves through. The release
of the loaded recording is read off where its marker begins to move; *release fitted* shifts the prediction in
time alone; *first turn read off* takes from the recording when and how deep the marker first turns, {turn:.2f} s
after it begins to move, and predicts from there. Bars: 5 %, 5 %, 15 %; what misses its bar is marked *missed*.
Sag and frequency of the loaded recording had been looked at before this law was tried; the law was chosen
without it.
"""
WHY = """\
**What is missed and why.** The loaded beam does not start as one that is let go: it falls and is caught. Its first turn
comes {later:.0f} ms late, as if the free motion had begun at {caught:.0%} of the sag, and no law makes up for that.
With the first turn read off, which is an initial condition and nothing of the law, the rest of the 2 s is within the
bar; with a viscosity it is not, since the phase runs away and the sag stays short. The sag hangs on *held*, which the
first recording alone asks for: had the tip been taken to have been straight, the same law would have given a sag
{straight_sag:+.1%} off, a frequency {straight_frequency:+.1%} off.

Fitted to the loaded recording afterwards, E is {young:+.1%} in the long term and {motion:+.1%} at its frequency, and
the loss factor {loss:.2f} times that of the first: this is left between the two recordings. The clamp may have its
part in it: its marker on the upper side is {slip:.2f} mm further along the beam after the loaded motion than before
({slip_bare:.2f} mm in the other recording), where the simulated clamp stays.
"""
STIFFENING = """\
**What a learned elastic law could add.** A network for elasticity that is given E has one thing to say of a beam that
bends: how its stiffness changes with the square of the deflection, since what is even in the strain cancels over a
cross section. Such a cubic spring, estimated along from the first recording, leaves {left:.4f} mm where without it
{without:.4f} mm are left; at the sag of the beam's own weight the stiffness changes by {share:+.1%} ({low:+.1%} to
{high:+.1%}). A network that is trained on this motion can explain hardly more than that, and none was.
"""
HEAVY = """\
## 101 g, not seen by us

[{file}]({place}/{file}) has the columns of the recordings, [{band}]({place}/{band}) the lower and upper ends
of a band that should hold 90 % of the points. The beam is let go at 0.5 s of the file's clock; a recording is
to be shifted so that it begins to move then. Sag {sag:.1f} mm ({low:.1f} to {high:.1f} mm at the end),
{frequency:.2f} Hz, damping {damping:.3f}.

Here both recordings are used: E goes on falling with the moment at the clamp, by 0 to 1.2 times as much as
between them; the damping is that of the loaded one, give or take 20 %; the start is as late and as far down as
in the loaded recording, times 0 to 2, and the release is known to 5 ms. What the fit leaves of the loaded
recording, scaled by sag and period, is the discrepancy, and places of the markers differ from recording to
recording as they do between the two. A band made in the same way for 52 g holds {covered:.0%} of that
recording, which it has seen.
"""
SHEAR = """\
A beam as thick as this one bends by shear, too: Timoshenko's sag is {more:.0%} larger than Euler-Bernoulli's,
and an E that is read off with the latter is too small by so much.
"""
GRID = """\
## Grid and Poisson's ratio

E {young:g} kPa without Maxwell elements; sag and frequency of the middle of the tip's face.
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

A neural law trained on this motion (what it could add is above); a weight that swings on its thread; a clamp
that gives way, which may be what is left between the two recordings.
"""
