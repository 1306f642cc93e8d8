"""Every number that decides a verdict: unit, meaning, and the reason for its value.

Reasons: [noise] computed probability that white noise of the stated size reaches it; [owner] what still matters to the
owner of a robot; [physics] what robots and sensors can be; [dev] chosen on the labelled development logs, so that their
effects are named and logs without an effect yield none; no experiment has changed it since. Starting points of searches
are defined with their search or in the catalogue's entry, step sizes with the solver.
"""

# What a cause must gain, and how steadily
PENALTY_PER_PARAMETER = 4.0
"""nats per free parameter: the BIC penalty, half the logarithm of the number of independent bins. [noise]"""
LEAST_GAIN = 12.0
"""nats that a cause must gain beyond that penalty, and a ramp beyond a sudden step. [noise] One parameter gains as much
by chance in 2 of 1e8 trials, six parameters in 2 of 1e13."""
LEAST_SIGMAS = 0.08
"""Standard deviations of one sample's noise; a smaller effect may be real but has no practical consequence. [owner]"""
LEAST_SHARE_OF_GAP = 0.02
"""Share of the gap that a further cause must remove, because fitted forms are never exact. [dev] A slow effect on the
bias need not if it removes all that is left: no form error of causes that follow the motion is slow."""
SHARE_OF_JOINTS = 0.15
"""Share of the mean square error of the joints that a cause must remove, because the smoother's own error follows the
motion. Its filter overstates that error where the motion is smooth. The result is capped at LEADS squared. [dev]"""
STEADY = 1.3
"""Standard errors over blocks that a gain must exceed; a gain made in one block has one. [noise] 1 in 10 by chance."""
SURE = 2.0
"""Ratio of a held-out gain to its change by noise, or of a parameter to its standard error. [noise] 1 in 44."""
LEAST_BESIDE = 0.1
"""Squared innovations that contact events must remove within their own time, as a share of what earlier causes removed
there; events of any shape always fit something. [dev]"""
MOST_CAUSES = 3
"""Maximum number of causes of one diagnosis: no development log has more than two effects. [owner]"""
NEARLY = 0.1
"""Share of the gap that may be left for other pairs of causes to be tried: none explains uncatalogued effects. [dev]"""
MOST_JUDGED = 3
"""Candidates of a round that are evaluated on held-out blocks. [dev]"""
BEAM = 2
"""Beam width: first causes from which pairs are tried, the accepted one and others not among the causes. [dev]"""
BEAM_SHARE = 0.3
"""Share of the best first cause's gain that another candidate needs to be tried as the first of a pair. [dev]"""
BLOCK_SECONDS = 2.0
"""s; length of the held-out blocks, over which gains scatter: longer than the correlation time of a motion.
[physics]"""
FOLDS = 4
"""Number of cross-validation folds of the blocks. [dev]"""
PRIOR_STD = 30.0
"""Typical departures; prior standard deviation of a coordinate, too wide to move what the motion excites. [physics]"""

# Which candidates are fitted, and how far
WORTH_FITTING, WORTH_SEARCHING = 0.5, 0.15
"""Shares of the best preliminary gain to be fitted: if one linearisation determines the gain, if it may grow. [dev]"""
ROUGHLY, ROUGH_STEPS = 0.03, 4
"""A first fit ends with a step that gains less than this share of its total gain, or after this many steps. [dev]"""
POLISHED, POLISHED_SEARCHED = 0.85, 0.5
"""Shares of the best gain from which a candidate is fitted to convergence, for the same two kinds. [dev]"""
STARTS_FITTED, PULLS_FITTED = 3, 12
"""Starting points that are fitted per effect without a search of its own, and per elastic pull. [dev]"""
MOST_ENTRIES, LEAST_ENTRY = 12, 0.01
"""Maximum number of matrix entries that are named, and the share of the gain that each must add. [dev]"""
LONGEST_JUMP = 1.5
"""s; longest duration of a bias jump: no re-tare, overload or tool change takes longer. [physics]"""

# The verdict
LEADS = 0.3
"""Noise sigmas; below this gap, findings in individual samples are reported first. Also the gap that a tool may leave
when it replaces other causes that leave as much. [owner]"""
SILENT = 0.12
"""Noise sigmas of gap below which the model lacks nothing: the joints' own error reaches half of it. [physics]"""
BEYOND_CHANCE = 3.0
"""Standard errors that a gap, or the gain of a noise term, must exceed. [noise] 1 in 740."""
USEFUL_SHARE, CHANCE = 0.5, 2.0
"""Share of the gap that causes must remove, and its standard errors above zero. [owner] [noise] 1 in 44."""
LEFT, FAINT = 0.05, 1 / 3
"""Shares of the gap, in sigmas, that an explanation may leave: of any gap, and of a very small one. [owner]"""

# Twins
ALIKE = 3.0
"""Standard errors of their difference within which two explanations count as equally good. [noise] 1 in 740."""
LEAST_DIFFERENCE = 6.0
"""nats; a smaller difference between explanations decides nothing, whatever its standard error. [noise] Odds of 400."""
CLOSE = 0.95
"""Share of a cause's gain that another effect must reach to be its twin. [dev]"""
FORM_LOSS = 0.02
"""Share of its gain that a real effect may lose because its form never matches the catalogue's exactly. [dev]"""
APART, LEAST_APART = 0.5, 1.0
"""Share of what shared parameters leave in the logs that separate ones would remove, and nats per second, from which
the logs do not share the causes. [owner]"""
HOPELESS = 0.7
"""Share of the best gain below which a candidate's rough fit is not tried as a twin. [dev]"""
MOST_TWINS, MOST_TRIED = 3, 5
"""Maximum numbers of twins that are reported and of candidates that are tried: a longer list names nothing. [owner]"""

# Events
MOST_EVENTS = 8
"""Maximum number of events in one log. [dev]"""
LEAST_EVENT = 60.0
"""nats of an event. [noise] The best of 800 pulses gains 11 by chance; residuals of other effects gain more. [dev]"""
MOST_OF_LOG, LONGEST_EVENT, SURELY_EVENT = 0.35, 5.0, 3.0
"""Maximum share of the log in events; s, longest event that no filter detects, because most other effects last longer;
s, duration up to which an event is certain. [physics] [dev]"""
MOST_OF_LOG_IF_SEEN, SEEN = 0.7, 0.75
"""Maximum share of the log in events that a filter's contact detection confirms, and the share of their duration that
it must cover. [physics] In 49 logs without contact the detection finds a tenth of a second of it. [dev]"""
ONE_WAY = 0.8
"""Difference between the shares of events and of free time in which a joint moves one way, from which the events are
friction in it: a worker would have to push at nine of ten of its strokes, and at no other time. [physics]"""
NEAR_END, TOUCH_BEGINS, TOUCH_SHARE = 0.6, 5.0, 0.05
"""s from the ends of a contact that a filter finds within which its real ends are; beyond half of it all is free;
standard deviations of the free force, and share of the force of contact, beyond which something touches. [noise]"""
LEAST_CHATTER, CHATTER = 30, 1.0
"""Number of bins from which chatter in contact is measured, and ratio of its variance to that of the noise from which
it counts: by chance the estimate is off by .3. [noise]"""
MOST_TENTS = 256
"""Maximum number of functions for the shapes of all events together: solving for more takes minutes. [owner]"""
CREST_FACTOR = 10.0
"""Crest factor: standard deviations that unrecorded accelerations reach when an arm stops and starts. [physics]"""
LEAST_LEVER = 0.03
"""m; lever arm about the centre of mass that at least one push must have, because accelerations act at the centre of
mass itself and the setup's is off by less. [physics]"""
LEAST_TENT, LEAST_SHARE_OF_TENT = 10.0, 0.005
"""nats, and share of the largest, below which tent basis functions at an event's ends are trimmed. [dev]"""
CLEAR_TENTS = 2
"""Index step between two relevant tent basis functions beyond which they belong to separate events. [dev]"""
MARGIN, MARGIN_SHARE = 0.1, 0.6
"""s, and share of its length, by which either end of a pulse is extended before events are merged and trimmed. [dev]"""

# Plausibility
FARTHEST, LONGEST_CABLE, UNDETERMINED = 5.0, 2.0, 1.0
"""m; farthest anchor and longest cable of a robot, and standard error beyond which they are undetermined. [physics]"""
LIKE_A_ROTATION = 0.8
"""Share of crosstalk that a rotation or lever arm explains, to be one. [noise] Of 200 at random none has it; mean
0.1."""
ENTRY_STD = 3.0
"""Typical departures; prior standard deviation of a crosstalk entry, 6 % of the load of another axis. [physics]"""
LARGEST_LEAK = 0.2
"""Share of one force that leaks into another, or of a torque into another, beyond which it is in doubt: data sheets
state 1 to 5 %, and four times that is another sensor. [physics]"""
NEAR_LIMIT, EQUAL = 0.97, 0.97
"""Share of a limit from which a parameter is at it; share of the best gain from which a gain is as good. [dev]"""
LEAST_WAY = 0.02
"""Share of the gain that each further degree of freedom of an oscillating tool must add. [dev]"""

# Terms of what is not in the catalogue
CLEARLY, AS_WELL = 1.02, 0.98
"""Ratios that terms need to replace explaining effects: of merit, and of the gap removed on held-out data. [dev]"""
SHARE_PER_NUMBER = 0.005
"""Share of a term's gain that each of its free parameters costs, because no real effect has exactly its form. [dev]"""
MOST_CANCELLED = 100.0
"""Ratio of one part of a term to the sum of all its parts beyond which none of them is determined. [physics] The parts
of a spring a metre long, on a robot that moves by a few centimetres, cancel to a thirtieth."""
FAR_FROM_ZERO = 3.0
"""Ratio of the mean of a term to its variation beyond which the zero of an angle or a place is too far away to be that
of a cable, which is mounted so that it is slack somewhere in the range of the motion. [physics]"""
MOST_NUMBERS, MOST_TERMS = 14, 3
"""Maximum numbers of coefficients of one term, on any channel, and of terms. [owner]"""
TERM_WORTH, TERM_WORTH_FAR, TERM_GOES_ON = 0.25, 0.08, 0.5
"""Shares of the best merit: from which a term of the grid is fitted, the same where the grid is coarse, and from which
the rough fit of one of several starts is continued. [dev]"""
TERMS_FITTED, FORMS_OF_A_DRIVE, NOISE_FORMS_FITTED = 10, 2, 2
"""Maximum numbers of terms, of forms per drive and of noise forms that are fitted. [dev]"""
NOISE_BETTER, TERM_WINDOWS = 1.05, 64
"""Ratio of the gain of a noise term to that of an effect which it must reach; sample windows that it needs. [dev]"""
MOST_TIMES = 60
"""Maximum number of switching times reported for one log: a longer list describes noise. [owner]"""
HANDOVER, TOUCHED = 0.5, 3.0
"""s around a pick-up or put-down, while grippers close and open; innovation in sigmas that is then contact.
[physics]"""
LEAST_POWER = 25.0
"""Ratio of a peak to its spectrum's median from which it is a spectral line. [noise] 1 in 3e7 frequencies."""
LEAST_WARMING, LEAST_TURN = 0.3, 0.02
"""K, rad: ranges of temperature (a thermometer's noise) and of a joint from which their terms are tried. [physics]"""

# Single samples: spikes, size of the noise
LEAST_RATE, HEALTHY_RATE = 5e-4, 1e-4
"""Share of wild samples that changes an estimate; a healthy system's share. [owner] [physics]"""
LEAST_LOST = 5e-3
"""Share of lost samples that is worth a look at the driver: it costs a quarter of that in precision. [owner]"""
SURPRISING = 8.0
"""nats; log-likelihood ratio of a count against HEALTHY_RATE that is significant. [noise] 1 in 16,000."""
SPIKE, MIDDLE, OFF_NEIGHBOURS = 6.0, 4.0, 0.4
"""Sigmas of a spike (noise: 1 in 5e8), and from which heavy tails are counted (1 in 16,000); largest deviation of a
spike's neighbours, as a share of its own. [noise] [dev]"""
LEAST_SPIKES, LONGEST_RUN, TAILS, LEAST_HITS = 4, 2, 10, 3
"""Minimum number of rows with spikes; longest run of spikes; samples between MIDDLE and SPIKE that indicate heavy
tails; spikes that a channel needs for an estimate of their size. [dev]"""
FEW_SPIKES = 0.2
"""Share of the worst channel's spike rate below which a channel counts as free of spikes. [dev]"""
QUIETER, LOUDER, LOUDER_IF_COLOURED = 0.87, 1.15, 1.5
"""Ratios of measured to stated noise that are lower, higher, and higher if coloured: data sheets and warm electronics
are no more exact; vibration couples in everywhere. [physics]"""
STATED_WITHIN, SURELY_LOUDER, SURELY_QUIETER = 0.02, 4.0, 8.0
"""Relative error of a stated noise; standard errors beyond it for higher and for lower noise. [noise] Lower noise is
measured in one band of two, which doubles the error."""
COLOURED, CLIP = 1.25, 3.0
"""Ratio of two frequency bands' standard deviations that matters for weights; sigmas of an event. [owner] [dev]"""
LEAST_WINDOWS, LEAST_SCATTER = 8, 0.2
"""Minimum number of windows for measuring noise; least scatter in a test for spikes, in stated sigmas. [physics]"""
LEAST_BINS = 20
"""Minimum number of bins with a reading: fewer cannot separate a gap from a bias of 6 levels and 6 drifts. [noise]"""

# Single samples: lattices, flat tops, the clock
COARSE = 0.5
"""Sigmas; a lattice with a smaller step adds less than 2 % to the noise variance. [owner]"""
LEAST_SHARE_ON_LATTICE, LATTICE_TOLERANCE = 0.9, 0.05
"""Share of samples on the lattice (the rest may be spikes); tolerance in steps: float32 rounds much finer. [physics]"""
LEAST_TIES, MOST_TIES, FLAT_TOP_NATS = 5, 0.95, 20.0
"""Minimum number of samples at one extreme value; share from which the axis is dead; nats. [noise] 2 in 1e9."""
AROUND_CLIPPED = 10
"""Samples around a clipped one that may be biased, as noise decides which of them are clipped. [noise] At 1.5 sigmas
below a limit, 3 in 4 samples have a clipped one this near."""
LONGEST_GAP, HOLE, MADE_UP = 0.5, 1.5, 2.5
"""s; longest gap. Sampling periods from which an interval is a gap, and from which it still is one together with a
short neighbour that may make up for it. [physics]"""
ON_TICK, MOST_ON_TICK, MOST_PERIODS = 0.3, 0.9, 4.5
"""Limits for a steady clock: periods from a tick; share of stamps within that; periods of the usual interval. [dev]"""

# Single samples: jitter, noise that grows
JITTER_NATS, JITTER_VISIBLE, MOST_JITTER = 10.0, 0.3, 0.1
"""nats; sigmas added where the wrench changes fastest; s, more is vibration. [noise] 8 in 1e6. [owner] [physics]"""
LOUD, ACROSS, EVEN, FEW_WINDOWS = 5.0, 0.25, 0.6, 5
"""Normalised variance across dW/dt of an event; limits for jitter of the ratio across to along, and upper to lower half
of the band; windows to ignore. [dev]"""
CORRELATED = 0.3
"""Lag-one correlation of the error along dW/dt from which it is vibration; jitter is independent, with 0. [physics]"""
GROWTH_NATS, CERTAIN, GROWTH_VISIBLE = 12.0, 2.0, 1.15
"""nats, as LEAST_GAIN; standard errors; noise ratio of a log's loudest tenth to rest. [noise] 1 in 44. [owner]"""
MOVES, LEAST_REST, FAR_SQUARES = 0.03, 1e-3, 25.0
"""Share of the fastest joint's rms speed; share of the mean variance that is left at rest at least; ratio of a square
to the variance, five sigmas, at which it is clipped. [physics] [dev]"""
SLOW, RESTED = 0.1, 0.02
"""Share of the fastest tenth's speed below which a robot rests; share of such samples that shows rest noise. [dev]"""

# Logs of one robot over time
FEWEST_POOLED, MOST_POOLED, POOLED_SHARE = 4, 16, 0.25
"""Fewest and most latest logs that are diagnosed together; their share of all: earlier causes are in all of them.
[dev]"""
