"""A case: the folder that a diagnosis gets, and the truth that it does not."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
import yaml

from .robots import Array, Robot
from .simulate import Motion
from .truth import Concealed


@dataclass(frozen=True)
class Case:
    """Files of a case by name, and its truth. `study` holds what only the maker needs for strengths."""

    kind: str
    rig: str
    scenario: dict[str, object]
    model_name: str
    model: str
    recordings: dict[str, pd.DataFrame]
    truth: dict[str, object]
    study: dict[str, object] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Scenario, model and recordings; nothing of the truth."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scenario.yaml").write_text(yaml.safe_dump(self.scenario, sort_keys=False))
        (folder / self.model_name).write_text(self.model)
        for name, table in self.recordings.items():
            table.to_parquet(folder / name, index=False)


@dataclass(frozen=True)
class World:
    """What a strength is computed from, kept in memory: nominal and true robot, noise-free motion and channels."""

    nominal: Robot
    true: Robot
    motion: Motion
    measured: dict[str, Array]
    effects: tuple[Concealed, ...]


def write_truth(path: Path, truth: dict[str, object]) -> None:
    path.write_text(json.dumps(truth, indent=1, default=float) + "\n")


RECORDINGS = ("train_1.parquet", "train_2.parquet", "train_3.parquet", "held_1.parquet")
