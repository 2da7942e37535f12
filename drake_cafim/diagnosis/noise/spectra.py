"""The correlation of first-order noise, from spectra of a moving channel where the noise outweighs the motion."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.optimize import minimize_scalar
from scipy.signal import periodogram
from scipy.signal.windows import hann
from scipy.stats import chi2

from drake_cafim.diagnosis.thresholds import (
    COLOURED_NOISE_P_VALUE,
    MOTION_IN_SPECTRUM_STDS,
    QUIET_FREQUENCY,
    SPECTRUM_SEGMENT_SAMPLES,
    SPECTRUM_SEGMENT_TIME,
)
from drake_cafim.typing import Array

FEWEST = 8
"""Fewest segments, and fewest frequencies, of which a spectrum is taken."""
MAIN_LOBE = 3
"""Least frequency, in those of a segment, at which Hann's window lets nothing through of what is constant."""


@dataclass(frozen=True)
class Spectrum:
    """The usual power of a channel's fourth differences over S `segments`, at the phases ω h `phase` (F,).

    `log_power` (F,) is the logarithm of the median periodogram over the segments, relative to white unit noise before
    the differences; `seen_of` (F, G) makes their mean periodogram of the true power at G phases around the circle.
    """

    phase: Array
    log_power: Array
    seen_of: Array
    segments: int

    @property
    def variance(self) -> float:
        """That of each of `log_power`: 2.1/S, of the median of S exponentially distributed powers.

        Segments share half of their samples, yet of Hann's window their powers are correlated by 1/36 only (Welch, The
        use of fast Fourier transform for the estimation of power spectra, 1967).
        """
        return 2.1 / self.segments

    def between(self, lowest: float, highest: float) -> "Spectrum":
        """The spectrum at phases from `lowest` to `highest`, rad."""
        used = (self.phase > lowest) & (self.phase < highest)
        return replace(self, phase=self.phase[used], log_power=self.log_power[used], seen_of=self.seen_of[used])

    def of_noise(self, memory: float) -> Array:
        """(F,) the logarithm of the power that unit noise of the autocorrelation ρ^|k|, ρ = `memory`, has on average.

        Fourth differences multiply the power (1 − ρ²)/(1 − 2ρ cos φ + ρ²) at the phase φ by (2 − 2 cos φ)⁴.
        """
        grid = self.seen_of.shape[1]
        cosine = np.cos(2.0 * np.pi / grid * np.arange(grid))
        power = (2.0 - 2.0 * cosine) ** 4 * (1.0 - memory**2) / (1.0 - 2.0 * memory * cosine + memory**2)
        return np.asarray(np.log(self.seen_of @ power), dtype=float)


def spectrum(pieces: Sequence[Array], samples: int) -> Spectrum | None:
    """The spectrum of all segments of `samples` samples without a gap in `pieces` (N,); None where they are too few.

    None too where it is zero somewhere, as of a channel that does not change: it has no noise.
    """
    segments = np.concatenate([_segments(values, samples) for values in pieces])
    # fourth differences keep the motion at low frequencies from leaking
    differences = np.diff(segments, n=4, axis=1)
    if len(segments) < FEWEST:
        return None
    frequency, power = periodogram(differences, window="hann", detrend=False)
    phase = 2.0 * np.pi * frequency[1:]
    # the median over the segments is robust against the few that hold an impact; of χ²₂ power it is ln 2 of the mean
    usual = np.median(power[:, 1:], axis=0) / np.log(2.0)
    if not np.all(usual > 0.0):
        return None
    # one-sided and per hertz of a unit sampling rate: white noise of variance 1 has 2
    return Spectrum(phase, np.log(0.5 * usual), _leakage(differences.shape[1]), len(segments))


def first_order_memory(pieces: Sequence[Array], step: float, level: float, longest: float) -> float:
    """The correlation ρ of the noise of successive samples of `pieces` (N,), a `step` s apart; 0 where it is white.

    `pieces` are in units of the noise's standard deviation, the logarithm of whose square may be off by `level`; ρ is
    at most `longest`. Whether the noise is coloured is decided above `QUIET_FREQUENCY`. There all long memories have
    nearly the same spectrum but for a factor, (1 − ρ)/(1 − cos ωh): they are told apart by what is below, as far down
    as the spectrum remains that of first-order noise, see `_down_to_the_motion`.
    """
    seen = spectrum(pieces, SPECTRUM_SEGMENT_SAMPLES)
    quiet, highest = _quiet(step), 0.95 * np.pi
    if seen is None or len(seen.between(quiet, highest).phase) < FEWEST:
        return 0.0
    memory, p_value = _detected(seen.between(quiet, highest), level, longest)
    if p_value >= COLOURED_NOISE_P_VALUE or memory <= 0.0:
        return 0.0
    finer = spectrum(pieces, max(SPECTRUM_SEGMENT_SAMPLES, round(SPECTRUM_SEGMENT_TIME / step)))
    return _down_to_the_motion(finer or seen, quiet, level, longest)


def _down_to_the_motion(seen: Spectrum, quiet: float, level: float, longest: float) -> float:
    """ρ by the phases of `seen` above `quiet`, and by those below down to the first at which more than noise shows.

    There no first-order noise that agrees with all above has as much power, by `MOTION_IN_SPECTRUM_STDS` standard
    deviations. The power of a motion rises steeply towards low frequencies, and so shows within one or two of them; as
    Hann's window mixes each with two on either side, the last two above are left out, too.
    """
    highest = 0.95 * np.pi
    fits = [_Fit.of(seen.between(quiet, highest), level, longest)]
    for k in np.flatnonzero(seen.phase <= quiet)[MAIN_LOBE - 1 :][::-1]:
        lower = _Fit.of(seen.between(0.999 * float(seen.phase[k]), highest), level, longest)
        worse = lower.misfit - fits[-1].misfit
        if lower.left[0] > 0.0 and worse > MOTION_IN_SPECTRUM_STDS**2:
            return fits[max(len(fits) - MAIN_LOBE, 0)].memory
        fits.append(lower)
    return fits[-1].memory


@dataclass(frozen=True)
class _Fit:
    """The correlation `memory` ρ that is likeliest; what is `left` (F,) of the logarithmic power, and its χ²."""

    memory: float
    left: Array
    misfit: float

    @classmethod
    def of(cls, seen: Spectrum, level: float, longest: float) -> "_Fit":
        """Of first-order noise whose logarithmic variance is off by a ~ N(0, `level`²): Σ (left − a)²/s² + a²/level².

        At the best a; s² is the variance of each of `seen`.
        """
        information = len(seen.phase) / seen.variance

        def at(memory: float) -> "_Fit":
            left = seen.log_power - seen.of_noise(memory)
            a = float(np.mean(left)) * information / (information + level**-2)
            return cls(memory, left - a, information * float(np.mean((left - a) ** 2)) + (a / level) ** 2)

        best = minimize_scalar(lambda memory: at(memory).misfit, bounds=(0.0, longest), method="bounded")
        return at(float(best.x))


def _detected(seen: Spectrum, level: float, longest: float) -> tuple[float, float]:
    """ρ of the noise, at most `longest`, and the p-value of ρ = 0 by the likelihood ratio.

    The variance's logarithm may be off by `level`.
    """

    def misfit(memory: float) -> float:
        left = seen.log_power - seen.of_noise(memory)
        return float(np.sum((left - np.clip(left.mean(), -level, level)) ** 2)) / seen.variance

    best = minimize_scalar(misfit, bounds=(0.0, longest), method="bounded")
    # Hann's window correlates neighbouring frequencies: only half of them count as independent
    left, count = 0.5 * float(best.fun), 0.5 * len(seen.phase)
    if chi2.sf(left, count) < COLOURED_NOISE_P_VALUE:
        # a spectrum of another shape, such as that of a filter, is not described by this model
        return 0.0, 1.0
    gained = (0.5 * misfit(0.0) - left) / max(1.0, left / count)  # of χ² by ρ, scaled by the misfit that remains
    return float(best.x), float(chi2.sf(max(gained, 0.0), 1))


def _quiet(step: float) -> float:
    """The phase ω h, rad, of `QUIET_FREQUENCY`, of slowly sampled recordings a lower one."""
    return float(min(2.0 * np.pi * QUIET_FREQUENCY * step, 0.4 * np.pi))


def _segments(values: Array, samples: int) -> Array:
    """(S, `samples`) the segments of `values` (N,) without a gap; each begins in the middle of the one before."""
    if len(values) < samples:
        return np.zeros((0, samples))
    pieces = sliding_window_view(values, samples)[:: samples // 2]
    return pieces[np.all(np.isfinite(pieces), axis=1)]


def _leakage(samples: int) -> Array:
    """(F, 2 `samples`) what Hann's window w of `samples` passes at each of the F frequencies above 0 of a periodogram.

    E|Σ w_n x_n e^−iφn|²/Σ w² = ⟨S(θ) |W(φ − θ)|²⟩/Σ w², the mean over twice as many phases θ as samples: so many tell
    the overlap of w with itself in full. All terms are positive, so that nothing is lost in rounding.
    """
    w = hann(samples, sym=False)
    passed = np.abs(np.fft.fft(w, 2 * samples)) ** 2 / (2 * samples * float(w @ w))
    own, every = np.arange(2, samples + 1, 2), np.arange(2 * samples)
    return np.asarray(passed[(own[:, None] - every) % (2 * samples)], dtype=float)
