"""The two estimators, each behind one call: values and standard deviations of a task's parameters from a recording."""

from __future__ import annotations

import contextlib
import io
import resource
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.concealed.robots import Array

from .task import STD, STEP, Parameter, Recorded, Task, record, set_value
from .tasks import TASKS


@dataclass(frozen=True)
class Answer:
    """Values and standard deviations (p,); seconds of the call; what a tool says that failed."""

    values: list[float] | None
    std: list[float] | None
    seconds: float
    megabytes: float
    words: str = ""


def answer(tool: Callable[[Task, Recorded], tuple[Array, Array]], task: Task, recorded: Recorded) -> Answer:
    """The tool's, timed; a failure is an answer without values."""
    begun = time.perf_counter()
    try:
        values, std = tool(task, recorded)
        words = ""
    except Exception as error:  # what a tool raises is its result
        values = std = None
        words = f"{type(error).__name__}: {error}"[:300]
    taken = time.perf_counter() - begun
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    told = (None if x is None else np.asarray(x, dtype=float).tolist() for x in (values, std))
    return Answer(*told, taken, memory, words)


def ours(task: Task, recorded: Recorded) -> tuple[Array, Array]:
    """`drake_cafim.estimate`, on the scene and the recording that `cafim estimate` would read."""
    import drake_cafim

    found = drake_cafim.estimate(scene_with_priors(task), [recording_of(task, recorded)])
    return np.array([p.value for p in found.parameters]), np.array([p.std for p in found.parameters])


def recording_of(task: Task, recorded: Recorded) -> Any:
    """The recording as `cafim estimate` reads it."""
    from drake_cafim.recordings.recording import Recording

    columns = {}
    for j, name in enumerate(task.names):
        columns |= {f"q.{name}": recorded.q[:, j], f"v.{name}": recorded.v[:, j], f"u.{name}": recorded.u[:, j]}
    return Recording("recording", recorded.time, columns)


@cache
def scene_with_priors(task: Task) -> Any:
    """The scene with the task's parameters unknown, and priors at their starts."""
    import drake_cafim
    from tests.concealed.urdf import arm_urdf

    robot = task.robot
    for joint in range(robot.size):
        robot = robot.replace_joint(joint, rotor_inertia=0.0)
    for parameter in task.parameters:
        if parameter.kind == "mass":
            link = robot.link_index(parameter.at)
            robot = robot.replace_link(link, robot.links[link].with_mass(parameter.start))
        elif parameter.kind == "armature":
            robot = robot.replace_joint(robot.joint_index(parameter.at), rotor_inertia=parameter.start)
    folder = Path(tempfile.mkdtemp())
    (folder / "robot.urdf").write_text(arm_urdf(robot))
    scenario = {
        "model": "robot.urdf",
        "weld": [{"body": "base"}],
        "channels": {
            "q": {"std": STD["q"]},
            "v": {"std": STD["v"]},
            # a servo's torque changes from sample to sample; one that is commanded is held
            "u": {"std": STD["u"], "hold": "first_order"} if task.servo else {"std": 0.0, "hold": "zero_order"},
        },
        "unknown": [_entry(parameter) for parameter in task.parameters],
    }
    (folder / "scenario.yaml").write_text(yaml.safe_dump(scenario, sort_keys=False))
    return drake_cafim.Scene.load(folder / "scenario.yaml")


def _entry(parameter: Parameter) -> dict[str, object]:
    """An entry of `unknown:` with a prior at the start, half as wide as a mass and three times as wide as any other."""
    if parameter.kind == "mass":
        return {"parameter": "mass", "body": parameter.at, "mean": parameter.start, "std": 0.5 * parameter.start}
    prior = {"mean": parameter.start, "std": 3.0 * parameter.start}
    if parameter.kind == "friction":
        return {"effect": "joint_coulomb_friction", "at": parameter.at, "parameter": "torque", **prior}
    kind = {"damping": "damping", "armature": "rotor_inertia"}[parameter.kind]
    return {"parameter": kind, "joint": parameter.at, **prior}


def theirs(task: Task, recorded: Recorded) -> tuple[Array, Array]:
    """`mujoco.sysid` as its documentation has it, from the true initial state."""
    return _sysid(task, recorded, weighted=False)


def theirs_weighted(task: Task, recorded: Recorded) -> tuple[Array, Array]:
    """`mujoco.sysid` with each sensor's residual divided by its noise, by weights that undo its own scaling."""
    return _sysid(task, recorded, weighted=True)


def _sysid(task: Task, recorded: Recorded, weighted: bool) -> tuple[Array, Array]:
    import mujoco
    from mujoco import sysid

    spec = mujoco.MjSpec.from_string(task.xml)
    model = spec.compile()
    kinds = ("q", "v", "u") if task.servo else ("q", "v")
    data = np.concatenate([getattr(recorded, kind) for kind in kinds], axis=1)
    times = STEP * np.arange(len(recorded.controls))
    # a rollout's sensors show the state before the step that its time ends
    sensors = sysid.TimeSeries.from_names(recorded.time[1:] + STEP, data[1:], model)
    control = sysid.TimeSeries(times, recorded.controls)
    start = sysid.create_initial_state(model, recorded.q0, recorded.v0)
    sequences = [sysid.ModelSequences(task.name, spec, "recording", start, control, sensors)]
    parameters = sysid.ParameterDict()
    for item in task.parameters:
        parameters.add(
            sysid.Parameter(item.name, item.start, 0.05 * item.start, 20.0 * item.start, modifier=_modifier(item))
        )
    more: dict[str, Any] = {}
    if weighted:
        scale = np.linalg.norm(data[1:], axis=0) / np.sqrt(2.0)
        std = np.repeat([STD[kind] for kind in kinds], task.robot.size)
        names = [model.sensor(i).name for i in range(model.nsensor)]
        more["sensor_weights"] = dict(zip(names, scale / std, strict=True))
    residual = sysid.build_residual_fn(models_sequences=sequences, n_threads=1, **more)
    with contextlib.redirect_stdout(io.StringIO()):
        found, result = sysid.optimize(parameters, residual, verbose=False)
    left, _, _ = residual(found.as_vector(), found)
    _, intervals = sysid.calculate_intervals(left, result.jac)
    # half widths of 95 % intervals by Student's t, of so many samples that it is the normal one
    return found.as_vector(), np.asarray(intervals) / 1.96


def _modifier(parameter: Parameter) -> Callable[[Any, Any], None]:
    def modify(spec: Any, value: Any) -> None:
        set_value(spec, parameter, float(value.value[0]))

    return modify


TOOLS = {"ours": ours, "mujoco.sysid": theirs, "sysid, weights": theirs_weighted}


def single(name: str, index: int, seed: int) -> Answer:
    """The tool's answer to a seed of a task; before the first, the tool is warmed up on another recording."""
    task = TASKS[index]
    _warm(name, task)
    return answer(TOOLS[name], task, record(task, seed))


@cache
def _warm(name: str, task: Task) -> None:
    # imports and compilations are no estimate; a second of motion is enough for them
    short = replace(task, duration=1.0)
    answer(TOOLS[name], short, record(short, 10**6))
