"""The numbers that steer a verdict: what each means, its unit, and what it was calibrated by.

No other file of the diagnosis holds such a number at module level; what stands elsewhere are accuracies and sizes of
numerical methods, which a test lists. Modules take these by name when they are imported.
"""

# Noise of the recorded channels

EVEN_CLOCK_DEVIATION = 1e-3
"""Share of a sampling time by which instants may lie off an even clock and still count as on it. Unit: 1. Not
calibrated: chosen."""
LOST_CLOCK_DEVIATION = 0.5
"""Share of a sampling time by which instants lie off an even clock from which on there is no even clock to speak of.
Unit: 1. Source: beyond half a sampling time, the nearest even instant is another one's."""
CLOCK_SMOOTHING_REACH = 0.012
"""Half width of the stretch from which the motion between a sample and its even instant is taken. Unit: s. Not
calibrated: chosen."""
MOTION_NOISE_STDS = 1.2
"""Standard deviations of a channel's own noise that its values must scatter by for the channel to move. Unit: 1. Not
calibrated: chosen, of noise alone the scatter is 1, within a few percent over a hundred samples."""
QUIET_FREQUENCY = 60.0
"""Frequency above which robots hardly move, so that a channel holds its noise alone. Unit: Hz. Not calibrated:
chosen."""
SPECTRUM_SEGMENT_SAMPLES = 128
"""Samples of a stretch of which one periodogram is taken. Unit: samples. Not calibrated: chosen."""
COLOURED_NOISE_P_VALUE = 1e-6
"""p-value, per channel, below which noise that was stated white is said not to be, and below which a spectrum is of
another shape than a first-order memory's. Unit: 1. Not calibrated: chosen."""
STATED_NOISE_LOG_VARIANCE_REACH = 0.2
"""How far the logarithm of a variance may lie from the stated one, as a spectrum is compared with it. Unit: 1. Not
calibrated: chosen."""
ESTIMATED_NOISE_LOG_VARIANCE_REACH = 20.0
"""The same where the variance was estimated: so far that it is free. Unit: 1. Not calibrated: chosen."""
LONGEST_CORRELATION_TIME = 0.05
"""Correlation time beyond which the quiet frequencies show nothing but the slope of the spectrum. Unit: s. Not
calibrated: chosen."""
FEEDBACK_ROUGHNESS_SHARE = 0.02
"""Share of an effort's roughness that the measurements' must explain for it to be noise that a controller feeds back.
Unit: 1. Not calibrated: chosen."""
LATTICE_DEVIATION = 0.01
"""Share of a step by which a value may lie off the lattice of a quantised channel. Unit: 1. Not calibrated:
chosen."""
QUANTISED_WAY_INTERVAL = 0.05
"""Time between the values whose differences make up the way that a quantised channel went; noise is averaged out in
between. Unit: s. Not calibrated: chosen."""
LONGEST_ROUNDING_DWELL = 6.0 * LONGEST_CORRELATION_TIME
"""Longest time that a channel takes to go a step and still hands on rounding errors as noise: of errors that stay
longer, windows see the changes only. Unit: s. Not calibrated: chosen."""
SLOW_CHANNEL_EMPTY_SHARE = 0.2
"""Share of its rows that a slowly sampled channel leaves empty, at least. Unit: 1. Not calibrated: chosen."""
SLOW_CHANNEL_LONGEST_INTERVAL = 0.012
"""Longest time between samples of a slow channel that is still interpolated. Unit: s. Not calibrated:
chosen, a fifth of a window."""
NOISE_ESTIMATE_GAP = 1.2
"""Times the usual duration of five samples beyond which one of them is missing, so that they tell nothing of the
noise. Unit: 1. Not calibrated: chosen."""
EFFORT_NOISE_STRETCH = 6
"""Windows in a row, of which the slow part is left to physics where an effort's noise is estimated: 0.21 s at the usual
width. Unit: windows. Not calibrated: chosen."""
EFFORT_NOISE_TREND = 3
"""Powers of time of that slow part, the constant among them. Unit: 1. Not calibrated: chosen."""
EFFORT_NOISE_TRUSTED_QUANTILE = 0.8
"""Quantile of χ² from which on a stretch counts no more than that: something snapped in it. Unit: 1. Not calibrated:
chosen."""
EFFORT_NOISE_STDS = 2.0
"""Standard deviations of that estimate within which all that is left, the slow part too, refines it. Unit: 1. Not
calibrated: chosen."""
EFFORT_NOISE_SETTLED = 0.8
"""Share of what was estimated of an effort's noise below which another search is made under what is left of it beside
what was found. Unit: 1. Not calibrated: chosen."""
EFFORT_NOISE_ROUNDS = 2
"""Such searches, at most. Unit: searches. Not calibrated: chosen."""
EFFORT_NOISE_LARGEST = 1e4
"""Variance of an effort's noise in a row, at most, over that of the row's other noise. Unit: 1. Not calibrated:
chosen."""

# A recording as equations

WINDOW_WIDTH = 0.06
"""Width of a test function: resolves what happens at reversals and still averages the noise. Unit: s. Not calibrated:
chosen."""
END_MARGIN = 0.02
"""Time at both ends of a recording that no window covers, so that a channel can be read a little earlier or later
than it was written. Unit: s. Not calibrated: chosen."""
POSITION_SMOOTHING_REACHES = (0.06, 0.0424, 0.03, 0.0212, 0.015)
"""Half widths over which positions are smoothed, the widest first and each √2 narrower: none is much noisier than the
widest that would do. Unit: s. Not calibrated: chosen."""
POSITION_SMOOTHING_DEGREE = 7
"""Degree of the polynomial over each of them. Unit: 1. Not calibrated: chosen."""
VELOCITY_SMOOTHING_REACH = 0.008
"""Half width over which the velocity in products and in kinked laws is smoothed. Unit: s. Source: a first study
of simulated arms, in which 16 ms, both sides together, was enough to name Coulomb friction."""
RESTING_SMOOTHING_REACHES = (0.016, 0.032, 0.064, 0.128, 0.256)
"""Half widths that are tried where a joint rests. Unit: s. Not calibrated: chosen."""
RESTING_VELOCITY_STDS = 4.0
"""Standard deviations of a velocity that is smoothed little, within which the joint may be at rest. Unit: 1. Not
calibrated: chosen."""
AGREEING_VELOCITY_STDS = 3.0
"""Standard deviations of the narrower one, within which two smoothed velocities agree. Unit: 1. Not calibrated:
chosen."""
CHANNEL_SMOOTHING_REACH = 0.04
"""Half width over which a channel is smoothed before its derivatives in time are taken. Unit: s. Not calibrated:
chosen."""
INITIAL_DOUBT_ROW_CHANGE = 1e-4
"""What a doubt about the state in which a recording begins must change the squared whitened rows by, summed over all,
to be reckoned with. Unit: 1. Not calibrated: chosen."""
LONGEST_PAUSE_OF_WINDOW = 2.5
"""Median sampling times beyond which a pause between samples is a gap that no window reaches over. Unit: 1. Not
calibrated: chosen."""

# Fits and evidence

WINDOWS_PER_BLOCK = 8
"""Windows in a stretch of time that is tested on its own: 0.24 s at the usual width. Unit: windows. Not calibrated:
chosen."""
NOISE_STD_TOLERANCE = 0.03
"""Share to which stated standard deviations are taken to be right; more is not held against the model. Unit: 1. Not
calibrated: chosen."""
MISFIT_REDUCED_CHI_SQUARE = 1.5
"""χ² per degree of freedom that is no longer noise: beyond, an effect has to take away a fair part of it, again and
again. Unit: 1. Not calibrated: chosen."""
MISFIT_SHARE_TO_EXPLAIN = 0.05
"""Share of such a misfit's χ² that an effect must take away. Unit: 1. Not calibrated: chosen."""
RECORDINGS_SHARE_IMPROVED = 0.75
"""Share of the recordings in which it must do so. Unit: 1. Not calibrated: chosen."""
UNKNOWN_REACH_IN_PRIOR_STDS = 5.0
"""Prior standard deviations that an unknown may move: beyond, the model of what is unknown is wrong itself, and a
mass that is free to vanish makes any equation of motion hold. Unit: 1. Not calibrated: chosen."""
REGRESSOR_SIGNAL_SHARE = 0.2
"""Share of a regressor's information that is no noise, below which its number is taken to be unknown. Unit: 1. Not
calibrated: chosen."""
VISIBLE_ROW_CHANGE = 0.01
"""What a number's usual size must move the whitened rows by, all together, for the number to be fitted. Unit:
standard deviations of a row. Not calibrated: chosen."""
CORRECTION_COST_ALLOWANCE = 10.0
"""What a correction for noise in the regressors may cost beyond half of what the effects take off χ², before they are
an echo of noise altogether. Unit: χ². Not calibrated: chosen."""
INTERVAL_REACH_IN_STDS = 1.96
"""Standard deviations within which a number is 95 times of a hundred. Unit: 1. Source: the normal distribution."""
PARABOLIC_RISE_SHARE = 0.75
"""Share of the rise of χ² that the slopes promise, from which on an interval is believed to be the slopes'. Unit: 1.
Not calibrated: chosen."""
EFFECT_SHOWN_P_VALUE = 1e-4
"""p-value of "this effect is absent" that the best of hundreds of looks at noise comes to: above, nobody knows what
the effect would look like, were it there. Unit: 1. Not calibrated: chosen."""

# The search, and the verdict

RIVAL_EXCESS_CHI_SQUARE = 9.0
"""χ², in units of the noise that is left, by which a rival may fit worse than what is accepted. Unit: 1. Source:
three standard deviations."""
NAMED_EXCESS_SHARE = 0.5
"""Under `unexplained`, effects are named only where they take away more than this share of the excess, in the channel
that they explain most of: another one may hold what nobody knows. Unit: 1. Not calibrated: chosen."""
WIDER_WINDOW_RATIOS = (2.0, 4.0, 8.0)
"""Times the width of the usual windows, over which what shakes fast is averaged out: up to half a second. Unit: 1.
Not calibrated: chosen."""
SHAPE_CHI_SQUARE_RANGE = 10.0
"""χ² between the best and the worst shape of a law on the grid, from which on values between are looked at. Unit: 1.
Not calibrated: chosen."""
CANDIDATES_FITTED_FOR_ALARM = 8
"""Candidates whose first look is followed by a fit before an alarm is raised. Unit: candidates. Not calibrated:
chosen."""
ALARM_P_VALUE_WORTH_FITTING = 0.05
"""p-value of a first look, times the number of looks, below which it is followed by a fit without bias. Unit: 1. Not
calibrated: chosen."""
ALARM_P_VALUE_CERTAIN = 1e-12
"""p-value below which there is certainly something, and no further look is news. Unit: 1. Not calibrated: chosen."""
CANDIDATE_GAIN_SHARE_REFITTED = 0.1
"""Share of the best first look's gain below which a candidate is not refitted. Unit: 1. Not calibrated: chosen."""
GAIN_SHARE_FAR_LESS = 0.5
"""Share of what an explanation takes off χ², below which a first look does not become its rival by refinement. Unit:
1. Not calibrated: chosen."""
COMPETING_CRITERION_REACH = 100.0
"""Information criterion, in units of the noise that is left, beyond the best's, from which on an explanation has
lost. Unit: 1. Not calibrated: chosen."""
RIVALS_FITTED_PER_PARENT = 3
"""Candidates that are fitted as rivals beside each parent explanation. Unit: candidates. Not calibrated: chosen."""
CONTENDERS_FITTED_UNBIASED = 12
"""Explanations that are fitted without bias before one is chosen, at most. Unit: explanations. Not calibrated:
chosen."""
CONTENDER_CRITERION_REACH = 10.0
"""Information criterion by which they may look worse than the best. Unit: 1. Not calibrated: chosen."""
UNKNOWN_MOVE_IN_PRIOR_STDS = 0.3
"""Prior standard deviations that an unknown may have moved before the noise is reckoned anew. Unit: 1. Not
calibrated: chosen."""

# Recordings of joints

ECHO_GAIN_WORTH_ASKING = 8.0
"""Gain in χ² of a coupling from which on it is asked whether it is an echo of noise. Unit: 1. Not calibrated:
chosen."""
FELT_FORCE_EXCESS_SHARE_LEFT = 0.05
"""Share of the excess over noise that may be left at the joints when what the sensor reads takes the contact's place,
for the contact's law to be wrong and not the sensor. Unit: 1. Not calibrated: chosen."""
SENSOR_MISS_IN_STDS = 6.0
"""Standard deviations of a χ² by which the sensor itself must miss a force. Unit: 1. Not calibrated: chosen."""
MISTAKE_CHI_SQUARE_PER_ROW = 5.0
"""χ² a row below which no mistake of the data is looked for. Unit: 1. Not calibrated: chosen."""
MISTAKE_CHI_SQUARE_SHARE_LEFT = 0.2
"""Share of χ² that may be left once a mistake is put right. Unit: 1. Not calibrated: chosen."""
MISTAKE_PART_SHARE_LEFT = 0.7
"""Share of χ² that the first of several mistakes may leave by itself: of two alike, one leaves half. Unit: 1. Not
calibrated: chosen."""
MISTAKE_EXCERPT_SAMPLES = 600
"""Samples of a stretch that is looked at for mistakes of the data. Unit: samples. Not calibrated: chosen."""
MISTAKE_EXCERPT_TRAVEL_SHARE = 0.5
"""How far a joint has to go in the stretches that are looked at, of the farthest that it goes in any. Unit: 1. Not
calibrated: chosen."""
MISTAKES_A_RECORDING = 3
"""Mistakes of the data in one recording, at most. Unit: mistakes. Not calibrated: chosen."""
MISTAKES_TRIED_EXACTLY = 3
"""Mistakes, by their quick look, that are then put right exactly. Unit: mistakes. Not calibrated: chosen."""
GAIN_SIGNAL_IN_NOISE_STDS = 10.0
"""Standard deviations of a sample's noise that a channel's own must be for an error of its gain to be looked for.
Unit: 1. Not calibrated: chosen."""
LOCATION_EXCESS_SHARE = 0.01
"""Share of the excess below which a place is not spoken of. Unit: 1. Not calibrated: chosen."""
LOCATION_P_VALUE = 1e-3
"""p-value, times the number of blocks, below which a stretch of time is called a mismatch. Unit: 1. Not calibrated:
chosen."""
CONDITION_EXCESS_SHARE = 0.8
"""Share of the excess that a condition, as "reversals of v.elbow", must hold to be said. Unit: 1. Not calibrated:
chosen."""
CONDITION_TIME_SHARE = 0.35
"""Share of the time beyond which a condition says little. Unit: 1. Not calibrated: chosen."""
MOMENT_EXCESS_SHARE = 0.1
"""Share of the strongest window's excess, below which another is not part of its moment. Unit: 1. Not calibrated:
chosen."""
MOMENT_TIME_SHARE = 0.1
"""Share of the time, of all recordings, that a moment may take. Unit: 1. Not calibrated: chosen."""
REVERSAL_SPEED_SHARE = 0.05
"""Share of a joint's fastest motion, below which it is at a reversal. Unit: 1. Not calibrated: chosen."""
RISING_RANK_CORRELATION = 0.5
"""Rank correlation from which on a misfit is said to grow with something. Unit: 1. Not calibrated: chosen."""
PLANE_FORCE_CHI_SQUARE = 30.0
"""χ² that a force in one window must gain to say where a plane points. Unit: 1. Not calibrated: chosen."""
PLANE_EXCESS_SHARE = 0.1
"""Share of the excess over noise that the best plane of the grid must take away to be worth improving. Unit: 1. Not
calibrated: chosen."""
PLANE_TOUCHED_TIME_SHARES = (0.01, 0.02, 0.04, 0.07, 0.11, 0.16, 0.22, 0.3, 0.4, 0.55)
"""Shares of the time that a plane in the way is tried to be touched for. Unit: 1. Not calibrated: chosen."""
EQUAL_LAG_DIFFERENCE = 0.2
"""Share of a time constant by which two lags may differ and still raise a channel's noise alike. Unit: 1. Not
calibrated: chosen."""
PUSH_DURATIONS = (0.07, 0.12, 0.2, 0.35, 0.6)
"""Durations of the pushes that are tried. Unit: s. Not calibrated: chosen."""
PUSH_SPACING = 0.3
"""Share of a duration, from one trial of a push to the next. Unit: 1. Not calibrated: chosen."""
PUSH_CENTRE_SHIFTS = (-0.15, 0.0, 0.15)
"""Shares of a found push's duration by which its middle is moved, to find its interval more exactly. Unit: 1. Not
calibrated: chosen."""
PUSH_DURATION_RATIOS = (0.8, 1.0, 1.25)
"""Times a found push's duration that it is then taken to be long. Unit: 1. Not calibrated: chosen."""
UNKNOWN_FORCE_VARIANCE_SHARE = 0.1
"""Share of the variance of a joint's rows, given all others, from which on forces that nobody knows are spoken of.
Unit: 1. Not calibrated: chosen."""

# Throws

ARC_DURATION = 0.2
"""Duration of an arc that is simulated from a start of its own, about. Unit: s. Not calibrated: chosen."""
ARC_FEWEST_SAMPLES = 8
"""Samples of an arc, at least. Unit: samples. Not calibrated: chosen."""
ARC_START_REACH = 0.012
"""Half width about an arc's first sample over which its state is guessed. Unit: s. Not calibrated: chosen."""
ARC_END_SHIFT = 0.2
"""Share of an arc's duration by which its ends may be moved to where the motion is smooth. Unit: 1. Not calibrated:
chosen."""
ARC_LONGEST_PAUSE = 2.5
"""Median sampling times beyond which a pause ends an arc. Unit: 1. Not calibrated: chosen."""
THROWN_LOAD_PLACES = (0.35, 0.85)
"""Shares of the body's size at which a load is looked for along the direction of its moment. Unit: 1. Not calibrated:
chosen."""
TOUCH_SHOWN_DURATION = 0.03
"""Time after a touch in which what it did is still seen in innovations. Unit: s. Not calibrated: chosen."""
RESTING_HEIGHT_TOLERANCE = 3e-3
"""Height by which a body that lies on a surface may be off it, deeper or above. Unit: m. Not calibrated: chosen."""
ARC_RESTART_CHI_SQUARE = 3.0
"""χ² per degree of freedom of an arc, in units of the other arcs' where physics is missing, beyond which its start is
looked for once more. Unit: 1. Not calibrated: chosen."""
ARC_RESTART_CHI_SQUARE_SHARE = 0.5
"""Share of it that may be left for the other start to be kept. Unit: 1. Not calibrated: chosen."""

# First looks at effects that are simulated whole

WHOLE_EFFECT_LEAST_COEFFICIENT = 0.3
"""Coefficient with which an effect that was simulated whole enters the rows, one if it is right: below this, its first
look was of something else. Unit: 1. Not calibrated: chosen."""
WHOLE_EFFECT_LARGEST_COEFFICIENT = 3.0
"""The same from above: more of it than this is none of it. Unit: 1. Not calibrated: chosen."""

REPLACED_LATER = frozenset(
    {
        "AGREEING_VELOCITY_STDS",
        "CANDIDATE_GAIN_SHARE_REFITTED",
        "CHANNEL_SMOOTHING_REACH",
        "COMPETING_CRITERION_REACH",
        "CORRECTION_COST_ALLOWANCE",
        "ECHO_GAIN_WORTH_ASKING",
        "INITIAL_DOUBT_ROW_CHANGE",
        "MISFIT_REDUCED_CHI_SQUARE",
        "MISFIT_SHARE_TO_EXPLAIN",
        "NAMED_EXCESS_SHARE",
        "POSITION_SMOOTHING_DEGREE",
        "POSITION_SMOOTHING_REACHES",
        "RECORDINGS_SHARE_IMPROVED",
        "REGRESSOR_SIGNAL_SHARE",
        "RESTING_SMOOTHING_REACHES",
        "RESTING_VELOCITY_STDS",
        "RIVALS_FITTED_PER_PARENT",
        "RIVAL_EXCESS_CHI_SQUARE",
        "UNKNOWN_FORCE_VARIANCE_SHARE",
        "UNKNOWN_REACH_IN_PRIOR_STDS",
        "VELOCITY_SMOOTHING_REACH",
        "WIDER_WINDOW_RATIOS",
        "WINDOWS_PER_BLOCK",
        "WINDOW_WIDTH",
    }
)
"""Thresholds of rows and of a search that are to be built anew: `make thresholds` moves all the others."""
