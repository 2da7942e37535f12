"""The noise that a diagnosis estimated, taken from its report into the scene of the next experiment."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from drake_cafim.scenario.schema import UNRECORDED, Channel
from drake_cafim.scene.scene import Scene


def with_reported_noise(scene: Scene, noise: Mapping[str, Mapping[str, Any]]) -> Scene:
    """The scene whose channels without a stated std have those of a report's `noise`; what is stated stays.

    `lock: unrecorded` holds the joints that the report has no column of.
    """
    scene = _without_unrecorded_joints(scene, noise)
    channels = dict(scene.scenario.channels)
    parts: dict[str, dict[str, list[float]]] = {}
    for column, entry in noise.items():
        if scene.std(column) is None and entry["std"]:
            own, part = _channel_and_part(column)
            parts.setdefault(own, {}).setdefault(part, []).append(float(entry["std"]))
            before = scene.channel(column) or Channel()
            # a time that the scenario states is in the report too
            channels[own] = replace(before, correlation_time=float(entry.get("correlation_time") or 0.0))
    for own, found in parts.items():
        rms = {part: float(np.sqrt(np.mean(np.square(values)))) for part, values in found.items()}
        channels[own] = replace(channels[own], std={**channels[own].std, **rms})
    return replace(scene, scenario=replace(scene.scenario, channels=channels))


def _without_unrecorded_joints(scene: Scene, noise: Mapping[str, Any]) -> Scene:
    lacking = [name for name in scene.tree.joint_names if f"q.{name}" not in noise]
    if scene.scenario.lock != UNRECORDED or not lacking or len(lacking) == len(scene.tree.joint_names):
        return scene
    scenario = replace(scene.scenario, lock=lacking)
    return Scene.build(scenario, scene.folder, scene.name, effects=scene.vocabulary)


def _channel_and_part(column: str) -> tuple[str, str]:
    """The key under `channels:` of one column, and the key of its std there."""
    place, _, last = column.rpartition(".")
    kind = column.split(".")[0]
    if kind == "wrench":
        return place, "force" if last.startswith("f") else "torque"
    if kind == "pose":
        return place, "position" if last in ("x", "y", "z") else "rotation"
    return column, "all"
