"""Cases on arms, simulated by MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from . import excitation, odd_arm, timing, wrong_inertials
from .arm_context import ArmContext
from .case import RECORDINGS, Case, World
from .draw_arm import DRAWS, draw_arm
from .draw_many import draw_many
from .laws import Laws
from .mujoco_arm import ArmInverse, ArmPlant
from .noise import KINDS, ChannelNoise, Clock, loguniform
from .robots import Array, Robot, random_arm
from .simulate import Motion, Simulation
from .truth import Channels, Concealed
from .urdf import arm_urdf

MEMBERS = len(RECORDINGS)
OF_COMMANDS = ("actuator_saturation", "actuator_dead_zone")
"""What an effort that is measured has been through, and what only a commanded one can show."""
PROCESS_TIME = 0.02
"""s, the correlation time of efforts that nobody knows of."""


@dataclass(frozen=True)
class Settings:
    """How an arm's case is recorded."""

    step: float
    samples: int
    skip: int
    excitation: str
    noise: str  # white | coloured_declared | coloured_undeclared | quantised
    jitter: str  # none | true | stamps
    has_velocity: bool
    states_std: bool
    effort_std: float  # relative to the efforts' rms; 0: commanded
    process: float  # std of efforts that nobody knows of, relative to the efforts' rms
    noisy_feedback: bool


def random_settings(rng: np.random.Generator, kind: str) -> Settings:
    plain = kind.startswith("pair")
    noise = str(rng.choice(KINDS))
    if kind == "null" and rng.random() < 0.15:
        noise = "coloured_undeclared"
    settings = Settings(
        step=0.002,
        samples=int(rng.integers(3000, 3501)),
        skip=int(rng.integers(300, 600)) if rng.random() < 0.25 else 0,
        excitation=str(rng.choice(excitation.KINDS)) if not plain else "rich",
        noise=noise,
        jitter=str(rng.choice(["none", "none", "none", "none", "true", "stamps"])),
        has_velocity=bool(rng.random() > 0.12),
        states_std=bool(rng.random() > 0.1),
        effort_std=loguniform(rng, 1e-4, 3e-3) if rng.random() < 0.08 else 0.0,
        process=loguniform(rng, 1e-5, 3e-4) if kind.startswith("single") and rng.random() < 0.08 else 0.0,
        noisy_feedback=bool(rng.random() < 0.5),
    )
    if kind != "many":
        return settings
    efforts, process = loguniform(rng, 1e-4, 3e-3), loguniform(rng, 2e-3, 2e-2)
    return replace(settings, excitation="rich", states_std=True, effort_std=efforts, process=process)


def random_unknown(rng: np.random.Generator, robot: Robot) -> tuple[Robot, list[dict[str, object]], dict[str, float]]:
    """The true robot, wrong within the prior of its unknown parameters; the scenario's `unknown`; the true values."""
    true, entries, values = robot, [], {}
    first = 1 if robot.size == 2 else int(rng.integers(robot.size))
    for link in sorted({first, *rng.integers(1, robot.size, size=int(rng.random() < 0.5) + 0)}):
        body = robot.links[link]
        mean, std = body.mass, 0.1 * body.mass
        mass = float(mean + std * np.clip(rng.normal(), -2.0, 2.0))
        true = true.replace_link(link, true.links[link].with_mass(mass))
        entries.append({"parameter": "mass", "body": body.name, "mean": mean, "std": std})
        values[f"mass.{body.name}"] = mass
    if rng.random() < 0.3:
        j = int(rng.integers(robot.size))
        mean = float(np.round(loguniform(rng, 0.02, 0.4), 4))
        damping = mean * float(1.0 + 0.3 * np.clip(rng.normal(), -2.0, 2.0))
        name = robot.joints[j].name
        entries.append({"parameter": "damping", "joint": name, "mean": mean, "std": 0.3 * mean})
        values[f"damping.{name}"] = damping
        robot, true = robot.replace_joint(j, damping=mean), true.replace_joint(j, damping=damping)
    return true, entries, values


def nominal_of(robot: Robot, entries: list[dict[str, object]]) -> Robot:
    """The robot of the model file: prior means in place."""
    for entry in entries:
        if entry["parameter"] == "damping":
            robot = robot.replace_joint(robot.joint_index(str(entry["joint"])), damping=float(entry["mean"]))  # type: ignore[arg-type]
    return robot


def controller(
    desired: excitation.Desired, feedforward: Array, inertia: Array, bandwidth: float, noise_q: Array, noise_v: Array
) -> Callable[[int, Array, Array], Array]:
    """Feedforward and a soft PD on what the robot's own encoders show; efforts (B, n)."""
    stiffness, damping = inertia * bandwidth**2, 1.6 * inertia * bandwidth

    def command(k: int, q: Array, v: Array) -> Array:
        error = desired.q[:, k] - q - noise_q[:, k]
        rate = desired.v[:, k] - v - noise_v[:, k]
        return feedforward[:, k] + stiffness * error + damping * rate

    return command


def simulate_arm(
    robot: Robot,
    effects: tuple[Concealed, ...],
    time: Array,
    desired: excitation.Desired,
    command: Callable[[int, Array, Array], Array],
    process: Array | None,
    skip: int,
    tolerance: float = 1e-8,
) -> tuple[Motion, Robot]:
    """The true motion and the true robot with the effects' changes in it."""
    laws = Laws()
    for item in effects:
        laws = laws + item.laws
        robot = item.change(robot) if item.change else robot
    rotors = {item.joint: robot.joints[item.joint].rotor_inertia for item in laws.transmissions}
    plant_robot = robot
    for joint in rotors:
        plant_robot = plant_robot.replace_joint(joint, rotor_inertia=0.0)
    plant = ArmPlant(plant_robot, len(time), laws.bodies)
    simulation = Simulation(plant, robot.size, laws, rotors, tolerance)
    return simulation.run(time, desired.q[:, 0], desired.v[:, 0], command, process, skip), robot


def make_arm(rng: np.random.Generator, size: int, kind: str, only: int | None = None) -> Case:
    """A case on a random arm; kind: null, single:<effect>, pair[:<effect>,<effect>], odd[:<name>], many.

    `only` conceals one of the drawn effects and leaves all else as it is, to reckon its strength by itself.
    """
    settings = random_settings(rng, kind)
    branch = bool(size >= 6 and rng.random() < 0.25)
    base = random_arm(rng, size, branch)
    true, entries, values = wrong_inertials.wrong(rng, base) if kind == "many" else random_unknown(rng, base)
    nominal = nominal_of(base, entries)
    total = settings.samples + settings.skip
    linear = np.array([joint.kind == "prismatic" for joint in nominal.joints])
    desired = excitation.desired(rng, MEMBERS, total, settings.step, size, settings.excitation, linear)
    inverse = ArmInverse(nominal)
    feedforward = np.stack([inverse.torque(desired.q[b], desired.v[b], desired.a[b]) for b in range(MEMBERS)])
    duration = settings.step * settings.samples
    context = ArmContext(nominal, desired.q, desired.v, feedforward, duration, settings.has_velocity, RECORDINGS)
    effects = draw_effects(rng, context, kind)
    if any(item.effect in OF_COMMANDS for item in effects):
        settings = replace(settings, effort_std=0.0)
    effects = effects if only is None else (effects[only],)
    if settings.skip:
        effects = tuple(_shifted(item, settings.step * settings.skip) for item in effects)
    noise_q, noise_v = channel_noise(rng, settings, linear)
    clock = Clock(
        settings.step,
        0.3 if settings.jitter != "none" else 0.0,
        min(2e-5, 0.2 * noise_q.declared_std / max(context.speed(j) for j in range(size)))
        if settings.jitter == "stamps"
        else 0.0,
    )
    time = clock.times(rng, MEMBERS, total)
    drawn_q, drawn_v = noise_q.draw(rng, time, size), noise_v.draw(rng, time, size)
    seen = 1.0 if settings.noisy_feedback else 0.0
    inertia = np.diag(inverse.mass_matrix(desired.q[0, 0]))
    command = controller(desired, feedforward, inertia, rng.uniform(4.0, 8.0), seen * drawn_q, seen * drawn_v)
    scale = np.array([context.effort(j) for j in range(size)])
    process = (
        settings.process * scale * ChannelNoise(1.0, PROCESS_TIME).draw(rng, time, size) if settings.process else None
    )
    motion, world = simulate_arm(true, effects, time, desired, command, process, settings.skip)
    channels = sensed(motion, nominal, effects)
    measured = {name: curve(motion.time) for name, curve in channels.columns.items()}
    tables = tabulate(rng, settings, nominal, motion, measured, drawn_q, drawn_v, noise_q, noise_v, clock, scale)
    scenario = arm_scenario(settings, nominal, entries, noise_q, noise_v, scale, rng)
    truth = {
        "kind": kind,
        "rig": nominal.name + ("_branched" if branch else ""),
        "verdict": verdict(kind, effects),
        "effects": [item.statement() for item in effects],
        "nominal_parameters_true": values,
        "noise": {"kind": settings.noise, "q": noise_q.declared_std, "v": noise_v.declared_std},
        "settings": settings.__dict__,
    }
    study = {"world": World(nominal, world, motion, measured, effects), "settings": settings, "entries": entries}
    study |= {"noise_q": noise_q, "noise_v": noise_v, "unaffected": true, "scale": scale}
    return Case(kind, nominal.name, scenario, f"{nominal.name}.urdf", arm_urdf(nominal), tables, truth, study)


def verdict(kind: str, effects: tuple[Concealed, ...]) -> str:
    if kind.startswith("null"):
        return "none"
    return "unexplained" if any(item.effect.startswith("odd_") for item in effects) else "explained"


def draw_effects(rng: np.random.Generator, context: ArmContext, kind: str) -> tuple[Concealed, ...]:
    head, _, names = kind.partition(":")
    if head == "null":
        return ()
    if head == "many":
        return draw_many(rng, context)
    if head == "odd":
        return (odd_arm.draw(rng, context, names or str(rng.choice(sorted(odd_arm.DRAWS)))),)
    chosen = names.split(",") if names else [str(rng.choice(sorted(DRAWS)))]
    if head == "pair" and len(chosen) < 2:
        second = [
            effect
            for effect in sorted(DRAWS)
            if effect not in chosen and effect.split("_")[0] != chosen[0].split("_")[0]
        ]
        chosen.append(str(rng.choice(second)))
    effects: list[Concealed] = []
    used: frozenset[int] = frozenset()
    for effect in chosen:
        item, joint = draw_arm(rng, context, effect, used)
        used |= {joint}
        effects.append(item)
    return tuple(effects)


def _shifted(item: Concealed, seconds: float) -> Concealed:
    """A pulse's clock starts with the recording, the simulation's earlier."""
    if item.interval is None:
        return item
    bodies = tuple(
        replace(law, force=lambda t, p, r, v, w, force=law.force: force(t - seconds, p, r, v, w))
        for law in item.laws.bodies
    )
    return replace(item, laws=replace(item.laws, bodies=bodies))


def channel_noise(
    rng: np.random.Generator, settings: Settings, linear: np.ndarray
) -> tuple[ChannelNoise, ChannelNoise]:
    """Noise of q and v; in metres a tenth where an axis slides would complicate the file, so one std serves all."""
    q, v = loguniform(rng, 2e-5, 6e-4), loguniform(rng, 5e-4, 1.2e-2)
    if settings.noise.startswith("coloured"):
        both = loguniform(rng, 0.003, 0.03)
        return ChannelNoise(q, both if rng.random() < 0.5 else 0.0), ChannelNoise(v, both)
    if settings.noise == "quantised":
        return ChannelNoise(q * rng.uniform(0.3, 1.0), quantum=q * rng.uniform(1.0, 3.0)), ChannelNoise(v)
    return ChannelNoise(q), ChannelNoise(v)


def sensed(motion: Motion, robot: Robot, effects: tuple[Concealed, ...]) -> Channels:
    """Noise-free channels after the sensors' own effects."""
    columns = {}
    for j, joint in enumerate(robot.joints):
        q, v, a = motion.q[:, :, j], motion.v[:, :, j], motion.a[:, :, j]
        columns[f"q.{joint.name}"] = timing.position_curve(motion.time, q, v, a)
        columns[f"v.{joint.name}"] = timing.velocity_curve(motion.time, v, a)
    channels = Channels(motion.time, columns)
    for item in effects:
        channels = item.sensor(channels) if item.sensor else channels
    return channels


def tabulate(
    rng: np.random.Generator,
    settings: Settings,
    robot: Robot,
    motion: Motion,
    measured: dict[str, Array],
    drawn_q: Array,
    drawn_v: Array,
    noise_q: ChannelNoise,
    noise_v: ChannelNoise,
    clock: Clock,
    scale: Array,
) -> dict[str, pd.DataFrame]:
    """Recordings by file name."""
    stamps = clock.stamps(rng, motion.time)
    tables = {}
    effort_noise = settings.effort_std * scale * rng.normal(size=motion.u.shape)
    for b, name in enumerate(RECORDINGS):
        table: dict[str, Array] = {"time": np.round(stamps[b], 9)}
        for j, joint in enumerate(robot.joints):
            table[f"q.{joint.name}"] = noise_q.measure(measured[f"q.{joint.name}"][b], drawn_q[b, settings.skip :, j])
        for j, joint in enumerate(robot.joints if settings.has_velocity else ()):
            table[f"v.{joint.name}"] = noise_v.measure(measured[f"v.{joint.name}"][b], drawn_v[b, settings.skip :, j])
        for j, joint in enumerate(robot.joints):
            table[f"u.{joint.name}"] = motion.u[b, :, j] + effort_noise[b, :, j]
        tables[name] = pd.DataFrame(table)
    return tables


def arm_scenario(
    settings: Settings,
    robot: Robot,
    entries: list[dict[str, object]],
    noise_q: ChannelNoise,
    noise_v: ChannelNoise,
    scale: Array,
    rng: np.random.Generator,
) -> dict[str, object]:
    """The scenario as a user would write it."""
    declared = settings.noise == "coloured_declared"
    channels: dict[str, dict[str, object]] = {"q": _channel(noise_q, declared, settings.states_std)}
    if settings.has_velocity:
        channels["v"] = _channel(noise_v, declared, settings.states_std)
    channels["u"] = {"std": 0.0, "hold": "zero_order"}
    if settings.effort_std:
        for joint, size in zip(robot.joints, scale, strict=True):
            channels[f"u.{joint.name}"] = {"std": float(settings.effort_std * size)}
    return {
        "model": f"{robot.name}.urdf",
        "gravity": [0, 0, -9.81],
        "weld": [{"body": "base"}],
        "channels": channels,
        "unknown": entries,
        "contact": [],
    }


def _channel(noise: ChannelNoise, declared: bool, stated: bool) -> dict[str, object]:
    entry: dict[str, object] = {"std": noise.declared_std} if stated else {}
    if declared and noise.correlation_time > 0.0:
        entry["correlation_time"] = noise.correlation_time
    return entry
