"""Hostile diagnoses: scenarios that can be read, with odd values, and recordings that can be read, with odd samples."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from drake_cafim import recordings
from drake_cafim.diagnosis.diagnose import diagnose, estimate
from drake_cafim.effects.catalogue import EFFECTS
from drake_cafim.recordings.recording import Recording
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.fuzzing.scenarios import ARM_URDF
from tests.fuzzing.verdict import judge

PLACES = {"joint": ("shoulder", "elbow"), "body": ("upper", "lower"), "world": ("world",), "contact": ("lower/ground",)}
PLACES |= {"surface": ("ground",), "channel": ("q.shoulder", "v.elbow", "wrench.wrist.fz", "nowhere")}
PLACES |= {"sensor": ("wrist", "wrench.wrist", "q.elbow")}
JOINTS = ("shoulder", "elbow")
CONTACT = {"bodies": ["lower", "ground"], "ground": {"point": [0, 0, -1], "normal": [0, 0, 1]}, "stiffness": 4000.0}
CONTACT |= {"damping": 6.0, "friction": 0.35, "slip_velocity": 0.01}
UNKNOWN: tuple[dict[str, Any], ...] = (
    *({"parameter": name, "body": "lower"} for name in ("mass", "com_x", "com_y", "com_z", "inertia", "inertials")),
    *({"parameter": name, "body": "lower"} for name in ("radius", "length", "width", "height")),
    *({"parameter": name, "joint": "elbow"} for name in ("damping", "rotor_inertia", "stiffness", "servo_stiffness")),
    *({"parameter": name, "joint": "elbow"} for name in ("servo_damping", "servo_limit")),
    *({"parameter": name, "contact": ["lower", "ground"]} for name in ("stiffness", "damping", "friction", "modulus")),
    {"parameter": "inertials", "body": "all"},
)


class DiagnosisCases:
    """Inputs that are a scenario and its recordings; each is a number, and the same number is the same input."""

    hang = 120.0

    def run(self, number: int, folder: Path) -> str:
        """What becomes of diagnosis `number`, its files written into `folder`."""
        rng = np.random.default_rng(number)
        (folder / "arm.urdf").write_text(ARM_URDF)
        scenario = folder / "scenario.yaml"
        scenario.write_text(yaml.dump(_scenario(rng)))
        names = [f"{k}.csv" for k in range(1, 2 + int(rng.random() < 0.3))]
        for name in names:
            recordings.write(_recording(name, rng), folder / name)

        def act() -> None:
            scene = Scene.load(scenario)
            read = [recordings.read(folder / name, scene.scenario.topics) for name in names]
            if rng.random() < 0.5:
                estimate(scene, read)
            else:
                diagnose(scene, read, held_out=read[1:])

        return judge(act, [scenario.name, *names])


def _magnitude(rng: np.random.Generator) -> float:
    """A number of any size, mostly a usual one."""
    if rng.random() < 0.04:
        return float(rng.choice([0.0, -1.0, 1e9, -1e9, 1e-12]))
    return float(rng.choice([1.0] * 5 + [-1.0])) * 10.0 ** float(rng.choice([-9, -4, -3, -2, -1, 0, 1, 3, 6]))


def _place(kind: str, rng: np.random.Generator) -> str:
    fitting = next((places for name, places in PLACES.items() if name in kind), ("shoulder", "lower"))
    return str(rng.choice(fitting))


def _scenario(rng: np.random.Generator) -> dict[str, Any]:
    """A scenario with one to four of its sections, their values odd."""
    found: dict[str, Any] = {"model": "arm.urdf", "weld": [{"body": "ground_plate"}]}
    found["channels"] = {kind: {"std": std} for kind, std in (("q", 2e-4), ("v", 1e-3), ("u", 0.0))}
    for _ in range(int(rng.integers(1, 5))):
        kind = int(rng.integers(9))
        channel = str(rng.choice(["q", "v", "u", "cmd", "q.elbow", "v.shoulder", "u.elbow"]))
        if kind == 0:
            std = [abs(_magnitude(rng)), {"std": abs(_magnitude(rng)), "correlation_time": abs(_magnitude(rng))}]
            found["channels"][channel] = {"std": std[0]} if rng.random() < 0.5 else std[1]
        elif kind == 1:
            order, cutoff = int(rng.integers(1, 21)), abs(_magnitude(rng))
            lowpass = {"order": order, "cutoff": cutoff, "zero_phase": bool(rng.random() < 0.5)}
            found["channels"][str(rng.choice(["v", "u", "v.elbow"]))] = {"lowpass": lowpass}
        elif kind == 2:
            found["channels"].pop(str(rng.choice(["q", "v", "u"])), None)
        elif kind == 3:
            effect = EFFECTS[int(rng.integers(len(EFFECTS)))]
            values = {
                strength.name: float(np.clip(_magnitude(rng), strength.lower, strength.upper))
                for strength in effect.strengths
            }
            found["effects"] = [{"effect": effect.name, "at": _place(effect.place.name.lower(), rng), **values}]
        elif kind == 4:
            unknown = UNKNOWN[int(rng.integers(len(UNKNOWN)))] | {"std": abs(_magnitude(rng))}
            found.setdefault("unknown", []).append(unknown | ({"mean": _magnitude(rng)} if rng.random() < 0.5 else {}))
        elif kind == 5:
            key = str(rng.choice(["stiffness", "damping", "friction", "slip_velocity"]))
            found["contact"] = [CONTACT | ({key: abs(_magnitude(rng))} if rng.random() < 0.5 else {})]
            found["channels"]["wrench.wrist"] = {"body": "lower", "frame": "lower"}
        elif kind == 6:
            found["servo"] = {"kp": abs(_magnitude(rng)), "kv": abs(_magnitude(rng))}
            if rng.random() < 0.5:
                found["servo"] |= {"limit": abs(_magnitude(rng)), "drive": "servo"}
            if rng.random() < 0.3:
                found["servo"]["supply"] = {"column": "volts", "nominal": abs(_magnitude(rng))}
        elif kind == 7:
            found["lock"] = [["elbow"], {"elbow": _magnitude(rng)}, "unrecorded", ["shoulder", "elbow"]][
                int(rng.integers(4))
            ]
        else:
            found["gravity"] = [_magnitude(rng), 0.0, -9.81]
    return found


def _recording(name: str, rng: np.random.Generator) -> Recording:
    """Two joints that swing, with one to three oddities."""
    count = int(rng.choice([8, 120, 300, 300, 300]))
    time = float(rng.choice([0.002, 0.01, 0.01, 0.1])) * np.arange(count)
    columns: dict[str, Array] = {}
    for k, joint in enumerate(JOINTS):
        columns[f"q.{joint}"] = 0.4 * np.sin((3.0 + k) * time) + 2e-4 * rng.standard_normal(count)
        columns[f"v.{joint}"] = 0.4 * (3.0 + k) * np.cos((3.0 + k) * time) + 1e-3 * rng.standard_normal(count)
        columns[f"u.{joint}"] = 5.0 * np.sin((3.0 + k) * time + 0.3)
        columns[f"cmd.{joint}"] = 0.5 * np.sin((3.0 + k) * time + 0.1)
    columns |= {f"wrench.wrist.{part}": rng.standard_normal(count) for part in ("fx", "fy", "fz", "tx", "ty", "tz")}
    columns["volts"] = np.full(count, 12.0)
    for _ in range(int(rng.integers(0, 4))):
        column = str(rng.choice(list(columns)))
        values = columns[column].copy()
        start = int(rng.integers(count))
        end = start + int(rng.integers(1, count))
        kind = int(rng.integers(10))
        if kind == 0:
            del columns[column]
            continue
        if kind == 1:
            values[start:end] = np.nan
        elif kind == 2:
            values[:] = _magnitude(rng)
        elif kind == 3:
            values *= _magnitude(rng)
        elif kind == 4:
            values[start] = _magnitude(rng)
        elif kind == 5:
            time = time + np.where(np.arange(count) > start, abs(_magnitude(rng)), 0.0)
        elif kind == 6:
            time = time[0] + np.cumsum(np.concatenate([[0.0], np.diff(time) * rng.uniform(0.1, 2.0, count - 1)]))
        elif kind == 7:
            values[rng.random(count) < 0.9] = np.nan
        elif kind == 8:
            values = np.round(values, 1)
        else:
            time = time * abs(_magnitude(rng)) + _magnitude(rng)
        columns[column] = values
    if np.any(np.diff(time) <= 0.0):
        time = 0.01 * np.arange(count)
    return Recording(name, time, columns)
