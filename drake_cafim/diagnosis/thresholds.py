"""The thresholds on which a verdict depends: the meaning, the unit and the calibration of each.

No other file of the diagnosis holds such a number at module level; the numbers elsewhere are accuracies and sizes of
numerical methods, and a test lists them. Modules import the thresholds by name.
"""

# Noise of the recorded channels

EVEN_CLOCK_DEVIATION = 1e-3
"""Largest distance of a time stamp from an evenly sampled clock, as a share of a sampling interval, at which the
clock still counts as even. Unit: 1. Not calibrated: chosen."""
LOST_CLOCK_DEVIATION = 0.5
"""Distance of time stamps from an even clock, as a share of a sampling interval, from which on the recording is
treated as unevenly sampled. Unit: 1. Source: from half an interval on, another even instant is nearer."""
CLOCK_SMOOTHING_REACH = 0.012
"""Half width of the interval from which the motion between a sample and its instant on the even clock is estimated.
Unit: s. Not calibrated: chosen."""
REST_LASTING = 1.0
"""Time over which the dry friction that holds a resting joint is taken as the same. Unit: s. Not calibrated: chosen."""
RESTING_EFFORT_STD = 3.0
"""Standard deviation of the multiple of a resting joint's effort that dry friction takes away, of which 1 is true: so
wide that next to nothing is known of it. Unit: 1. Not calibrated: chosen."""
MASS_MATRIX_STD = 0.2
"""Relative standard deviation of the mass matrix by which positions and velocities are compared between samples. Unit:
1. Source: that of a link's inertials where only a model file is given."""
CUTS_SHARE_SURE = 0.75
"""Share of the cuts of the recordings that must name an effect for it not to be told as unsure. Unit: 1. Source: three
of four, as the file formats promise."""
EMPTY_SPECTRUM_SHARE = 1e-5
"""Standard deviation of a measured velocity or effort above half the Nyquist frequency, over its whole one, below which
it was filtered after it was measured. Unit: 1. Not calibrated: chosen, as a sensor of 16 digits has more noise."""
OTHER_NOISE_RATIO = 3.0
"""Ratio of a joint's inertia, or of the effort that acts there, under two models, or its inverse, from which on each of
the two is judged under its own noise. Unit: 1. Not calibrated: chosen, as the noise of the rows is in proportion."""
MOTION_NOISE_STDS = 1.2
"""Scatter of a channel's values over the standard deviation of its noise, from which on the channel counts as moving.
Unit: 1. Not calibrated: chosen, of noise alone the scatter is 1, within a few percent over a hundred samples."""
QUIET_FREQUENCY = 60.0
"""Frequency above which a robot hardly moves, so that a channel there contains its noise alone. Unit: Hz. Not
calibrated: chosen."""
SPECTRUM_SEGMENT_SAMPLES = 128
"""Number of samples of one periodogram. Unit: samples. Not calibrated: chosen."""
SPECTRUM_SEGMENT_TIME = 0.25
"""Least duration of one periodogram by which the correlation time of coloured noise is estimated: its frequencies are
the inverse of that apart. Unit: s. Not calibrated: chosen."""
MOTION_IN_SPECTRUM_STDS = 3.0
"""Power of a channel at one frequency above that of its noise, in standard deviations of the estimate, from which on
the motion counts as seen, and with it all below. Unit: 1. Not calibrated: chosen, as the error of one of the dozen
frequencies that are tried so reaches it in one recording of fifty."""
FEEDBACK_P_VALUE = 1e-6
"""p-value, per joint, below which efforts are said to follow the noise of the joint's sensors. Unit: 1. Not calibrated:
chosen, as where none do, what is simulated of it is next to nothing."""
COLOURED_NOISE_P_VALUE = 1e-6
"""p-value, per channel, below which noise that was stated as white is called correlated, and below which a spectrum
differs in shape from that of first-order correlated noise. Unit: 1. Not calibrated: chosen."""
STATED_NOISE_LOG_VARIANCE_REACH = 0.2
"""Largest difference of the logarithm of a variance from the stated one when a spectrum is compared with it. Unit: 1.
Not calibrated: chosen."""
ESTIMATED_NOISE_LOG_VARIANCE_REACH = 20.0
"""The same difference where the variance was estimated: so large that the variance is free. Unit: 1. Not calibrated:
chosen."""
LONGEST_CORRELATION_TIME = 0.05
"""Correlation time beyond which the quiet frequencies show only the slope of the spectrum, not its corner. Unit: s.
Not calibrated: chosen."""
LATTICE_DEVIATION = 0.01
"""Largest distance of a value from the lattice of a quantised channel, as a share of its step. Unit: 1. Not
calibrated: chosen."""
QUANTISED_WAY_INTERVAL = 0.05
"""Interval between the values from whose differences the path of a quantised channel is summed; noise averages out
within it. Unit: s. Not calibrated: chosen."""
LONGEST_ROUNDING_DWELL = 6.0 * LONGEST_CORRELATION_TIME
"""Longest time for which a channel stays within one quantisation step and still counts its rounding errors as noise:
windows see only the changes of errors that last longer. Unit: s. Not calibrated: chosen."""
SLOW_CHANNEL_EMPTY_SHARE = 0.2
"""Smallest share of empty rows for a channel to count as sampled more slowly than the others. Unit: 1. Not
calibrated: chosen."""
SLOW_CHANNEL_LONGEST_INTERVAL = 0.012
"""Longest interval between samples of a slow channel that is still interpolated. Unit: s. Not calibrated: chosen, a
fifth of a window."""
NOISE_ESTIMATE_GAP = 1.2
"""Duration of five samples over its usual value, beyond which a sample is missing and the five are not used to
estimate noise. Unit: 1. Not calibrated: chosen."""
EFFORT_NOISE_STRETCH = 6
"""Number of successive windows from which an effort's noise is estimated after removing their slow part, which is
left to physics: 0.21 s at the usual width. Unit: windows. Not calibrated: chosen."""
EFFORT_NOISE_TREND = 3
"""Number of polynomial terms in time, with the constant, that model that slow part. Unit: 1. Not calibrated:
chosen."""
EFFORT_NOISE_TRUSTED_QUANTILE = 0.8
"""Quantile of χ² at which the weight of a stretch is bounded, since beyond it the stretch holds a sudden event. Unit:
1. Not calibrated: chosen."""
EFFORT_NOISE_STDS = 2.0
"""Standard deviations of the estimated effort noise within which the estimate is refined from the whole residual,
including its slow part. Unit: 1. Not calibrated: chosen."""
EFFORT_NOISE_SETTLED = 0.8
"""Ratio of the effort noise beside the named effects to its first estimate, below which the search is repeated with
the smaller noise. Unit: 1. Not calibrated: chosen."""
EFFORT_NOISE_ROUNDS = 2
"""Largest number of such repeated searches. Unit: searches. Not calibrated: chosen."""
EFFORT_NOISE_LARGEST = 1e14
"""Largest variance of the effort noise in a row, over that of the row's other noise. Unit: 1. Not calibrated: chosen,
positions that were low-passed have next to no noise, and the efforts beside them have theirs."""

# A recording as equations

WINDOW_WIDTH = 0.12
"""Width of a test function, a cubic B-spline: four overlap, 30 ms apart. Unit: s. Source: on one mass, 0.3 to 3 Hz,
rows of 60 ms keep .954 to .999 of the information of a full likelihood and rows of 120 ms .942 to .998."""
END_MARGIN = 0.02
"""Time at both ends of a recording that no window covers, so that a channel can be shifted in time by that much.
Unit: s. Not calibrated: chosen."""
POSITION_SMOOTHING_REACHES = (0.06, 0.0424, 0.03, 0.0212, 0.015)
"""Half widths over which positions are smoothed, tried from the widest; each is narrower by √2, so that the chosen
one is not much noisier than the widest one that fits. Unit: s. Not calibrated: chosen."""
POSITION_SMOOTHING_DEGREE = 7
"""Degree of the smoothing polynomial over each of these widths. Unit: 1. Not calibrated: chosen."""
VELOCITY_SMOOTHING_REACH = 0.008
"""Half width over which the velocity in products and in laws with a kink is smoothed. Unit: s. Source: a study of
simulated arms, in which 16 ms, both sides together, was enough to name Coulomb friction."""
RESTING_SMOOTHING_REACHES = (0.016, 0.032, 0.064, 0.128, 0.256)
"""Half widths that are tried where a joint is at rest. Unit: s. Not calibrated: chosen."""
RESTING_VELOCITY_STDS = 4.0
"""Standard deviations of a lightly smoothed velocity within which a joint may be at rest. Unit: 1. Not calibrated:
chosen."""
AGREEING_VELOCITY_STDS = 3.0
"""Difference of two smoothed velocities, in standard deviations of the one smoothed less, within which they agree.
Unit: 1. Not calibrated: chosen."""
CHANNEL_SMOOTHING_REACH = 0.04
"""Half width over which a channel is smoothed before its time derivatives are taken. Unit: s. Not calibrated:
chosen."""
INITIAL_DOUBT_ROW_CHANGE = 1e-4
"""Smallest change of the sum of squared whitened rows, by the uncertainty of a recording's initial state, for which
that uncertainty is taken into account. Unit: 1. Not calibrated: chosen."""
LONGEST_PAUSE_OF_WINDOW = 2.5
"""Pause between samples, in median sampling intervals, beyond which no window extends over it. Unit: 1. Not
calibrated: chosen."""

# Fits and evidence

WINDOWS_PER_BLOCK = 8
"""Number of windows of an interval of time that is tested on its own: 0.24 s at the usual width. Unit: windows. Not
calibrated: chosen."""
NOISE_STD_TOLERANCE = 0.03
"""Relative error of stated standard deviations that is tolerated, so that it does not count as a misfit of the model.
Unit: 1. Not calibrated: chosen."""
MISFIT_REDUCED_CHI_SQUARE = 1.5
"""χ² per degree of freedom beyond which a residual is not only noise; every further effect must then remove a fair
share of it. Unit: 1. Not calibrated: chosen."""
MISFIT_SHARE_TO_EXPLAIN = 0.05
"""Share of such a misfit's χ² that an effect must remove. Unit: 1. Not calibrated: chosen."""
SHARE_LEFT_BESIDE_EXACT = 1e-3
"""Largest share of the misfit at their place that laws leave which hold there, where other equations hold to the noise,
so that the model is exact: as strengths that are off by a thirtieth do. Unit: 1. Not calibrated: chosen."""
VARYING_SHARE = 1e-4
"""Share of what a law explains by which strengths of its own in each half of a recording must explain more, to refute
it: as strengths that differ by a hundredth do. Unit: 1. Not calibrated: chosen, ten times the accuracy of laws."""
VARYING_SHARE_BESIDE_FORCES = 1e-2
"""As `VARYING_SHARE`, where unknown forces are a part of the noise, so that the model is not exact: as strengths that
differ by a tenth do. Unit: 1. Not calibrated: chosen."""
LEAST_PARTS_THAT_SHOW = 2
"""Number of parts of the recordings, each a recording or a quarter of one, that a lasting effect has to show in while
more than noise remains: one alone is confirmed by no other. Unit: parts. Not calibrated: chosen."""
BOUNDED_TIME_SHARE = 0.5
"""Largest share of the time for which a recorded effort may be beyond an envelope that falls with speed: beyond it most
of the time, what acts is no effort that was recorded, but a force of velocity and sign, as friction is. Unit: 1. Not
calibrated: chosen."""
MISFIT_P_VALUE = 1e-3
"""p-value of χ² below which whole recordings do not follow a model, though its rows may: their likelihood then finishes
no fit. Unit: 1. Not calibrated: chosen."""
LAW_ACCURACY = 1e-3
"""Relative accuracy to which any law is taken to describe a machine or a simulation, its integration included: a misfit
below this share of what the named effects explain, as amplitudes of the whitened rows, is no evidence of more physics.
Unit: 1. Not calibrated: chosen."""
RECORDINGS_SHARE_IMPROVED = 0.75
"""Share of the recordings that show an effect, or of their quarters, in which it must do so. Unit: 1. Not calibrated:
chosen."""
UNKNOWN_FAR_IN_PRIOR_STDS = 3.0
"""Prior standard deviations beyond which an unknown is a mismatch at its place: its prior is wrong, or the model there.
Unit: 1. Source: three standard deviations, as the file formats promise."""
UNKNOWN_REACH_IN_PRIOR_STDS = 5.0
"""Largest distance of an unknown parameter from its prior mean, in prior standard deviations: an unbounded one could
make any equation hold, as a mass that tends to zero does. Unit: 1. Not calibrated: chosen."""
REGRESSOR_SIGNAL_SHARE = 0.2
"""Share of a regressor's information that is signal, below which its coefficient is treated as unknown. Unit: 1. Not
calibrated: chosen."""
VISIBLE_ROW_CHANGE = 0.01
"""Smallest norm of the change of the whitened rows by a parameter of its typical size for which the parameter is
fitted. Unit: standard deviations of a row. Not calibrated: chosen."""
CORRECTION_COST_ALLOWANCE = 10.0
"""Largest cost of a correction for noise in the regressors, beyond half of the decrease of χ² by the effects: above
it the effects count as artefacts of that noise. Unit: χ². Not calibrated: chosen."""
INTERVAL_REACH_IN_STDS = 1.96
"""Half width of a 95 % interval in standard deviations. Unit: 1. Source: the normal distribution."""
PARABOLIC_RISE_SHARE = 0.75
"""Ratio of the rise of χ² at an interval's end to its linearised prediction, from which on the linearised interval is
accepted. Unit: 1. Not calibrated: chosen."""
EFFECT_SHOWN_P_VALUE = 1e-4
"""p-value of "this effect is absent" that the best of hundreds of first-order tests reaches on noise alone: above it
the recordings do not show the effect at all. Unit: 1. Not calibrated: chosen."""

# The search, and the verdict

FALSE_ALARM_RATE = 0.01
"""Probability that a mismatch is detected, or an effect accepted, where noise alone is recorded; an option of the
command. Unit: 1. Source: a usual level of significance; `make prove` counts the false alarms on recordings that lack
nothing."""
ADEQUACY_LEVEL = 0.01
"""p-value of the goodness-of-fit test above which what remains counts as noise, so that a verdict is `explained` or an
estimate's model fits; an option of the command. Unit: 1. Source: a usual level of significance; `make prove` counts the
right explanations that end `unexplained`."""
MOST_EFFECTS = 3
"""Largest number of effects of an explanation. Unit: effects. Not calibrated: chosen."""
EXPLANATIONS_CONTINUED = 3
"""Number of explanations of each size to which a further effect is added. Unit: explanations. Not calibrated:
chosen."""
CANDIDATES_FITTED = 4
"""Number of candidates that are fitted exactly beside each of these. Unit: candidates. Not calibrated: chosen."""
RIVAL_EXCESS_CHI_SQUARE = 9.0
"""Largest excess of a rival's χ² over that of the accepted explanation, in units of the remaining noise. Unit: 1.
Source: three standard deviations."""
NAMED_EXCESS_SHARE = 0.5
"""Share of the excess χ², in the channel that an effect explains best, that it must remove to be named under
`unexplained`; other channels may hold something unknown. Unit: 1. Not calibrated: chosen."""
STATED_SHARE_FAR_LESS = 0.5
"""Share of the friction or rotor inertia that a model file states, below which what fits best is far less: then a
search begins without it. Unit: 1. Not calibrated: chosen."""
MISFIT_GROWTH_ALLOWED = 2.0
"""Largest factor by which effects that stand out of unknown forces may increase the misfit of a kind of row, where what
a search for few effects found does not. Unit: 1. Not calibrated: chosen."""
WIDER_WINDOW_RATIOS = (2.0, 4.0, 8.0)
"""Widths of further windows over the usual one: fast vibration averages out. Unit: 1. Not calibrated: chosen."""
WIDEST_WINDOW = 0.5
"""Width that none of them exceeds, at whatever rate a recording was sampled: slower motion is what the joints do. Unit:
s. Not calibrated: chosen."""
SHAPE_CHI_SQUARE_RANGE = 10.0
"""Range of χ² over the grid of a law's shapes, from which on values between the grid points are tried, and by how much
friction that builds up over a way must fit better than friction that jumps. Unit: 1. Not calibrated: chosen."""
CANDIDATES_FITTED_FOR_ALARM = 8
"""Number of candidates that are fitted after their first-order test before a mismatch is reported. Unit: candidates.
Not calibrated: chosen."""
ALARM_P_VALUE_WORTH_FITTING = 0.05
"""p-value of a first-order test, times the number of tests, below which it is followed by a fit without bias. Unit:
1. Not calibrated: chosen."""
ALARM_P_VALUE_CERTAIN = 1e-12
"""p-value below which a mismatch is certain, so that no further test is needed to report one. Unit: 1. Not
calibrated: chosen."""
CANDIDATE_GAIN_SHARE_REFITTED = 0.1
"""Gain of a candidate's first-order test over the best one's, below which the candidate is not fitted. Unit: 1. Not
calibrated: chosen."""
GAIN_SHARE_FAR_LESS = 0.5
"""Gain of a first-order test over the decrease of χ² by an explanation, below which a fit would not make it a rival.
Unit: 1. Not calibrated: chosen."""
COMPETING_CRITERION_REACH = 100.0
"""Excess of the information criterion over the best explanation's, in units of the remaining noise, beyond which an
explanation is dropped. Unit: 1. Not calibrated: chosen."""
RIVALS_FITTED_PER_PARENT = 3
"""Candidates that are fitted as rivals beside each parent explanation. Unit: candidates. Not calibrated: chosen."""
CONTENDERS_FITTED_UNBIASED = 12
"""Largest number of explanations that are fitted without bias before one of them is chosen. Unit: explanations. Not
calibrated: chosen."""
CONTENDER_CRITERION_REACH = 10.0
"""Excess of the criterion over the best one's up to which they are among them. Unit: 1. Not calibrated: chosen."""
UNDETERMINED_STD_SHARE = 1.0 / 3.0
"""Standard deviation of a strength, as a share of the width of its bounds (of its size where they are infinite), beyond
which it is not determined. Unit: 1. Source: three standard deviations."""
LEAST_PROBABILITY = 0.5
"""Probability of an effect among the laws that explain the same, below which it is a rival and not named. Unit: 1.
Source: above it no other law can be as probable."""
RIVAL_BY_SIMULATION = 0.01
"""Probability from which a law that was compared by simulations is a rival. Unit: 1. Not calibrated: chosen."""
LEAST_STRENGTH_STDS = 3.0
"""Standard deviations, by blocks of time, from its absence below which an effect is not named where more than noise
remains; of several strengths one has to be farther. Unit: 1. Source: three standard deviations."""
UNKNOWN_MOVE_IN_PRIOR_STDS = 0.3
"""Change of an unknown parameter, in prior standard deviations, beyond which the noise covariance is computed again.
Unit: 1. Not calibrated: chosen."""

LEFT_OUT_SEEN_CHI_SQUARE = 9.0
"""Change of the rows by what was found, as χ² in a part of the recordings, one that is left out or the others, below
which that part does not show it and says nothing of it. Unit: 1. Source: three standard deviations."""

# Recordings of joints

MEASURED_FORCE_EXCESS_SHARE_LEFT = 0.05
"""Largest share of the joints' excess over noise that remains when the sensor's force replaces the contact's, for the
contact law and not the sensor to be wrong. Unit: 1. Not calibrated: chosen."""
SENSOR_MISS_IN_STDS = 6.0
"""Standard deviations by which the sensor's own rows must misfit a force, or its reading a law of a joint. Unit: 1. Not
calibrated: chosen."""
MISTAKE_CHI_SQUARE_PER_ROW = 5.0
"""χ² per row below which no mistake of the data is looked for. Unit: 1. Not calibrated: chosen."""
MISTAKE_CHI_SQUARE_SHARE_LEFT = 0.2
"""Largest share of χ² that remains after a mistake of the data is corrected, for it to be reported. Unit: 1. Not
calibrated: chosen."""
MISTAKE_MODEL_ACCURACY = 0.05
"""Share of the efforts to which a model with its prior means is taken to be right where mistakes of the data are looked
for: what is left once they are corrected is not noise alone. Unit: 1. Not calibrated: chosen."""
MISTAKE_PART_SHARE_LEFT = 0.7
"""Largest share of χ² that remains after the first of several mistakes is corrected: of two equal ones, one leaves
half. Unit: 1. Not calibrated: chosen."""
MISTAKE_EXCERPT_SAMPLES = 600
"""Number of samples of an excerpt that is tested for mistakes of the data. Unit: samples. Not calibrated: chosen."""
MISTAKE_EXCERPT_TRAVEL_SHARE = 0.5
"""Smallest travel of a joint in the tested excerpts, over its largest travel in any excerpt. Unit: 1. Not calibrated:
chosen."""
MISTAKES_A_RECORDING = 3
"""Largest number of mistakes of the data in one recording. Unit: mistakes. Not calibrated: chosen."""
MISTAKES_TRIED_EXACTLY = 3
"""Number of the most likely mistakes, by a first-order test, that are then corrected exactly. Unit: mistakes. Not
calibrated: chosen."""
UNIT_FACTOR = 2.0
"""Factor of a joint's efforts from which on it may be that of a unit. Unit: 1. Not calibrated: chosen, above errors of
motor constants."""
UNIT_FACTOR_PRIOR_STD = 100.0
"""Prior standard deviation of the inverse of such a factor. Unit: 1. Not calibrated: chosen, so wide that it only holds
what no recording tells."""
GAIN_SIGNAL_IN_NOISE_STDS = 10.0
"""Standard deviation of a channel over that of its noise, from which on an error of its gain is looked for. Unit: 1.
Not calibrated: chosen."""
RESTING_SCATTER_IN_NOISE_STDS = 3.0
"""Standard deviation of a joint's positions, and of its velocities, over that of their noise, up to which the joint
counts as moved by noise that a controller feeds back. Unit: 1. Not calibrated: chosen, as feedback follows its noise;
resting joints of simulated arms scatter by 2 at most, moving ones by 50 and more."""
LOCATION_EXCESS_SHARE = 0.01
"""Share of the excess below which a place is not reported. Unit: 1. Not calibrated: chosen."""
LOCATION_P_VALUE = 1e-3
"""p-value, times the number of blocks, below which an interval of time is reported as a mismatch. Unit: 1. Not
calibrated: chosen."""
CONDITION_EXCESS_SHARE = 0.8
"""Share of the excess that must lie where a condition holds, as "reversals of v.elbow", for the condition to be
reported. Unit: 1. Not calibrated: chosen."""
CONDITION_TIME_SHARE = 0.35
"""Share of the time beyond which a condition is too frequent to be informative. Unit: 1. Not calibrated: chosen."""
MOMENT_EXCESS_SHARE = 0.1
"""Excess of a window over that of the strongest one, below which the window is not part of the same event. Unit: 1.
Not calibrated: chosen."""
MOMENT_TIME_SHARE = 0.1
"""Largest share of the time of all recordings that an event may take. Unit: 1. Not calibrated: chosen."""
REVERSAL_SPEED_SHARE = 0.05
"""Speed of a joint over its largest speed, below which it counts as reversing. Unit: 1. Not calibrated: chosen."""
RISING_RANK_CORRELATION = 0.5
"""Rank correlation from which on a misfit is reported to grow with a quantity. Unit: 1. Not calibrated: chosen."""
PLANE_FORCE_CHI_SQUARE = 30.0
"""Decrease of χ² by a force in one window from which on its direction is used to estimate a plane's normal. Unit: 1.
Not calibrated: chosen."""
PLANE_EXCESS_SHARE = 0.1
"""Share of the excess over noise that the best plane of the grid must remove to be refined. Unit: 1. Not calibrated:
chosen."""
PLANE_TOUCHED_TIME_SHARES = (0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.3, 0.4, 0.55)
"""Shares of the time for which a trial plane is touched, which set its trial offsets. Unit: 1. Not calibrated:
chosen."""
PUSH_DURATIONS = (0.07, 0.12, 0.2, 0.35, 0.6)
"""Durations of the pushes that are tried. Unit: s. Not calibrated: chosen."""
PUSH_SPACING = 0.3
"""Distance between two trials of a push, as a share of its duration. Unit: 1. Not calibrated: chosen."""
PUSH_CENTRE_SHIFTS = (-0.15, 0.0, 0.15)
"""Shifts of a found push's centre, as shares of its duration, that are tried to refine its interval. Unit: 1. Not
calibrated: chosen."""
PUSH_DURATION_RATIOS = (0.8, 1.0, 1.25)
"""Factors of a found push's duration that are tried to refine it. Unit: 1. Not calibrated: chosen."""
UNKNOWN_FORCE_VARIANCE_SHARE = 0.1
"""Share of the variance of a joint's rows, given all other rows, from which on unknown forces are considered. Unit: 1.
Not calibrated: chosen."""

# Tosses

ARC_DURATION = 0.2
"""Approximate duration of an arc that is simulated from an initial state of its own. Unit: s. Not calibrated:
chosen."""
ARC_FEWEST_SAMPLES = 8
"""Smallest number of samples of an arc. Unit: samples. Not calibrated: chosen."""
ARC_START_REACH = 0.012
"""Half width of the interval about an arc's first sample from which its initial state is estimated. Unit: s. Not
calibrated: chosen."""
ARC_END_SHIFT = 0.2
"""Largest shift of an arc's end to where the motion is smooth, as a share of its duration. Unit: 1. Not calibrated:
chosen."""
ARC_LONGEST_PAUSE = 2.5
"""Pause between samples, in median sampling intervals, beyond which an arc ends. Unit: 1. Not calibrated: chosen."""
THROWN_LOAD_PLACES = (0.35, 0.85)
"""Distances from the body's origin, as shares of its size, at which a load is tried along the direction of its
moment. Unit: 1. Not calibrated: chosen."""
TOUCH_SHOWN_DURATION = 0.03
"""Time after a touch for which its effect is still visible in innovations. Unit: s. Not calibrated: chosen."""
RESTING_HEIGHT_TOLERANCE = 3e-3
"""Height above or below a surface at which a body still counts as lying on it. Unit: m. Not calibrated: chosen."""
ARC_RESTART_CHI_SQUARE = 3.0
"""χ² per degree of freedom of an arc, over the larger of 1 and the arcs' median, beyond which its initial state is
fitted from another start. Unit: 1. Not calibrated: chosen."""
ARC_RESTART_CHI_SQUARE_SHARE = 0.5
"""Largest χ² from the other start over that from the first one, for the other start to be used; of fits with effects,
of what χ² exceeds the number of rows by. Unit: 1. Not calibrated: chosen."""

# First-order tests of effects that are simulated as a whole

WHOLE_EFFECT_LEAST_COEFFICIENT = 0.3
"""Smallest coefficient, 1 if the effect is right, with which the change by an effect simulated as a whole enters the
rows: below it the effect explains something else. Unit: 1. Not calibrated: chosen."""
WHOLE_EFFECT_LARGEST_COEFFICIENT = 3.0
"""Largest such coefficient. Unit: 1. Not calibrated: chosen."""
