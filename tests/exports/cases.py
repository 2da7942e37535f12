"""Corrections of a model, drawn at random from those that its format can hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from drake_cafim.dynamics.motion import mass_matrix, motion
from drake_cafim.scene.scene import Scene


def corrected_scenario(
    model: Path,
    folder: Path,
    rng: np.random.Generator,
    *,
    weld: str = "",
    lock: tuple[str, ...] = (),
    springs: bool = True,
) -> Path:
    """A scenario of the model with corrections of every kind, of a size that changes its motion, in `folder`."""
    raw: dict[str, Any] = {"model": str(model), "channels": {"q": {"std": 1e-4}, "u": {"std": 0.0}}}
    raw |= {"weld": [{"body": weld}]} if weld else {}
    raw |= {"lock": list(lock)} if lock else {}
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(raw))
    scene = Scene.load(path)
    joints = scene.tree.joints
    resting = motion(scene.tree, np.full((1, len(joints)), 0.3), np.zeros((1, len(joints))))
    inertia = np.diag(mass_matrix(resting)[0]) + [joint.rotor_inertia for joint in joints]
    picked = rng.permutation(len(joints))

    def joint(k: int) -> tuple[str, float]:
        j = int(picked[k % len(joints)])
        return joints[j].name, float(inertia[j])

    effects = []
    for k, (name, strength, rate) in enumerate(
        [
            ("joint_viscous_friction", "coefficient", 1.5),
            ("joint_coulomb_friction", "torque", 1.0),
            ("rotor_inertia", "inertia", 0.3),
        ]
    ):
        place, size = joint(k)
        effects.append({"effect": name, "at": place, strength: round(float(size * rate * rng.uniform(0.5, 1.5)), 6)})
    place, size = joint(3)
    if springs:
        effects.append(
            {"effect": "joint_spring", "at": place, "stiffness": float(size * rng.uniform(5.0, 15.0)), "rest": 0.1}
        )
    moving = [body for body in scene.tree.bodies if body.joint >= 0 and body.mass > 0.0]
    loaded, heavy = moving[-1], moving[int(rng.integers(len(moving)))]
    x, y, z = (float(value) for value in np.round(loaded.p_BBcm + rng.normal(0.0, 0.02, 3), 4))
    effects.append(
        {"effect": "payload", "at": loaded.name, "mass": round(0.3 * loaded.mass, 6), "x": x, "y": y, "z": z}
    )
    unknown = [{"parameter": "mass", "body": heavy.name, "mean": 1.15 * heavy.mass, "std": 0.1 * heavy.mass}]
    path.write_text(yaml.safe_dump(raw | {"effects": effects, "unknown": unknown}, sort_keys=False))
    return path
