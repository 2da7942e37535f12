"""Paired comparison of two sets of runs with the same seeds, with bootstrap intervals."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.studies.findings import Ratio


def paired_ratio(first: Sequence[float], second: Sequence[float], draws: int = 2000) -> Ratio:
    """Median over seeds of `first`/`second`, with its 95 % bootstrap interval; 0/0 counts as 1."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.nan_to_num(np.asarray(first, dtype=float) / np.asarray(second), nan=1.0, posinf=np.inf)
    medians = np.median(np.random.default_rng(0).choice(ratios, (draws, len(ratios))), axis=1)
    low, high = np.quantile(medians, [0.025, 0.975], method="nearest")
    return Ratio(float(np.median(ratios)), float(low), float(high))


def paired_difference(first: Sequence[float], second: Sequence[float], draws: int = 2000) -> tuple[float, float, float]:
    """Mean over seeds of `first` − `second`, and its 95 % bootstrap interval."""
    differences = np.asarray(first, dtype=float) - np.asarray(second)
    means = np.random.default_rng(0).choice(differences, (draws, len(differences))).mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(differences.mean()), float(low), float(high)
