"""Hostile scenario files: those of the project and of practice arms, damaged as trees or as bytes."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from drake_cafim.scenario.law_table import write_law
from drake_cafim.scene.scene import Scene
from tests.fuzzing.models import PLAIN_URDF
from tests.fuzzing.mutate import damage_bytes, damage_tree
from tests.fuzzing.verdict import judge

ARM: dict[str, Any] = {
    "model": "arm.urdf",
    "gravity": [0, 0, -9.81],
    "weld": [{"body": "base"}],
    "lock": {"elbow": 0.1},
    "packages": {"own": "."},
    "channels": {
        "q": {"std": 2e-4},
        "v.shoulder": {"std": 1e-3, "correlation_time": 0.01},
        "u": {"std": 0.0, "hold": "first_order"},
        "wrench.wrist": {"body": "lower", "frame": "lower", "std": {"force": 0.1, "torque": 0.01}},
    },
    "unknown": [
        {"parameter": "mass", "body": "lower", "mean": 1.5, "std": 0.15},
        {"parameter": "damping", "joint": "shoulder", "std": 0.1},
        {"effect": "payload", "at": "lower", "parameter": "mass", "std": 1.0},
    ],
    "contact": [
        {"bodies": ["lower", "ground"], "ground": {"point": [0, 0, 0], "normal": [0, 0, 1]}, "stiffness": 4000.0}
        | {"damping": 6.0, "friction": 0.35, "slip_velocity": 0.01}
    ],
    "effects": [{"effect": "joint_coulomb_friction", "at": "shoulder", "torque": 0.5}],
    "topics": {"/x": {"joints": {"a": "shoulder"}, "fields": {"position": "q"}, "scale": 1.0, "offset": 0.1}},
}
MORE: dict[str, Any] = {
    "model": "arm.urdf",
    "lock": "unrecorded",
    "channels": {
        "u.elbow": {"lowpass": {"order": 6, "cutoff": 2.0, "zero_phase": True}},
        "pose.lower": {"std": {"position": 2e-4, "rotation": 4e-3}},
    },
    "servo": {"kp": {"column": "gain", "scale": 0.001}, "kv": {"elbow": 0.6}, "limit": 3.35, "drive": "servo"}
    | {"supply": {"column": "volts", "nominal": 7.4}},
    "unknown": [
        {"parameter": "servo_stiffness", "joint": "elbow", "std": 0.1},
        {"parameter": "inertials", "body": "all", "std": 0.1},
        {"parameter": "friction", "contact": ["lower", "ground"], "mean": 0.3, "std": 0.1},
    ],
    "contact": [
        {"bodies": ["lower", "ground"], "ground": {"point": [0, 0, 0], "normal": [0, 0, 1]}, "law": "kelvin_voigt"}
        | {"stiffness": 4000.0, "damping": 6.0, "friction": 0.35, "resistance": 10.0},
    ],
    "effects": [
        {"effect": "external_disturbance", "at": "lower", "x": 5.0, "interval": [0.1, 0.2], "recording": "a.csv"},
        {"effect": "learned_force", "at": "elbow", "table": "law.parquet"},
        {"effect": "contact_law", "at": "lower/ground", "law": "hydroelastic", "modulus": 1e6},
        {"effect": "sensor_bias", "at": "q.elbow", "bias": 0.1},
        {"effect": "gravity_misalignment", "at": "world", "roll": 0.1, "pitch": 0.1},
        {"effect": "inertial_error", "at": "lower", "mass": 0.1},
    ],
    "topics": {
        "/y": {"columns": ["u.elbow", ""], "join": 0.001, "stamp": "log"},
        "/z": {"sensor": "wrist", "body": ""},
    },
    "plant_config": {"time_step": 0.01},
    "model_drivers": {"arm": {"!IiwaDriver": {}}},
    "simulation_duration": 5.0,
}
DIRECTED: dict[str, Any] = {
    "directives": [
        {"add_model": {"name": "arm", "file": "arm.urdf"}},
        {"add_frame": {"name": "f", "X_PF": {"base_frame": "arm::base", "translation": [0.0, 0.0, 0.1]}}},
    ],
    "channels": {"q": {"std": 2e-4}},
    "lock": ["elbow"],
}


ARM_URDF = PLAIN_URDF.replace('<link name="world"/>', '<link name="ground_plate"/>').replace(
    '"world"', '"ground_plate"'
)
ARM["weld"] = [{"body": "ground_plate"}]
DIRECTED["weld"] = MORE["weld"] = [{"body": "ground_plate"}]


LAW = {"variables": ["q", "q"], "x": [0.0, 1.0], "force": [0.1, 0.2], "width": [1.0, 1.0]}


class ScenarioCases:
    """Inputs that are scenarios; each is a number, and the same number is the same input."""

    def __init__(self) -> None:
        self._seeds = [ARM, DIRECTED, MORE]

    def run(self, number: int, folder: Path) -> str:
        """What becomes of scenario `number`, written into `folder`."""
        rng = np.random.default_rng(number)
        (folder / "arm.urdf").write_text(ARM_URDF)
        write_law(folder / "law.parquet", LAW)
        path = folder / "scenario.yaml"
        seed = self._seeds[int(rng.choice(3, p=[0.4, 0.2, 0.4]))]
        if rng.random() < 0.25:
            path.write_bytes(damage_bytes(yaml.safe_dump(seed).encode(), rng))
        else:
            path.write_text(yaml.dump(damage_tree(seed, rng), allow_unicode=True), "utf-8", errors="replace")
        return judge(lambda: Scene.load(path), [path.name])
