"""Makes a fleet's folder, and the truth about it, which is not in it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import yaml

from tests.concealed.urdf import arm_urdf

from .simulated import Condition, Kind, individual, kinds, recorded, scenario

BROKEN = ("cut", "text", "backwards")
START = date(2026, 3, 2)
"""A Monday."""


def make_fleet(
    folder: Path, rng: np.random.Generator, robots: int, weeks: int, duration: float, count: int = 3
) -> dict[str, object]:
    """Write the recordings of `robots` in `weeks`; returns the truth.

    One robot's viscous friction grows from some week on, another one's motor loses a part of its constant; three files
    of healthy robots are broken.
    """
    chosen = kinds(rng, count)
    names = [f"robot_{k + 1:02d}" for k in range(robots)]
    worn, weak = (int(k) for k in rng.choice(robots, 2, replace=False))
    of = {name: chosen[k % count] for k, name in enumerate(names)}
    grows_at, weak_at = (int(rng.integers(of[names[k]].nominal.size)) for k in (worn, weak))
    grows_from, weak_from = int(rng.integers(2, weeks - 4)), int(rng.integers(3, weeks - 2))
    slope, gain = float(rng.uniform(0.03, 0.09)), float(rng.uniform(0.80, 0.92))
    for k, name in enumerate(names):
        kind = of[name]
        _describe(folder / name, kind)
        robot = individual(rng, kind)
        for week in range(weeks):
            damping, gains = np.zeros(robot.size), np.ones(robot.size)
            if k == worn:
                damping[grows_at] = slope * max(0, week - grows_from)
            if k == weak and week >= weak_from:
                gains[weak_at] = gain
            table = recorded(rng, kind, robot, Condition(damping, gains), duration)
            path = folder / name / week_name(week) / "run.parquet"
            path.parent.mkdir(parents=True)
            table.to_parquet(path, index=False)
    healthy = [name for k, name in enumerate(names) if k not in (worn, weak)]
    broken = [
        f"{healthy[int(rng.integers(len(healthy)))]}/{week_name(int(week))}" for week in rng.choice(weeks, 3, False)
    ]
    for how, name in zip(BROKEN, broken, strict=True):
        _break(folder / name / "run.parquet", how)
    drifts = {"robot": names[worn], "effect": "joint_viscous_friction", "at": _joint(of[names[worn]], grows_at)}
    lost = {"robot": names[weak], "effect": "actuator_gain_error", "at": _joint(of[names[weak]], weak_at)}
    return {
        "drifts": drifts | {"from": _day(grows_from), "slope_per_week": slope},
        "lost": lost | {"from": _day(weak_from), "gain": gain},
        "broken": sorted(broken),
    }


def _joint(kind: Kind, number: int) -> str:
    return kind.nominal.joints[number].name


def _describe(folder: Path, kind: Kind) -> None:
    folder.mkdir(parents=True)
    (folder / f"{kind.name}.urdf").write_text(arm_urdf(kind.nominal))
    (folder / "scenario.yaml").write_text(yaml.safe_dump(scenario(kind), sort_keys=False))


def _break(path: Path, how: str) -> None:
    """Damage a file as files are damaged: cut off, of another format, from a clock that was set back."""
    content = path.read_bytes()
    if how == "cut":
        path.write_bytes(content[: len(content) // 2])
    elif how == "text":
        path.write_text("this is no recording\n" * 200)
    else:
        import pandas as pd

        table = pd.read_parquet(path)
        table.loc[len(table) // 2 :, "time"] -= 1.0
        table.to_parquet(path, index=False)


def week_name(week: int) -> str:
    """The ISO week's name, as 2026-W12."""
    year, number, _ = (START + timedelta(weeks=week)).isocalendar()
    return f"{year}-W{number:02d}"


def _day(week: int) -> str:
    return (START + timedelta(weeks=week)).isoformat()


def weeks_between(first: str, second: str) -> float:
    """The weeks from one ISO date or time to another."""
    return (date.fromisoformat(second[:10]) - date.fromisoformat(first[:10])).days / 7.0


def accused_healthy(truth: dict[str, object], accused: Sequence[str]) -> list[str]:
    """The robots that are accused and have nothing."""
    guilty = {truth[key]["robot"] for key in ("drifts", "lost")}  # type: ignore[index]
    return sorted(set(accused) - guilty)
