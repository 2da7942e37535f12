"""Cases on the pressing stage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from . import timing
from .arm_case import DRAWS, MEMBERS, Settings, random_settings, verdict
from .arm_context import ArmContext
from .case import RECORDINGS, Case, World
from .contact_law import ContactLaw
from .draw_arm import draw_arm
from .draw_contact import ODD_CONTACT, WRENCH, ContactContext, draw_contact, draw_odd_contact, draw_wrench
from .excitation import Desired, _ramp, multisine
from .laws import Laws
from .noise import ChannelNoise, Clock, loguniform
from .press import NAMES, PressPlant, Stage, random_stage
from .robots import Array
from .simulate import Motion, Simulation
from .truth import CONTACT, SENSOR, Channels, Concealed

ON_STAGE = (
    *(effect for effect in CONTACT if effect != "contact_rolling_resistance"),
    *SENSOR,
    "joint_viscous_friction",
    "joint_coulomb_friction",
    "joint_stribeck_friction",
    "actuator_delay",
    "actuator_lag",
    "actuator_gain_error",
    "actuator_bias",
)


def press_desired(
    rng: np.random.Generator, stage: Stage, law: ContactLaw, samples: int, step: float, kind: str
) -> tuple[Desired, float]:
    """Rubbing multisines and a pressing force that swings, sometimes off the wall; and the typical force (N)."""
    time = step * np.arange(samples)
    ramp, ramp1, ramp2 = _ramp(time, 0.4)
    q, v, a = (np.zeros((MEMBERS, samples, 3)) for _ in range(3))
    force = float(rng.uniform(3.0, 8.0))
    surface = stage.radius - float(stage.tip[2])
    for member in range(MEMBERS):
        for axis in range(2):
            frequency = rng.uniform(0.15, 0.5 if kind == "slow" else 1.8, 4)
            peak = rng.uniform(0.05, 0.2) * (0.15 if kind == "small" else 1.0)
            amplitude = np.minimum(peak * rng.dirichlet(np.ones(4)) / (2.0 * np.pi * frequency), 0.02)
            s0, s1, s2 = multisine(time, amplitude, frequency, rng.uniform(0.0, 6.28, 4))
            s0 = s0 - s0[0]
            q[member, :, axis] = ramp * s0
            v[member, :, axis] = ramp1 * s0 + ramp * s1
            a[member, :, axis] = ramp2 * s0 + 2.0 * ramp1 * s1 + ramp * s2
        frequency = rng.uniform(0.3, 1.0 if kind == "slow" else 5.0, 5)
        swing = rng.uniform(0.4, 1.15) * (0.2 if kind == "small" else 1.0)
        f0, f1, f2 = multisine(time, swing * force * rng.dirichlet(np.ones(5)), frequency, rng.uniform(0.0, 6.28, 5))
        f0 = f0 + force
        hover = -0.3e-3
        depth = f0 / law.stiffness
        q[member, :, 2] = surface - hover - ramp * (depth - hover)
        v[member, :, 2] = -(ramp1 * (depth - hover) + ramp * f1 / law.stiffness)
        a[member, :, 2] = -(ramp2 * (depth - hover) + 2.0 * ramp1 * f1 / law.stiffness + ramp * f2 / law.stiffness)
    return Desired(q, v, a, kind), force


def _feedforward(stage: Stage, law: ContactLaw, desired: Desired) -> Array:
    """Inertia, weight and the expected normal force (B, N, 3)."""
    masses = np.cumsum([link.mass for link in stage.robot.links][::-1])[::-1]
    effort = stage.moved * desired.a - masses * stage.robot.gravity
    depth = stage.radius - stage.tip[2] - desired.q[:, :, 2]
    effort[:, :, 2] -= np.where(depth > 0.0, law.stiffness * depth, 0.0)
    return effort


def draw_effects(
    rng: np.random.Generator, arm: ArmContext, contact: ContactContext, kind: str
) -> tuple[Concealed, ...]:
    head, _, names = kind.partition(":")
    if head == "null":
        return ()
    if head == "odd":
        return (draw_odd_contact(rng, contact, names or str(rng.choice(sorted(ODD_CONTACT)))),)
    chosen = names.split(",") if names else [str(rng.choice(ON_STAGE))]
    if head == "pair" and len(chosen) < 2:
        others = [effect for effect in ON_STAGE if effect.split("_")[0] != chosen[0].split("_")[0]]
        chosen.append(str(rng.choice(others)))
    return tuple(_draw(rng, arm, contact, effect) for effect in chosen)


def _draw(rng: np.random.Generator, arm: ArmContext, contact: ContactContext, effect: str) -> Concealed:
    if effect in CONTACT:
        return draw_contact(rng, contact, effect)
    if effect in SENSOR:
        return draw_wrench(rng, contact, effect)
    if effect not in DRAWS:
        raise ValueError(f"{effect}: not on a stage")
    return draw_arm(rng, arm, effect)[0]


def make_press(rng: np.random.Generator, kind: str, only: int | None = None) -> Case:
    """A case on a random stage; kind: null, single:<effect>, pair[:<effect>,<effect>], odd[:<name>].

    `only` conceals one of the drawn effects and leaves all else as it is, to reckon its strength by itself.
    """
    settings = replace(random_settings(rng, kind), has_velocity=True, skip=0, samples=3000, effort_std=0.0)
    if settings.excitation in ("few", "monotone"):
        settings = replace(settings, excitation="rich")
    stage = random_stage(rng)
    nominal = ContactLaw(
        stiffness=float(np.round(rng.uniform(2500.0, 7500.0))),
        damping=float(np.round(rng.uniform(20.0, 70.0), 1)),
        friction=float(np.round(rng.uniform(0.25, 0.6), 3)),
        slip_velocity=float(rng.choice([0.004, 0.006, 0.01])),
    )
    true, entries, values = _unknown(rng, nominal)
    desired, force = press_desired(rng, stage, nominal, settings.samples, settings.step, settings.excitation)
    feedforward = _feedforward(stage, nominal, desired)
    arm = ArmContext(stage.robot, desired.q, desired.v, feedforward, settings.step * settings.samples, True, RECORDINGS)
    speed = float(np.sqrt(np.mean(np.sum(desired.v[:, :, :2] ** 2, axis=2))))
    effects = draw_effects(rng, arm, ContactContext(nominal, force, speed, "tool/wall", "wall"), kind)
    effects = effects if only is None else (effects[only],)
    noise = _noise(rng, settings)
    clock = Clock(
        settings.step, 0.3 if settings.jitter != "none" else 0.0, 3e-6 if settings.jitter == "stamps" else 0.0
    )
    time = clock.times(rng, MEMBERS, settings.samples)
    drawn = {name: noise[name].draw(rng, time, 3) for name in ("q", "v", "force", "torque")}
    seen = 1.0 if settings.noisy_feedback else 0.0
    bandwidth = 2.0 * np.pi * rng.uniform(2.0, 3.0)

    def command(k: int, q: Array, v: Array) -> Array:
        error = desired.q[:, k] - q - seen * drawn["q"][:, k]
        rate = desired.v[:, k] - v - seen * drawn["v"][:, k]
        return feedforward[:, k] + stage.moved * (bandwidth**2 * error + 1.6 * bandwidth * rate)

    process = None
    if settings.process:
        process = settings.process * force * ChannelNoise(1.0, 0.02).draw(rng, time, 3)
    plant, motion = simulate_press(stage, true, effects, time, desired.q[:, 0], command, process)
    measured = {name: curve(motion.time) for name, curve in sensed(plant, motion, effects).columns.items()}
    tables = tabulate(measured, motion, clock.stamps(rng, motion.time), drawn, noise)
    truth = {
        "kind": kind,
        "rig": "press",
        "verdict": verdict(kind, effects),
        "effects": [item.statement() for item in effects],
        "nominal_parameters_true": values,
        "noise": {"kind": settings.noise} | {name: noise[name].declared_std for name in noise},
        "settings": settings.__dict__,
    }
    study = {
        "world": World(stage.robot, plant.stage.robot, motion, measured, effects),
        "stage": stage,
        "nominal_law": nominal,
        "true_law": true,
        "plant": plant,
        "settings": settings,
        "entries": entries,
        "noise": noise,
    }
    return Case(
        kind,
        "press",
        press_scenario(settings, nominal, entries, noise),
        "press.urdf",
        stage.urdf(),
        tables,
        truth,
        study,
    )


def _unknown(
    rng: np.random.Generator, nominal: ContactLaw
) -> tuple[ContactLaw, list[dict[str, object]], dict[str, float]]:
    true, entries, values = nominal, [], {}
    names = ["stiffness", "friction"] + (["damping"] if rng.random() < 0.3 else [])
    for name in names:
        mean = float(getattr(nominal, name))
        std = mean * (0.05 if name != "damping" else 0.15)
        value = float(mean + std * np.clip(rng.normal(), -2.0, 2.0))
        true = replace(true, **{name: value})
        entries.append({"parameter": name, "contact": ["tool", "wall"], "mean": mean, "std": std})
        values[name] = value
    return true, entries, values


def _noise(rng: np.random.Generator, settings: Settings) -> dict[str, ChannelNoise]:
    q, v, force = loguniform(rng, 3e-6, 2e-5), loguniform(rng, 1e-4, 1e-3), loguniform(rng, 0.02, 0.3)
    torque = force * rng.uniform(0.05, 0.2)
    time = loguniform(rng, 0.003, 0.03) if settings.noise.startswith("coloured") else 0.0
    quantum = q * rng.uniform(1.0, 2.5) if settings.noise == "quantised" else 0.0
    return {
        "q": ChannelNoise(q * (0.6 if quantum else 1.0), quantum=quantum),
        "v": ChannelNoise(v, time),
        "force": ChannelNoise(force, time),
        "torque": ChannelNoise(torque, time),
    }


def simulate_press(
    stage: Stage,
    law: ContactLaw,
    effects: tuple[Concealed, ...],
    time: Array,
    q0: Array,
    command: object,
    process: Array | None,
    tolerance: float = 1e-8,
) -> tuple[PressPlant, Motion]:
    """The plant with the effects in it and its noise-free motion."""
    laws, robot = Laws(), stage.robot
    for item in effects:
        laws = laws + item.laws
        robot = item.change(robot) if item.change else robot
        changes = dict(item.contact)
        if changes.get("anisotropic") is not None:
            # Coefficients were stated for the nominal friction; they are what they are, the nominal one is gone.
            changes["friction"] = law.friction
        if changes.get("static") is not None:
            changes["static"] = float(changes["static"])  # type: ignore[arg-type]
        law = replace(law, **changes)  # type: ignore[arg-type]
    plant = PressPlant(replace(stage, robot=robot), law, len(time))
    simulation = Simulation(plant, 3, laws, {}, tolerance)
    return plant, simulation.run(time, q0, np.zeros_like(q0), command, process)  # type: ignore[arg-type]


def sensed(plant: PressPlant, motion: Motion, effects: tuple[Concealed, ...]) -> Channels:
    """Noise-free q, v and wrench after the sensors' own effects."""
    columns = {}
    for j, name in enumerate(NAMES):
        q, v, a = motion.q[:, :, j], motion.v[:, :, j], motion.a[:, :, j]
        columns[f"q.{name}"] = timing.position_curve(motion.time, q, v, a)
        columns[f"v.{name}"] = timing.velocity_curve(motion.time, v, a)
    for row, axis in enumerate(WRENCH):
        columns[f"wrench.wrist.{axis}"] = _wrench_curve(plant, motion, row, dict(columns))
    channels = Channels(motion.time, columns)
    for item in effects:
        channels = item.sensor(channels) if item.sensor else channels
    return channels


def _wrench_curve(plant: PressPlant, motion: Motion, row: int, states: dict[str, timing.Curve]) -> timing.Curve:
    def curve(at: Array) -> Array:
        # Before the first sample the sensor shows what it shows at the first.
        at = np.clip(at, motion.time[:, :1], motion.time[:, -1:])
        q = np.stack([states[f"q.{name}"](at) for name in NAMES], axis=2).reshape(-1, 3)
        v = np.stack([states[f"v.{name}"](at) for name in NAMES], axis=2).reshape(-1, 3)
        hidden = np.stack(
            [timing.fine_curve(motion.time, motion.hidden[:, :, i])(at) for i in range(plant.hidden)], axis=2
        ).reshape(-1, plant.hidden)
        t = at.ravel()
        mode = plant.boundary(t, q, v, hidden) > 0.0
        return plant.wrench(t, q, v, hidden, mode)[:, row].reshape(at.shape)

    return curve


def tabulate(
    measured: dict[str, Array], motion: Motion, stamps: Array, drawn: dict[str, Array], noise: dict[str, ChannelNoise]
) -> dict[str, pd.DataFrame]:
    tables = {}
    for b, file in enumerate(RECORDINGS):
        table: dict[str, Array] = {"time": np.round(stamps[b], 9)}
        for j, name in enumerate(NAMES):
            table[f"q.{name}"] = noise["q"].measure(measured[f"q.{name}"][b], drawn["q"][b, :, j])
        for j, name in enumerate(NAMES):
            table[f"v.{name}"] = measured[f"v.{name}"][b] + drawn["v"][b, :, j]
        for j, name in enumerate(NAMES):
            table[f"u.{name}"] = motion.u[b, :, j]
        for j, axis in enumerate(WRENCH):
            kind = "force" if j < 3 else "torque"
            table[f"wrench.wrist.{axis}"] = measured[f"wrench.wrist.{axis}"][b] + drawn[kind][b, :, j % 3]
        tables[file] = pd.DataFrame(table)
    return tables


def press_scenario(
    settings: Settings, law: ContactLaw, entries: list[dict[str, object]], noise: dict[str, ChannelNoise]
) -> dict[str, object]:
    declared = settings.noise == "coloured_declared"

    def channel(name: str) -> dict[str, object]:
        told: dict[str, object] = {"std": noise[name].declared_std} if settings.states_std else {}
        if declared and noise[name].correlation_time:
            told["correlation_time"] = noise[name].correlation_time
        return told

    wrench: dict[str, object] = {"body": "tool", "frame": "tool"}
    if settings.states_std:
        wrench["std"] = {"force": noise["force"].declared_std, "torque": noise["torque"].declared_std}
    if declared and noise["force"].correlation_time:
        wrench["correlation_time"] = noise["force"].correlation_time
    contact = {
        "bodies": ["tool", "wall"],
        "stiffness": law.stiffness,
        "damping": law.damping,
        "friction": law.friction,
        "slip_velocity": law.slip_velocity,
    }
    return {
        "model": "press.urdf",
        "gravity": [0, 0, -9.81],
        "weld": [{"body": "base"}],
        "channels": {
            "q": channel("q"),
            "v": channel("v"),
            "u": {"std": 0.0, "hold": "zero_order"},
            "wrench.wrist": wrench,
        },
        "unknown": entries,
        "contact": [contact],
    }
