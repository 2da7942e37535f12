"""Writes the choice of what goes into the corrected scene as records of a trace."""

from collections.abc import Sequence

import numpy as np

from drake_cafim.diagnosis.trace import NOMINAL, Record, spoken
from drake_cafim.numerics.rounding import rounded
from drake_cafim.typing import Array

STEP, LEARN = "correct", "learn"
UNKNOWNS = "the unknowns as fitted"
"""What `Record.asked` says of the unknowns, all together."""
BEATEN = "without it, all that is kept predicts left-out parts still better"


def by_rows(asked: str, gain: float, parts: int) -> Record:
    """Whether the rows of left-out parts are predicted better with `asked`, which lowers their mean χ² by `gain`."""
    if gain == float("inf"):
        words = f"{_spoken(asked)} shows in one part of the recordings alone, so that no other part can confirm it"
        return Record(STEP, asked, None, None, True, words)
    passed = gain > 0.0
    side = "lower" if gain >= 0.0 else "higher"
    words = (
        f"with {_spoken(asked)}, refitted without them, χ² of left-out parts is {side} by {rounded(abs(gain), 3)} in "
        f"the mean of {parts}"
    )
    return Record(STEP, asked, gain, 0.0, passed, words, "lower χ² of left-out parts")


def by_simulation(asked: str, worse: float, error: float, horizon: str) -> Record:
    """Whether simulations of left-out parts over `horizon` are no worse with `asked`, by more than a standard error.

    `worse` is the mean of ln(error with it/error without it).
    """
    words = _simulated(asked, worse, error, horizon)
    return Record(STEP, asked, worse, error, worse <= error, words, f"ln of errors over {horizon}")


def confirmed(asked: str, worse: float, error: float) -> Record:
    """Whether simulations of left-out parts over 0.1 s are better with `asked` by more than a standard error.

    `worse` is as for `by_simulation`.
    """
    passed = worse < -error
    words = (
        f"{_simulated(asked, worse, error, '0.1 s')}; unknown forces remain, which a controller answers by changes of "
        "its efforts: what acts by such changes has to be better by more than the standard error, so it is "
        f"{'named' if passed else 'not named'}"
    )
    return Record("prune", asked, worse, -error, passed, words, "ln of errors over 0.1 s")


def _simulated(asked: str, worse: float, error: float, horizon: str) -> str:
    side = "larger" if worse > 0.0 else "smaller"
    return (
        f"with {_spoken(asked)}, refitted without them, simulations of left-out parts over {horizon} have errors "
        f"{side} by {rounded(100.0 * abs(np.expm1(worse)), 2)} % (standard error {rounded(100.0 * error, 2)} %)"
    )


def against_given(passed: bool, scores: tuple[float, float], simulated: bool) -> Record:
    """Whether what is kept predicts left-out parts better than the scene as given.

    `scores` are the mean of ln(error/error as given) and of the difference of −ln likelihood a sample; or twice the
    difference in χ² where nothing was `simulated`.
    """
    worst = max(scores)
    if simulated:
        percent, log = 100.0 * np.expm1(scores[0]), scores[1]
        words = (
            f"against the scene as given, all that is kept simulates left-out parts with errors "
            f"{'larger' if percent > 0.0 else 'smaller'} by {rounded(abs(percent), 2)} %, and −ln likelihood of a "
            f"sample is {'higher' if log > 0.0 else 'lower'} by {rounded(abs(log), 3)}"
        )
    else:
        side = "higher" if worst > 0.0 else "lower"
        words = f"with all that is kept, χ² of left-out parts is {side} by {rounded(abs(worst), 3)} than as given"
    return Record(STEP, NOMINAL, worst, 0.0, passed, words, "left-out parts, against the scene as given")


def learned_by_rows(joint: str, variables: Sequence[str], gain: float, parts: int) -> Record:
    """A law without a name at `joint`, of these `variables`, that lowers the mean χ² of left-out parts by `gain`."""
    words = (
        f"a force of {' + '.join(variables)} at {joint}, learned without them, lowers χ² of left-out parts by "
        f"{rounded(gain, 3)} in the mean of {parts}"
    )
    return Record(LEARN, f"learned_force@{joint}", gain, 0.0, True, words, "lower χ² of left-out parts")


def learned_together(
    joints: Sequence[str], short: Sequence[str], passed: bool, scores: tuple[float, float], parts: Array
) -> Record:
    """Whether the laws at `joints` together predict left-out parts better than the names alone, by both measures.

    At the joints `short` they are their memory alone. `scores` are the means of these over the parts, `parts` both of
    each part; the likelihood is NaN where errors are larger in some part, and need not be known.
    """
    percent = 100.0 * np.expm1(scores[0])
    named = ", ".join(f"{joint} (its memory alone)" if joint in short else joint for joint in joints)
    words = (
        f"against the names alone, the learned forces at {named} simulate left-out parts with errors "
        f"{'larger' if percent > 0.0 else 'smaller'} by {rounded(abs(percent), 2)} % in the mean"
    )
    if np.isnan(scores[1]):
        words += ", and not in each of the parts smaller ones"
    else:
        words += (
            f", and −ln likelihood of a sample is {'higher' if scores[1] > 0.0 else 'lower'} by "
            f"{rounded(abs(scores[1]), 3)}; in {'each' if passed else 'not each'} of the parts both are better"
        )
    asked = " + ".join(f"learned_force@{joint}" for joint in joints)
    worst = float(np.max(parts, initial=-np.inf))
    return Record(LEARN, asked, worst, 0.0, passed, words, "left-out parts, against the names alone")


def _spoken(asked: str) -> str:
    return asked if asked == UNKNOWNS else spoken(asked)
