"""Intervals for what is reported: shares, means over seeds, differences by paired seeds."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy import stats

RESAMPLES = 10_000

ENOUGH_SEEDS = 3
"""With fewer pairs of runs no difference is clear."""


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """The Wilson score interval of a share, 95 % by default.

    Raises:
        ValueError: If there are no trials, or more successes than trials.

    References:
        Wilson (1927), Probable inference, the law of succession, and statistical inference.
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"0 <= successes <= trials, trials >= 1; got {successes} of {trials}")
    share = successes / trials
    scale = 1 + z * z / trials
    middle = (share + z * z / (2 * trials)) / scale
    half = z * sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials)) / scale
    return max(0.0, middle - half), min(1.0, middle + half)


def bootstrap_interval(values: Sequence[float]) -> tuple[float, float]:
    """The 95 % percentile bootstrap interval of a mean; (mean, mean) if all values are alike.

    With few values (five seeds) it is too narrow: a true 95 % would be wider.

    Raises:
        ValueError: If there are no values.

    References:
        Efron and Tibshirani (1993), An introduction to the bootstrap, chapter 13.
    """
    sample = np.asarray(values, dtype=float)
    if not sample.size:
        raise ValueError("an interval needs at least one value")
    if sample.size == 1 or np.ptp(sample) == 0.0:
        return float(sample[0]), float(sample[0])
    found = stats.bootstrap(
        (sample,),
        np.mean,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(found.low), float(found.high)


@dataclass(frozen=True)
class PairedDifference:
    """First minus second, over the seeds that both have.

    Attributes:
        seeds: How many pairs.
        mean: Of the differences.
        low, high: 95 % interval of that mean by Student's t; infinite for one pair.
    """

    seeds: int
    mean: float
    low: float
    high: float

    @property
    def clear(self) -> bool:
        """Whether the interval leaves out zero and at least `ENOUGH_SEEDS` bear it."""
        return self.seeds >= ENOUGH_SEEDS and (self.low > 0.0 or self.high < 0.0)


def paired_difference(first: Sequence[float], second: Sequence[float]) -> PairedDifference:
    """The difference of two lists of results, one pair a seed.

    Raises:
        ValueError: If the lists are empty or of different lengths.

    References:
        Student (1908), The probable error of a mean.
    """
    if len(first) != len(second) or not first:
        raise ValueError(f"pairs are needed; received {len(first)} and {len(second)} values")
    differences = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    mean = float(differences.mean())
    half = float("inf")
    if len(differences) > 1:
        error = float(differences.std(ddof=1)) / sqrt(len(differences))
        half = float(stats.t.ppf(0.975, len(differences) - 1)) * error
    return PairedDifference(seeds=len(differences), mean=mean, low=mean - half, high=mean + half)
