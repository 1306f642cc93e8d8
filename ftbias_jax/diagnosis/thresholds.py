"""Every number that decides a verdict: unit, meaning, and why it is what it is.

The reasons, honestly: [noise] the chance that white noise of the stated size gets there, worked out; [owner] what still
matters to the owner of a robot; [physics] what robots and sensors can be; [dev] chosen on the development logs, which
have labels, so that their effects are named and the logs without one have none: no experiment has moved it since.
Starts of searches stand with their search or in the catalogue's entry, steps of solvers with the solver.
"""

# What a cause must gain, and how steadily
NATS_PER_DEGREE = 4.0
"""nats: the price of a free number, half the logarithm of the number of independent bins (BIC). [noise]"""
LEAST_GAIN = 12.0
"""nats: gain beyond that price, or of a ramp over a sudden step. [noise] One number gains so much by chance in 2 of
1e8 tries, six in 2 of 1e13."""
LEAST_SIGMAS = 0.08
"""Of one sample's noise: a smaller effect is real, perhaps, but means nothing. [owner]"""
LEAST_SHARE_OF_GAP = 0.02
"""Share of the gap that a further cause must remove: fitted forms are never quite the real ones. [dev] A slow effect on
the bias need not, if it removes all that is left: it is no error of the form of what follows the motion."""
SHARE_OF_JOINTS = 0.15
"""Share of the mean square error of the joints that a cause must remove: a smoother's own error follows the motion. Its
filter overstates it where the motion is smooth. Never more than LEADS. [dev]"""
STEADY = 1.3
"""Standard errors of the gain over blocks; one block that gains everything is one. [noise] 1 in 10 is as steady."""
SURE = 2.0
"""Times that the gain on unseen blocks exceeds what noise can have moved it by. [noise] 1 in 44."""
LEAST_BESIDE = 0.1
"""Squared innovations that events take away, per those that earlier causes did in the same time: they fit all. [dev]"""
MOST_CAUSES = 3
"""Causes of one diagnosis: no development log has more than two effects. [owner]"""
NEARLY = 0.1
"""Share of the gap that may be left for other pairs to be tried: none explains what is in no catalogue. [dev]"""
MOST_JUDGED = 3
"""Candidates of a round that are judged on blocks they have not seen. [dev]"""
BEAM = 2
"""First causes from which pairs are tried: the one that was found, and others that are not among the causes. [dev]"""
BEAM_SHARE = 0.3
"""Share of the best first cause's gain from which on another one may be the first of a pair. [dev]"""
BLOCK_SECONDS = 2.0
"""s: blocks that are held out and over which gains scatter; longer than a motion is correlated. [physics]"""
FOLDS = 4
"""Parts in which the blocks are held out. [dev]"""
PRIOR_STD = 30.0
"""Typical departures: a coordinate's prior; so wide that it moves nothing that the motion excites. [physics]"""

# Which candidates are fitted, and how far
WORTH_FITTING, WORTH_SEARCHING = 0.5, 0.15
"""Shares of the best preliminary gain to be fitted: of what one linearisation tells, of what may grow. [dev]"""
ROUGHLY, ROUGH_STEPS = 0.03, 4
"""Share of its whole gain that a first fit's last step gains less than, and its most steps. [dev]"""
POLISHED, POLISHED_SEARCHED = 0.85, 0.5
"""Shares of the best gain to be fitted to the end, as above. [dev]"""
STARTS_FITTED, PULLS_FITTED = 3, 4
"""Starts that are fitted of effects without a search of their own, and of elastic pulls. [dev]"""
MOST_ENTRIES, LEAST_ENTRY = 12, 0.01
"""Entries of a matrix that may be named, and the share of the gain that each must add. [dev]"""
LONGEST_JUMP = 1.5
"""s that a jump of the bias may take: no re-tare, overload or tool change lasts longer. [physics]"""

# The verdict
LEADS = 0.3
"""Noise sigmas of gap below which what single samples show is told first, and that a tool in the place of other causes
may leave where they leave as much. [owner]"""
SILENT = 0.12
"""Noise sigmas of gap below which nothing is missing: the joints' own error reaches half of it. [physics]"""
BEYOND_CHANCE = 3.0
"""Standard errors by which a gap, or a term of noise, exceeds chance. [noise] 1 in 740."""
USEFUL_SHARE, CHANCE = 0.5, 2.0
"""Share of the gap that causes must remove, and its standard errors beyond zero. [owner] [noise] 1 in 44."""
LEFT, FAINT = 0.05, 1 / 3
"""Shares of the gap in sigmas that an explanation may leave: of any gap, and of one that is next to nothing. [owner]"""

# Twins
ALIKE = 3.0
"""Standard errors of the comparison within which two explanations are as good. [noise] 1 in 740."""
LEAST_DIFFERENCE = 6.0
"""nats that decide, whatever the standard error. [noise] Odds of 400."""
CLOSE = 0.95
"""Share of the gain that a twin must reach. [dev]"""
FORM_LOSS = 0.02
"""Share of the gain that a real effect may lose by its form, which is never quite the catalogue's. [dev]"""
HOPELESS = 0.7
"""Share of the best gain below which a rough fit is not tried as a twin. [dev]"""
MOST_TWINS, MOST_TRIED = 3, 5
"""Twins that are told, and candidates that are tried: who lists more names nothing. [owner]"""

# Events
MOST_EVENTS = 8
"""Events of one log. [dev]"""
LEAST_EVENT = 60.0
"""nats of one event. [noise] The best of 800 pulses has 11 by chance; what other effects leave has more. [dev]"""
MOST_OF_LOG, LONGEST_EVENT, SURELY_EVENT = 0.35, 5.0, 3.0
"""Share of the log; s that one may last; s up to which it is sure to be one. [physics] [dev]"""
MOST_OF_LOG_IF_SEEN, SEEN = 0.7, 0.75
"""Share of the log, and of the events, that a filter's search for contact takes for it, too. [physics] In 49 logs
without contact it finds a tenth of a second of it. [dev]"""
CREST = 10.0
"""Standard deviations of accelerations that nobody recorded: an arm that stops and goes reaches as many. [physics]"""
LEAST_LEVER = 0.03
"""m from the centre of mass at which one of the pushes acts that no acceleration makes: the setup's is off by less.
[physics]"""
LEAST_HAT, LEAST_SHARE_OF_HAT = 10.0, 0.005
"""nats, and share of the largest, of the tents at an event's end. [dev]"""
CLEAR_HATS = 2
"""Hats in a row that do not matter, less one, between two events. [dev]"""
MARGIN, MARGIN_SHARE = 0.1, 0.6
"""s, and share of its length, by which a pulse is widened before events are merged and trimmed. [dev]"""

# Plausibility
FARTHEST, LONGEST_CABLE, UNDETERMINED = 5.0, 2.0, 1.0
"""m: farthest anchor, longest cable of a robot, and standard error beyond which nothing is said of it. [physics]"""
LIKE_A_ROTATION = 0.8
"""Share of leaks that a turn or an arm makes up, to be one. [noise] Of 200 drawn at random none has it; mean 0.1."""
ENTRY_STD = 3.0
"""Typical departures: an entry of a matrix a priori, 6 % of the load of another axis. [physics]"""
NEAR_LIMIT, EQUAL = 0.97, 0.97
"""Shares: of a limit to be at it; of the best gain to be as good. [dev]"""
LEAST_WAY = 0.02
"""Share of the gain that each further way in which a tool swings must add. [dev]"""

# Terms of what is not in the catalogue
CLEARLY, AS_WELL = 1.02, 0.98
"""Of the merit of effects that explain a log, and of the gap they remove unseen, that terms must have. [dev]"""
SHARE_PER_NUMBER = 0.005
"""Share of its gain that a term's free number costs: no real effect has quite its form. [dev]"""
MOST_CANCELLED = 100.0
"""Times that a part of a term may be larger than what all of them do together: beyond, none of them is known. [physics]
The parts of a spring a metre long, on a robot that moves by a few centimetres, cancel to a thirtieth."""
MOST_NUMBERS, MOST_TERMS = 14, 3
"""Coefficients of a term on any channel; terms. [owner]"""
TERM_WORTH, TERM_WORTH_FAR, TERM_GOES_ON = 0.25, 0.08, 0.5
"""Shares of the best merit: on the grid to be fitted, the second where the grid is coarse; of a rough fit from one of
several starts to be fitted further. [dev]"""
TERMS_FITTED, FORMS_OF_A_DRIVE, NOISE_FORMS_FITTED = 10, 2, 2
"""Terms, forms of one drive, and forms of noise that are fitted. [dev]"""
NOISE_BETTER, TERM_WINDOWS = 1.05, 64
"""Gain of a term of noise per that of an effect; windows of samples that it needs. [dev]"""
MOST_TIMES = 60
"""Changes of one log that are told as something switched: who lists more describes noise. [owner]"""
HANDOVER, TOUCHED = 0.5, 3.0
"""s from when a load is taken up or put down, in which grippers close and open; standard deviations of an innovation
that is then taken for touch. [physics]"""
LEAST_POWER = 25.0
"""Of a spectrum's median: a line. [noise] 1 in 3e7 frequencies."""
LEAST_WARMING, LEAST_TURN = 0.3, 0.02
"""K, rad: ranges of temperature, a thermometer's noise, and of a joint below which nothing follows them. [physics]"""

# Single samples: spikes, size of the noise
LEAST_RATE, LEAST_LOST, HEALTHY_RATE = 5e-4, 3, 1e-4
"""Share and number of samples, lost or wild, that change an estimate; share that is lost in order. [owner] [physics]"""
SURPRISING = 8.0
"""nats of a count against HEALTHY_RATE. [noise] 1 in 16,000."""
SPIKE, MIDDLE, OFF_NEIGHBOURS = 6.0, 4.0, 0.4
"""Sigmas of a spike (noise: 1 in 5e8) and of what heavy tails fill (1 in 16,000); neighbours' share. [noise] [dev]"""
LEAST_SPIKES, LONGEST_RUN, TAILS, LEAST_HITS = 4, 2, 10, 3
"""Rows of spikes; samples of one; rows in between that are tails; spikes of a channel with a size. [dev]"""
FEW_SPIKES = 0.2
"""Of the rate of the worst channel: a channel with less has no spikes. [dev]"""
QUIETER, LOUDER, LOUDER_IF_COLOURED = 0.87, 1.15, 1.5
"""Noise per stated noise: data sheets and warm electronics are no better; vibration leaks everywhere. [physics]"""
STATED_WITHIN, SURELY_LOUDER, SURELY_QUIETER = 0.02, 4.0, 8.0
"""Relative error of a stated noise; standard errors beyond. [noise] Quieter is one band of two: twice the error."""
COLOURED, CLIP = 1.25, 3.0
"""Ratio of two bands' standard deviations that matters for weights; sigmas of an event. [owner] [dev]"""
LEAST_WINDOWS, LEAST_SCATTER = 8, 0.2
"""Windows to measure noise in; stated sigmas that a spike exceeds. [physics]"""
LEAST_BINS = 20
"""Bins with a reading, without which no gap is told from a bias: 6 levels and 6 drifts leave so few. [noise]"""

# Single samples: lattices, flat tops, the clock
COARSE = 0.5
"""Sigmas: a finer lattice adds less than 2 % to the noise variance. [owner]"""
LEAST_SHARE_ON_LATTICE, LATTICE_TOLERANCE = 0.9, 0.05
"""Share of samples, the rest may be spikes; steps, float32 rounds much finer. [physics]"""
LEAST_TIES, MOST_TIES, FLAT_TOP_NATS = 5, 0.95, 20.0
"""Samples at one extreme value; share that is a dead axis; nats. [noise] 2 in 1e9."""
AROUND_CLIPPED = 10
"""Samples about a clipped one that noise may have sorted. [noise] 1.5 sigmas below a limit 3 in 4 have one so near."""
LONGEST_GAP, HOLE, MADE_UP = 0.5, 1.5, 2.5
"""s of a hole; periods of a hole, and of it with a short neighbour, which makes up for it. [physics]"""
ON_TICK, MOST_ON_TICK, MOST_PERIODS = 0.3, 0.9, 4.5
"""Periods off a tick; share of stamps on one; periods of the usual interval: a steady clock. [dev]"""

# Single samples: jitter, noise that grows
JITTER_NATS, JITTER_VISIBLE, MOST_JITTER = 10.0, 0.3, 0.1
"""nats; sigmas where the wrench changes fastest; s, more is vibration. [noise] 8 in 1e6. [owner] [physics]"""
LOUD, ACROSS, EVEN, FEW_WINDOWS = 5.0, 0.25, 0.6, 5
"""Variance across dW/dt of an event; its share, and the upper half's, of jitter; windows to ignore. [dev]"""
CORRELATED = 0.3
"""From a sample to the next, of an error along dW/dt that is vibration: jitter is independent, 0. [physics]"""
GROWTH_NATS, CERTAIN, GROWTH_VISIBLE = 12.0, 2.0, 1.15
"""nats, as LEAST_GAIN, and standard errors; loudest tenth per rest. [noise] 1 in 44. [owner]"""
MOVES, LEAST_REST, FAR_SQUARES = 0.03, 1e-3, 25.0
"""Of the fastest joint; of the mean variance; squares per variance, five sigmas, that are noise. [physics] [dev]"""
SLOW, RESTED = 0.1, 0.02
"""Of the speed in the fastest tenth; share of samples at rest that shows the noise there. [dev]"""

# Logs of one robot over time
FEWEST_POOLED, MOST_POOLED, POOLED_SHARE = 4, 16, 0.25
"""Latest logs that are diagnosed together, and their share of all: what began before them is in all of them. [dev]"""
