"""Reads the recordings that the command line names whole where they fit into memory, else in parts."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from drake_cafim.commands.inputs import refuse_repeats
from drake_cafim.diagnosis.long.budget import Budget
from drake_cafim.recordings.long import LongRecording, in_parts
from drake_cafim.recordings.pieces import Pieces, pieces_of
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene


@dataclass(frozen=True)
class LongInputs:
    """Recordings in parts, those to fit and those held out, and the memory that they are diagnosed in."""

    recordings: tuple[LongRecording, ...]
    held_out: tuple[LongRecording, ...]
    budget: Budget


@contextmanager
def open_inputs(
    scene: Scene, recordings: Sequence[str], held_out: Sequence[str], memory: float, base: Path = Path()
) -> Iterator[tuple[list[Recording], list[Recording]] | LongInputs]:
    """The recordings, whole where all of them can be diagnosed within `memory` bytes; parts are kept until the end.

    They are named from the folder `base`. Throws are whole whatever they take: each has one beginning. Raises
    `InputError` for a file that is given twice or cannot be read.
    """
    for paths in (recordings, held_out):
        refuse_repeats(paths)
    topics, budget = scene.scenario.topics, Budget.of(scene, memory)
    train, held = ([pieces_of(base / path, topics, path) for path in paths] for paths in (recordings, held_out))
    if scene.tree.floating or sum(pieces.rows for pieces in (*train, *held)) <= budget.rows:
        yield [pieces.whole() for pieces in train], [pieces.whole() for pieces in held]
        return
    with ExitStack() as open_files:

        def parted(group: Sequence[Pieces]) -> tuple[LongRecording, ...]:
            return tuple(open_files.enter_context(closing(in_parts(pieces, budget.part))) for pieces in group)

        yield LongInputs(parted(train), parted(held), budget)
