"""The parts of several long recordings, by number, in their order."""

from collections.abc import Sequence
from dataclasses import dataclass

from drake_cafim.recordings.long import LongRecording
from drake_cafim.recordings.recording import Recording


@dataclass(frozen=True)
class Part:
    """Samples from `begin` to `end` s, in the recording's own time, within part `k` of recording `index`."""

    index: int
    k: int
    begin: float
    end: float


@dataclass(frozen=True)
class Parts:
    """Parts of `recordings`, numbered through."""

    recordings: Sequence[LongRecording]
    items: tuple[Part, ...]

    @classmethod
    def of(cls, recordings: Sequence[LongRecording]) -> "Parts":
        """All parts of `recordings`."""
        return cls(
            recordings,
            tuple(Part(index, k, *span) for index, own in enumerate(recordings) for k, span in enumerate(own.spans)),
        )

    def __len__(self) -> int:
        """The number of parts."""
        return len(self.items)

    def read(self, number: int) -> Recording:
        """The samples of one part."""
        part = self.items[number]
        recording = self.recordings[part.index]
        found = recording.part(part.k)
        return found if (part.begin, part.end) == recording.spans[part.k] else found.window(part.begin, part.end)

    def name(self, number: int) -> str:
        """The name of the recording that a part is of."""
        return self.recordings[self.items[number].index].name

    def words(self, numbers: Sequence[int]) -> str:
        """Which seconds of which recordings these parts are, those that follow each other joined."""
        spans: list[tuple[str, float, float]] = []
        last = -2
        for number in sorted(numbers):
            part, name = self.items[number], self.name(number)
            if spans and number == last + 1 and spans[-1][0] == name:
                spans[-1] = (name, spans[-1][1], part.end)
            else:
                spans.append((name, part.begin, part.end))
            last = number
        by_name: dict[str, list[str]] = {}
        for name, begin, end in spans:
            by_name.setdefault(name, []).append(f"{begin:.4g} to {end:.4g} s")
        return "; ".join(f"{', '.join(own)} of {name}" for name, own in by_name.items())
