"""`python -m tests.descriptions.concealed`: concealed effects in recordings of public robots, made by MuJoCo.

Of each robot, two sets of recordings are made by MuJoCo from the file as shipped: with its frictions, springs, rotors
and motors, and in one of them an effect that the file does not have. Kind, place and strength are drawn from the
system's entropy and sealed by a salted hash that is printed before `cafim diagnose` starts; the strength is 10 to 100
of the standard deviations that the diagnosis states for it. A set that `--out` already has is not made again.
"""

import argparse
import json
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import yaml

from drake_cafim.scenario.schema import Scenario, Weld
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.concealed.assumed import assumed
from tests.concealed.seal import Seal
from tests.concealed.trial import diagnosed, sealed_digests, short_report, write_whole
from tests.descriptions.catalogue import CATALOGUE, Shipped
from tests.descriptions.hidden import Hidden, Kind, Usual, draw
from tests.descriptions.mujoco_robot import Robot, specification
from tests.descriptions.recorded import NAMES, NOISE_Q, NOISE_V, Desired, record, within_limits

ROBOTS = (
    "UR5",
    "UR10",
    "Panda, hand held",
    "Kinova j2s6s200",
    "Solo12",
    "Bolt",
    "SO-100",
    "Double pendulum",
    "Kinova with Robotiq",
    "SO-ARM100, MJCF",
    "robosuite Panda",
    "robosuite iiwa",
    "robosuite Kinova3",
    "robosuite Sawyer",
    "robosuite UR5e",
    "robosuite xArm7",
    "robosuite ARX5",
    "robosuite Z1",
    "dm_control cart-pole",
    "Gymnasium pusher",
)
"""Arms, legs and toys, in URDF and MJCF, of those that MuJoCo accepts and whose motors carry them.

They were chosen before any was diagnosed."""
LEAST, MOST = 10.0, 100.0
"""Strength in the stds that a diagnosis would state for it; drawn log-uniformly."""
LARGEST = 20.0
"""Most usual sizes of an effect; what needs more of it to be seen is drawn anew."""
DRAWS = 40
"""Most effects that are drawn until one can be seen."""
TRAINED = NAMES[:3]


def stated_gravity(path: Path) -> list[float]:
    """m/s², as an MJCF states it; a user writes it into the scenario, as the diagnosis' note on it says."""
    if path.suffix == ".urdf":
        return [0.0, 0.0, -9.81]
    return [float(value) for value in mujoco.MjModel.from_xml_path(str(path)).opt.gravity]


@dataclass(frozen=True)
class Prepared:
    """A robot whose recordings can be made: its scene, the model as shipped, and the motions asked for."""

    shipped: Shipped
    path: Path
    scene: Scene
    robot: Robot
    wanted: Desired
    sliding: Array

    @classmethod
    def of(cls, shipped: Shipped, rng: np.random.Generator) -> "Prepared":
        path = shipped.path
        if path is None:
            raise ValueError(f"{shipped.package[0]} is not installed")
        weld = [Weld(shipped.weld)] if shipped.weld else []
        scenario = Scenario(model=str(path), weld=weld, lock=list(shipped.lock), gravity=stated_gravity(path))
        scene = Scene.build(scenario, path.parent, shipped.name)
        robot = Robot.of(specification(scene, path), scene)
        sliding = np.array([joint.prismatic for joint in scene.tree.joints])
        limits = np.array([joint.position_limits for joint in scene.tree.joints])
        efforts = np.array([joint.effort_limit or np.inf for joint in scene.tree.joints])
        return cls(shipped, path, scene, robot, within_limits(rng, robot, limits, sliding, efforts), sliding)

    def recordings(self, rng: np.random.Generator, hidden: Hidden) -> Mapping[str, pd.DataFrame]:
        spec = specification(self.scene, self.path)
        hidden.change(spec)
        robot = Robot.of(spec, self.scene)
        hidden.turn(robot.model)
        return record(rng, self.robot, robot, self.wanted, hidden, self.sliding)

    def usual(self) -> Usual:
        q, v, a = (x.reshape(-1, len(self.sliding)) for x in (self.wanted.q, self.wanted.v, self.wanted.a))
        effort = self.robot.inverse(q[::10], v[::10], a[::10])
        rms = (np.sqrt(np.mean(x**2, axis=0)) for x in (effort, v))
        inertia = np.diag(self.robot.mass_matrices(self.wanted.q[0, :1])[0])
        return Usual(*rms, np.std(self.wanted.q[0], axis=0), inertia)

    def write(self, folder: Path, tables: Mapping[str, pd.DataFrame]) -> None:
        """The scenario as a user would write it, and the recordings; nothing of what is concealed."""
        folder.mkdir(parents=True, exist_ok=True)
        channels: dict[str, Any] = {"q": {"std": NOISE_Q[0]}, "v": {"std": NOISE_V[0]}, "u": {"std": 0.0}}
        for joint in self.scene.tree.joints:
            if joint.prismatic:
                channels |= {f"q.{joint.name}": {"std": NOISE_Q[1]}, f"v.{joint.name}": {"std": NOISE_V[1]}}
        content: dict[str, Any] = {"model": str(self.path), "channels": channels}
        content["gravity"] = self.scene.scenario.gravity
        if self.shipped.weld:
            content["weld"] = [{"body": self.shipped.weld}]
        if self.shipped.lock:
            content["lock"] = list(self.shipped.lock)
        (folder / "scenario.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        for name, table in tables.items():
            table.to_parquet(folder / name, index=False)


@dataclass(frozen=True)
class Concealed:
    """An effect with its strength: the truth that is sealed, and the recordings that have it."""

    truth: dict[str, Any]
    tables: Mapping[str, pd.DataFrame]


def concealed(rng: np.random.Generator, prepared: Prepared) -> Concealed:
    """A random effect that the recordings show, at a strength of so many stds as `LEAST` and `MOST` allow.

    Raises `ValueError` where none of many can be seen.
    """
    usual = prepared.usual()
    for _ in range(DRAWS):
        kind = draw(rng, prepared.scene, usual)
        found = of_strength(rng, prepared, kind, float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST)))))
        if found is not None:
            return found
    raise ValueError("no effect that was drawn can be seen")


def of_strength(rng: np.random.Generator, prepared: Prepared, kind: Kind, stds: float) -> Concealed | None:
    """The effect at a strength of `stds` of its stds; None where it would have to be unusually large."""
    size = 1.0
    for _ in range(4):
        hidden, values = kind.made(kind.neutral + size * kind.unit)
        try:
            tables = prepared.recordings(rng, hidden)
        except ValueError:
            return None
        std = stated_std(prepared, kind, tables)
        if std is None or std <= 0.0:
            return None
        reached = abs(next(iter(values.values())) - kind.neutral) / std
        if LEAST <= reached <= 1.5 * MOST and reached >= 0.8 * stds:
            truth = {"robot": prepared.shipped.name, "effect": kind.effect, "at": kind.at, "parameters": dict(values)}
            truth |= {"first": next(iter(values)), "equal": [list(pair) for pair in kind.equal], "stds": reached}
            return Concealed(truth, tables)
        size *= stds / reached
        if size > LARGEST:
            return None
    return None


def stated_std(prepared: Prepared, kind: Kind, tables: Mapping[str, pd.DataFrame]) -> float | None:
    """The std that a diagnosis states for the effect's first parameter, once it has named it; None for none."""
    with tempfile.TemporaryDirectory() as home:
        prepared.write(Path(home), tables)
        told = assumed(Path(home), TRAINED, [{"effect": kind.effect, "at": kind.at}])
    return next(iter(told[0].values()))[1] if told else None


def attempt(shipped: Shipped, null: bool, out: Path, limit: float, diagnose: Sequence[str]) -> dict[str, Any]:
    """One sealed set of recordings, diagnosed and scored; the truth is told after the diagnosis has ended."""
    rng = np.random.default_rng(int.from_bytes(os.urandom(16), "big"))
    prepared = Prepared.of(shipped, rng)
    if null:
        nothing: dict[str, Any] = {"robot": shipped.name, "effect": "", "at": "", "parameters": {}, "equal": []}
        made = Concealed(nothing, prepared.recordings(rng, Hidden()))
    else:
        made = concealed(rng, prepared)
    seal, name = Seal.close(made.truth), secrets.token_hex(6)
    with (out / "seals.txt").open("a", encoding="utf-8") as stream:
        stream.write(f"{name} {seal.digest}\n")
    print(f"sealed {name} {seal.digest}", flush=True)
    home = Path(tempfile.mkdtemp(prefix="described-"))
    try:
        prepared.write(home / name, made.tables)
        report, failure = diagnosed(list(diagnose), home / name, home, limit, NAMES)
    finally:
        shutil.rmtree(home, ignore_errors=True)
    if not seal.verify(sealed_digests(out)[name]):
        raise RuntimeError(f"{name}: the truth is not the one that was sealed")
    return {"name": name, "seal": asdict(seal), "failure": failure, "report": short_report(report)}


def named(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What the report names."""
    report = result["report"]
    return [(item["effect"], item["at"]) for item in report["explanation"]] if report else []


def found(result: Mapping[str, Any]) -> bool:
    """Whether the concealed effect is named at its place, or by an exact other name of it."""
    truth = result["seal"]["truth"]
    return any(list(pair) in [[truth["effect"], truth["at"]], *truth["equal"]] for pair in named(result))


def line(result: Mapping[str, Any]) -> str:
    """One row of the table."""
    truth, report = result["seal"]["truth"], result["report"]
    told = ", ".join(f"{effect}@{at}" for effect, at in named(result)) or "nothing"
    verdict = report["verdict"] if report else result["failure"][:80]
    if not truth["effect"]:
        label = "alarm" if named(result) else "quiet" if report else "failed"
        return f"{label:7} {truth['robot']:20} nothing -> {told} ({verdict})"
    size = ", ".join(f"{key} {value:.3g}" for key, value in truth["parameters"].items())
    return (
        f"{'found' if found(result) else 'MISSED':7} {truth['robot']:20} {truth['effect']}@{truth['at']} ({size}; "
        f"{truth['stds']:.0f} stds) -> {told} ({verdict}){_told_size(truth, report)}"
    )


def _told_size(truth: Mapping[str, Any], report: Mapping[str, Any] | None) -> str:
    """The strength as told, for what is found by its own name."""
    for item in report["explanation"] if report else []:
        first = truth["first"]
        if (item["effect"], item["at"]) == (truth["effect"], truth["at"]) and first in item["parameters"]:
            told = item["parameters"][first]
            return f"; {first} {told['value']:.3g} ± {told['std']:.2g}"
    return ""


def summary(results: Sequence[Mapping[str, Any]]) -> str:
    """The counts that are asked for."""
    singles = [entry for entry in results if entry["seal"]["truth"]["effect"]]
    nulls = [entry for entry in results if not entry["seal"]["truth"]["effect"]]
    alone = sum(found(entry) and len(named(entry)) == 1 for entry in singles)
    failed = sum(entry["report"] is None for entry in results)
    return (
        f"{sum(map(found, singles))} of {len(singles)} named (at least 18 of 20 are asked for), {alone} of them alone; "
        f"anything named on {sum(bool(named(entry)) for entry in nulls)} of {len(nulls)} nulls (at most 1 of 20), "
        "verdict "
        f"none on {sum((entry['report'] or {}).get('verdict') == 'none' for entry in nulls)}; {failed} diagnoses failed"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """The table, row by row as it is found, and the counts."""
    parser = argparse.ArgumentParser(prog="python -m tests.descriptions.concealed", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("cafim-out/descriptions-concealed"))
    parser.add_argument("--limit", type=float, default=3600.0, help="s that one diagnosis may take")
    parser.add_argument("--only", choices=("singles", "nulls"), help="these sets of recordings only")
    parser.add_argument("names", nargs="*", help="only these robots")
    options = parser.parse_args(arguments)
    (options.out / "opened").mkdir(parents=True, exist_ok=True)
    shipped = {entry.name: entry for entry in CATALOGUE}
    cafim = [str(Path(sys.executable).parent / "cafim"), "diagnose", "--no-replay"]
    results = []
    for k, name in enumerate(ROBOTS):
        for kind in ("singles", "nulls"):
            path = options.out / "opened" / f"{k:02d}_{kind}.json"
            wanted = name in (options.names or ROBOTS) and kind in (options.only or kind)
            if wanted and not path.is_file():
                try:
                    write_whole(path, attempt(shipped[name], kind == "nulls", options.out, options.limit, cafim))
                except ValueError as error:
                    print(f"not made {name}, {kind}: {error}", flush=True)
            if wanted and path.is_file():
                results.append(json.loads(path.read_text(encoding="utf-8")))
                print(line(results[-1]), flush=True)
    print(summary(results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
