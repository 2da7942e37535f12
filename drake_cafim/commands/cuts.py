"""Diagnoses each cut of the recordings, in processes of their own, and keeps what is done for --resume."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from drake_cafim.commands.inputs import read_all
from drake_cafim.commands.levels import USUAL, Levels
from drake_cafim.commands.reports import read_record
from drake_cafim.diagnosis.diagnose import examine
from drake_cafim.diagnosis.search.cuts import Cut, Named, cuts_of, named_in
from drake_cafim.errors import InputError
from drake_cafim.output import write_text
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene

KEPT = "cuts.json"
"""What each cut that is done names, by the words of the cut."""


@dataclass(frozen=True)
class CutOptions:
    """The seed of the drawn blocks, and the number of processes."""

    seed: int = 0
    jobs: int = 1


@dataclass(frozen=True)
class CutWork:
    """What a process needs to diagnose a cut: a scene with Drake's objects in it cannot be sent to one."""

    address: str
    paths: tuple[str, ...]
    packages: tuple[tuple[str, str], ...]
    options: CutOptions
    levels: Levels = USUAL

    @property
    def digest(self) -> str:
        """Identifies the scenario's file, the recordings' files, the levels of the tests and the seed."""
        read = hashlib.sha256(repr((self.address, self.packages, self.options.seed, self.levels.words)).encode())
        for path in (self.address, *self.paths):
            if Path(path).is_file():
                read.update(Path(path).read_bytes())
        return read.hexdigest()

    def cuts(self, scene: Scene, recordings: Sequence[Recording]) -> tuple[Cut, ...]:
        """The cuts of the recordings."""
        return cuts_of(recordings, np.random.default_rng(self.options.seed), whole=scene.tree.floating)


def named_by_cuts(
    work: CutWork,
    scene: Scene,
    recordings: Sequence[Recording],
    out: Path,
    progress: Callable[[str], None],
    resume: bool,
) -> tuple[list[Named], list[str]]:
    """What each cut names, and a sentence for each that cannot be diagnosed.

    With `resume`, cuts that are done are read from `out`, if they are of the same files.
    """
    words = [cut.words for cut in work.cuts(scene, recordings)]
    done = _kept(out, work.digest) if resume else {}
    left = [k for k, own in enumerate(words) if own not in done]
    tasks = (delayed(_diagnosed)(work, k) for k in left)
    for number, (k, result) in enumerate(Parallel(n_jobs=work.options.jobs, return_as="generator_unordered")(tasks), 1):
        done[words[k]] = result
        write_text(out / KEPT, json.dumps({"digest": work.digest, "cuts": done}, indent=1) + "\n")
        progress(f"{number} of {len(left)} cuts of the recordings are diagnosed")
    results = [done[own] for own in words]
    named = [frozenset((name, at) for name, at in found) for found in results if not isinstance(found, str)]
    return named, [f"{own}: {found}" for own, found in zip(words, results, strict=True) if isinstance(found, str)]


def _diagnosed(work: CutWork, k: int) -> tuple[int, list[list[str]] | str]:
    """What the cut number `k` names, as [effect, place], or why it cannot be diagnosed."""
    scene = Scene.load(work.address, packages=dict(work.packages))
    cut = work.cuts(scene, read_all(scene, work.paths))[k]
    try:
        verdict, _ = examine(scene, cut.recordings, settings=work.levels.settings())
    except InputError as error:
        return k, str(error)
    return k, sorted(list(key) for key in named_in(verdict))


def _kept(out: Path, digest: str) -> dict[str, list[list[str]] | str]:
    """The cuts in `out` that are done; none where they are of other files."""
    if not (out / KEPT).is_file():
        return {}
    content = read_record(out / KEPT, "what earlier cuts left; give --overwrite")
    cuts = content.get("cuts")
    return cuts if isinstance(cuts, dict) and content.get("digest") == digest else {}
