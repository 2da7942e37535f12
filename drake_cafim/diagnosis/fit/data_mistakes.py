"""Mistakes of the data: corrections of a recording's columns with which it agrees with the model as given.

A recording that agrees with the model once it is corrected needs no missing physics to explain it. Each recording is
tested on its own, since the files of a robot need not come from one program.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Protocol, Self, TypeVar

from drake_cafim.diagnosis.thresholds import (
    MISTAKE_CHI_SQUARE_PER_ROW,
    MISTAKE_CHI_SQUARE_SHARE_LEFT,
    MISTAKE_PART_SHARE_LEFT,
    MISTAKES_A_RECORDING,
)
from drake_cafim.numerics.rounding import listed
from drake_cafim.recordings.recording import Recording
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Suspicion:
    """A possible mistake: `subject` names the columns, `predicate` says what is wrong; `columns` are corrected.

    A mistake whose correction divides the motion by a `scale` above 1 is believed only if just noise remains then, and
    far more once the motion is divided again: any model that predicts too much effort fits a smaller motion better. No
    column has two units at once.

    `detail`, which a sentence ends with, has numbers of one recording. Where weak or strong motors, or links of other
    masses, may look alike it is `like_physics`: then it is believed only where these leave more.
    """

    subject: str
    predicate: str
    columns: Mapping[str, Array]
    scale: float = 1.0
    detail: str = ""
    like_physics: bool = False

    @property
    def key(self) -> tuple[str, str]:
        """Equal for the same mistake in another recording."""
        return self.subject, self.predicate

    def correct(self, recording: Recording) -> Recording:
        """`recording` with the suspected columns replaced."""
        return replace(recording, columns={**recording.columns, **self.columns})

    def scaled_again(self, recording: Recording) -> Recording:
        """`recording`, already corrected, with the suspected columns divided by `scale` once more."""
        again = {name: recording.columns[name] / self.scale for name in self.columns}
        return replace(recording, columns={**recording.columns, **again})


class Excerpt(Protocol):
    """A part of one recording, as it is or corrected, as whitened rows under the model as given."""

    @property
    def chi_square(self) -> float:
        """χ² per row; 0 where there is no row."""
        ...

    def best_correction(self) -> tuple[Suspicion, Self] | None:
        """The suspicion whose correction leaves the least χ², and the corrected excerpt; None where all raise it."""
        ...

    def scaled_again(self, suspicion: Suspicion) -> float:
        """χ² per row once the motion that `suspicion` has scaled down is scaled down again."""
        ...


E = TypeVar("E", bound=Excerpt)


@dataclass(frozen=True)
class Corrected(Generic[E]):
    """The `mistakes` of the recording `name`, its corrected `excerpt`, and the χ² per row that is `left` of it."""

    name: str
    mistakes: tuple[Suspicion, ...]
    left: float
    excerpt: E

    @property
    def keys(self) -> set[tuple[str, str]]:
        """Of the mistakes."""
        return {mistake.key for mistake in self.mistakes}


def correct(name: str, excerpt: E) -> Corrected[E]:
    """Corrects mistakes one after the other, while each explains most of the χ² that the ones before it leave."""
    supposed: list[Suspicion] = []
    left, accepted, right = [excerpt.chi_square], 0, excerpt
    while len(supposed) < MISTAKES_A_RECORDING and left[-1] >= MISTAKE_CHI_SQUARE_PER_ROW:
        better = excerpt.best_correction()
        if better is None:
            break
        suspicion, excerpt = better
        if any(_scale_the_same(suspicion, before) for before in supposed):
            break
        supposed.append(suspicion)
        left.append(excerpt.chi_square)
        agrees = all(_agrees(excerpt, suspicion) for suspicion in supposed if suspicion.scale > 1.0)
        if agrees and left[-1] < MISTAKE_CHI_SQUARE_SHARE_LEFT * left[accepted]:
            accepted, right = len(supposed), excerpt
        # a correction that removes a part may need the next one: of two equal mistakes the first leaves half
        elif left[-1] > MISTAKE_PART_SHARE_LEFT * left[-2]:
            break
    return Corrected(name, tuple(supposed[:accepted]), left[accepted], right)


def _scale_the_same(suspicion: Suspicion, other: Suspicion) -> bool:
    return suspicion.scale != 1.0 != other.scale and bool(suspicion.columns.keys() & other.columns.keys())


def _agrees(excerpt: Excerpt, suspicion: Suspicion) -> bool:
    """Whether the motion has the right size once `suspicion`, which scales it down, is corrected.

    Scaled down once more it must fit far worse: a motion that is almost none suits any model.
    """
    if excerpt.chi_square >= MISTAKE_CHI_SQUARE_PER_ROW:
        return False
    return excerpt.chi_square < MISTAKE_CHI_SQUARE_SHARE_LEFT * excerpt.scaled_again(suspicion)


def shared_by_all(found: Sequence[Corrected[E]]) -> set[tuple[str, str]]:
    """The keys of the mistakes that every recording has."""
    return set.intersection(*(recording.keys for recording in found))


def sentences(found: Sequence[Corrected[E]]) -> tuple[str, ...]:
    """A sentence for each mistake, with the files that have it; empty where there is none.

    Unless all recordings share a mistake, correcting it must lower χ² to that of the recordings without mistakes: else
    it may stand for physics that only this recording shows.
    """
    shared = shared_by_all(found)
    clean = max((recording.left for recording in found if not recording.mistakes), default=0.0)
    files: dict[tuple[str, str], list[str]] = {}
    details: dict[tuple[str, str], str] = {}
    for recording in found:
        for mistake in recording.mistakes:
            if mistake.key in shared or not clean or recording.left <= max(MISTAKE_CHI_SQUARE_PER_ROW, clean):
                files.setdefault(mistake.key, []).append(recording.name)
                details.setdefault(mistake.key, mistake.detail)
    return tuple(
        f"{subject} of {listed([*dict.fromkeys(names)])} {words}{details[subject, words]}"
        for (subject, words), names in files.items()
    )
