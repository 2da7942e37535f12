"""Effects that a recording conceals: kind and place drawn at random, each with a strength that is set afterwards."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array
from tests.descriptions.mujoco_robot import SUBSTEP


@dataclass(frozen=True)
class Hidden:
    """What a recording has beyond its model.

    `change` alters MuJoCo's specification before it is compiled, `turn` the compiled model; `gain`, `bias` (n,) and
    `late` (steps of MuJoCo) are between the commanded and the acting efforts; the others are the sensors'.
    """

    change: Callable[[Any], None] = lambda spec: None
    turn: Callable[[Any], None] = lambda model: None
    gain: Array | float = 1.0
    bias: Array | float = 0.0
    late: int = 0
    bias_q: Array | float = 0.0
    gain_v: Array | float = 1.0
    late_v: int = 0
    joint: int = 0

    def acting(self, u: Array, step: int, parts: int) -> Array:
        """The efforts (n,) that act in a step of MuJoCo's, of the commands u (N, n), each held for `parts` steps."""
        now = u[step // parts].copy()
        now[self.joint] = u[max(0, step - self.late) // parts, self.joint]
        return np.asarray(self.gain * now + self.bias)

    def read(self, q: Array, v: Array, parts: int) -> tuple[Array, Array]:
        """What noise-free sensors show at the samples, (N, n) each, of every step's q and v (N parts, n)."""
        shown = v[::parts].copy()
        rows = np.maximum(np.arange(0, len(v), parts) - self.late_v, 0)
        shown[:, self.joint] = v[rows, self.joint]
        return q[::parts] + self.bias_q, self.gain_v * shown


@dataclass(frozen=True)
class Kind:
    """An effect at a place. Its first parameter is `neutral` + `size` · `unit`, where `unit` is a small but usual size.

    `equal` are exact other names of it.
    """

    effect: str
    at: str
    unit: float
    made: Callable[[float], tuple[Hidden, Mapping[str, float]]] = field(compare=False)
    neutral: float = 0.0
    equal: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Usual:
    """Of a recorded null: efforts, speeds and ranges (n,), rms, and the inertias (n,) about the joints."""

    effort: Array
    speed: Array
    travel: Array
    inertia: Array


def draw(rng: np.random.Generator, scene: Scene, usual: Usual) -> Kind:
    """A random effect at a random joint, or at the body that the joint moves."""
    kinds = (_viscous, _coulomb, _spring, _rotor, _gain, _bias, _delay, _payload, _gravity, _bias_q, _gain_v, _late_v)
    joint = int(rng.integers(len(scene.tree.joints)))
    return kinds[int(rng.integers(len(kinds)))](rng, scene, usual, joint)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _only(scene: Scene, joint: int, value: float, otherwise: float = 0.0) -> Array:
    found = np.full(len(scene.tree.joints), otherwise)
    found[joint] = value
    return found


def _degree(model: Any, name: str, joint: int) -> tuple[int, int]:
    """The joint's index in the model and that of its velocity; one without a name is known by its place."""
    known = [model.joint(k).name for k in range(model.njnt)]
    index = known.index(name) if name in known else joint
    return index, int(model.jnt_dofadr[index])


def _of_model(field_name: str, name: str, joint: int, value: float) -> Hidden:
    """A number of the joint's degree of freedom, larger by `value`."""

    def turn(model: Any) -> None:
        getattr(model, field_name)[_degree(model, name, joint)[1]] += value

    return Hidden(turn=turn)


def _viscous(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    name = scene.tree.joint_names[j]
    return Kind(
        "joint_viscous_friction",
        name,
        0.05 * usual.effort[j] / usual.speed[j],
        lambda c: (_of_model("dof_damping", name, j, c), {"coefficient": c}),
    )


def _coulomb(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    name = scene.tree.joint_names[j]
    return Kind(
        "joint_coulomb_friction",
        name,
        0.05 * usual.effort[j],
        lambda torque: (_of_model("dof_frictionloss", name, j, torque), {"torque": torque}),
    )


def _rotor(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    name = scene.tree.joint_names[j]
    return Kind(
        "rotor_inertia",
        name,
        0.05 * usual.inertia[j],
        lambda inertia: (_of_model("dof_armature", name, j, inertia), {"inertia": inertia}),
    )


def _spring(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    name, rest = scene.tree.joint_names[j], float(rng.uniform(-0.5, 0.5))

    def made(stiffness: float) -> tuple[Hidden, Mapping[str, float]]:
        def turn(model: Any) -> None:
            index, _ = _degree(model, name, j)
            place, known = model.jnt_qposadr[index], model.jnt_stiffness[index]
            together = known + stiffness  # two springs are one, whose rest lies between theirs
            model.qpos_spring[place] = (known * model.qpos_spring[place] + stiffness * rest) / together
            model.jnt_stiffness[index] = together

        return Hidden(turn=turn), {"stiffness": stiffness, "rest": rest}

    return Kind("joint_spring", name, 0.1 * usual.effort[j] / usual.travel[j], made)


def _gain(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    def made(gain: float) -> tuple[Hidden, Mapping[str, float]]:
        return Hidden(gain=_only(scene, j, gain, 1.0)), {"gain": gain}

    return Kind("actuator_gain_error", scene.tree.joint_names[j], 0.03 * _sign(rng), made, neutral=1.0)


def _bias(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    def made(torque: float) -> tuple[Hidden, Mapping[str, float]]:
        return Hidden(bias=_only(scene, j, torque)), {"torque": torque}

    return Kind("actuator_bias", scene.tree.joint_names[j], 0.05 * usual.effort[j] * _sign(rng), made)


def _delay(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    def made(seconds: float) -> tuple[Hidden, Mapping[str, float]]:
        steps = max(1, round(seconds / SUBSTEP))
        return Hidden(late=steps, joint=j), {"delay": steps * SUBSTEP}

    return Kind("actuator_delay", scene.tree.joint_names[j], 0.002, made)


def _payload(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    riding = [body for body in scene.tree.bodies if body.joint == j]
    moved = scene.plant.GetJointByName(scene.tree.joint_names[j]).child_body().name()
    body = scene.tree.body(moved)
    place = body.p_BBcm + rng.uniform(-0.08, 0.08, 3)

    def made(mass: float) -> tuple[Hidden, Mapping[str, float]]:
        def change(spec: Any) -> None:
            load = spec.body(body.name).add_body(name="unknown load", pos=place)
            load.mass, load.ipos, load.inertia, load.explicitinertial = mass, [0.0] * 3, [1e-9] * 3, True

        return Hidden(change=change), {"mass": mass} | dict(zip("xyz", map(float, place), strict=True))

    return Kind("payload", body.name, 0.1 * body.mass, made, equal=tuple(("payload", item.name) for item in riding))


def _gravity(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    share = float(rng.uniform(0.3, 1.0) * _sign(rng))

    def made(roll: float) -> tuple[Hidden, Mapping[str, float]]:
        pitch = share * roll
        turned_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
        turned_y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
        gravity = turned_x @ turned_y @ np.array(scene.scenario.gravity)

        def turn(model: Any) -> None:
            model.opt.gravity = gravity

        return Hidden(turn=turn), {"roll": roll, "pitch": pitch}

    return Kind("gravity_misalignment", "world", 0.01 * _sign(rng), made)


def _bias_q(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    def made(bias: float) -> tuple[Hidden, Mapping[str, float]]:
        return Hidden(bias_q=_only(scene, j, bias)), {"bias": bias}

    size = 0.002 if scene.tree.joints[j].prismatic else 0.01
    # turning the first joint's zero turns gravity: at a joint across gravity the two are one
    roots = [k for k, joint in enumerate(scene.tree.joints) if joint.parent < 0]
    equal = (("gravity_misalignment", "world"),) if roots == [j] else ()
    return Kind("sensor_bias", f"q.{scene.tree.joint_names[j]}", size * _sign(rng), made, equal=equal)


def _gain_v(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    def made(gain: float) -> tuple[Hidden, Mapping[str, float]]:
        return Hidden(gain_v=_only(scene, j, gain, 1.0)), {"gain": gain}

    return Kind("sensor_gain_error", f"v.{scene.tree.joint_names[j]}", 0.02 * _sign(rng), made, neutral=1.0)


def _late_v(rng: np.random.Generator, scene: Scene, usual: Usual, j: int) -> Kind:
    def made(seconds: float) -> tuple[Hidden, Mapping[str, float]]:
        steps = max(1, round(seconds / SUBSTEP))
        return Hidden(late_v=steps, joint=j), {"delay": steps * SUBSTEP}

    return Kind("sensor_delay", f"v.{scene.tree.joint_names[j]}", 0.002, made)
