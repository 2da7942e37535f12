"""The parts of several long recordings, by number, in their order."""

from collections.abc import Sequence
from dataclasses import dataclass

from drake_cafim.recordings.long import LongRecording
from drake_cafim.recordings.recording import Recording


@dataclass(frozen=True)
class Parts:
    """All parts of `recordings`, numbered through."""

    recordings: Sequence[LongRecording]

    @property
    def places(self) -> list[tuple[int, int]]:
        """The recording of each part, and its number there."""
        return [(index, k) for index, recording in enumerate(self.recordings) for k in range(len(recording))]

    def __len__(self) -> int:
        """The number of parts."""
        return sum(map(len, self.recordings))

    def read(self, number: int) -> Recording:
        """The samples of one part."""
        index, k = self.places[number]
        return self.recordings[index].part(k)

    def span(self, number: int) -> tuple[float, float]:
        """s, first and last stamp of a part, in its recording's time."""
        index, k = self.places[number]
        return self.recordings[index].spans[k]

    def name(self, number: int) -> str:
        """The name of the recording that a part is of."""
        return self.recordings[self.places[number][0]].name

    def words(self, numbers: Sequence[int]) -> str:
        """Which seconds of which recordings these parts are, those that follow each other joined."""
        found: list[tuple[str, float, float]] = []
        last = -2
        for number in sorted(numbers):
            start, stop = self.span(number)
            if found and number == last + 1 and found[-1][0] == self.name(number):
                found[-1] = (found[-1][0], found[-1][1], stop)
            else:
                found.append((self.name(number), start, stop))
            last = number
        by_name: dict[str, list[str]] = {}
        for name, start, stop in found:
            by_name.setdefault(name, []).append(f"{start:.4g} to {stop:.4g} s")
        return "; ".join(f"{', '.join(spans)} of {name}" for name, spans in by_name.items())
