"""Groups of explanations that are hard to tell apart, each with the machine on which they are.

Each explanation has the size at which, were it true, ten seconds of a random motion would be expected to leave every
other a likelihood of one in twenty at its best: rivals, as a recording that shows too little leaves them. Presliding,
which has no such size, is a typical one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drake_cafim.design.planner import PlannerConfig, candidate_commands
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.problem import WeakProblem
from drake_cafim.discrimination.design import Designer
from drake_cafim.discrimination.evidence import expected, linearise, strength_at
from drake_cafim.discrimination.hypotheses import Pair, parsed
from drake_cafim.discrimination.motions import Motion, Shape
from drake_cafim.discrimination.scores import TWENTY_TO_ONE
from drake_cafim.effects.effect import Effect
from drake_cafim.scene.scene import Scene

RANDOM_MOTIONS = 5
KNOWN = 10.0
"""s of robot time."""
SMALLEST, LARGEST, HALVINGS = 1e-3, 10.0, 10
"""Times the typical size, between which the size is searched for."""


def _joint(name: str, parent: str, child: str, axis: str, origin: str, limit: str, rotor: float) -> str:
    return (
        f'<joint name="{name}" type="{"prismatic" if name.startswith("p") else "revolute"}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{origin}"/><axis xyz="{axis}"/><limit {limit}/>'
        '<dynamics damping="0.4"/></joint>'
        f'<transmission name="t_{name}"><type>transmission_interface/SimpleTransmission</type><joint name="{name}">'
        "<hardwareInterface>EffortJointInterface</hardwareInterface></joint>"
        f'<actuator name="a_{name}"><drake:rotor_inertia value="{rotor}"/><drake:gear_ratio value="1"/></actuator>'
        "</transmission>"
    )


def _link(name: str, mass: float, com: str, inertia: tuple[float, float, float], more: str = "") -> str:
    ixx, iyy, izz = inertia
    return (
        f'<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>'
        f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial>{more}</link>'
    )


HEAD = '<robot name="{name}" xmlns:drake="http://drake.mit.edu"><link name="base"/>'
ARM = (
    HEAD.format(name="arm3")
    + _link("turret", 3.0, "0 0 0.05", (0.02, 0.02, 0.02))
    + _link("upper", 2.2, "0.15 0 0", (0.003, 0.02, 0.02))
    + _link("fore", 1.3, "0.12 0 0", (0.001, 0.008, 0.008))
    + _joint("yaw", "base", "turret", "0 0 1", "0 0 0.3", 'lower="-2.6" upper="2.6" effort="30" velocity="2"', 0.08)
    + _joint(
        "shoulder", "turret", "upper", "0 1 0", "0 0 0.1", 'lower="-1.8" upper="1.8" effort="40" velocity="2"', 0.08
    )
    + _joint("elbow", "upper", "fore", "0 1 0", "0.3 0 0", 'lower="-2.2" upper="2.2" effort="15" velocity="3"', 0.04)
    + "</robot>"
)
ARM_SCENARIO = """model: model.urdf
weld: [{body: base}]
channels: {q: {std: 2.0e-4}, v: {std: 5.0e-3}, u: {std: 0.1}}
unknown:
  - {parameter: mass, body: upper, std: 0.2}
  - {parameter: mass, body: fore, std: 0.1}
  - {parameter: com_x, body: upper, std: 0.02}
  - {parameter: com_x, body: fore, std: 0.02}
  - {parameter: damping, joint: yaw, std: 0.1}
  - {parameter: damping, joint: shoulder, std: 0.1}
  - {parameter: damping, joint: elbow, std: 0.1}
  - {parameter: rotor_inertia, joint: yaw, std: 0.02}
  - {parameter: rotor_inertia, joint: shoulder, std: 0.02}
  - {parameter: rotor_inertia, joint: elbow, std: 0.01}
"""
# Rows are whitened as the nominal model lets noise through. A lag smooths what noise there is on the effort, and would
# be favoured for it: where explanations differ in that, the effort is the command itself.
COMMANDED_SCENARIO = ARM_SCENARIO.replace("u: {std: 0.1}", "u: {std: 0.0}")
_WALL = '<collision name="wall"><origin xyz="0 0 -0.05"/><geometry><box size="2 2 0.1"/></geometry></collision>'
_TIP = '<collision name="tip"><origin xyz="0 0 -0.1"/><geometry><sphere radius="0.01"/></geometry></collision>'
# at zero the tip stands half a millimetre above the wall
STAGE = (
    HEAD.format(name="stage")
    + _link("carriage_x", 2.0, "0 0 0", (0.01, 0.01, 0.01))
    + _link("carriage_y", 1.5, "0 0 0", (0.01, 0.01, 0.01))
    + _link("tool", 1.0, "0 0 -0.03", (0.006, 0.006, 0.006), _TIP)
    + _link("wall", 10.0, "0 0 0", (1.0, 1.0, 1.0), _WALL)
    + '<joint name="mount" type="fixed"><parent link="base"/><child link="wall"/></joint>'
    + _joint("px", "base", "carriage_x", "1 0 0", "0 0 0", 'lower="-0.03" upper="0.03" effort="60" velocity="0.2"', 0.0)
    + _joint(
        "py", "carriage_x", "carriage_y", "0 1 0", "0 0 0", 'lower="-0.03" upper="0.03" effort="60" velocity="0.2"', 0.0
    )
    + _joint(
        "pz",
        "carriage_y",
        "tool",
        "0 0 1",
        "0 0 0.1105",
        'lower="-0.003" upper="0.003" effort="60" velocity="0.05"',
        0.0,
    )
    + "</robot>"
)
STAGE_SCENARIO = """model: model.urdf
weld: [{body: base}]
channels:
  q: {std: 1.0e-5}
  v: {std: 5.0e-4}
  u: {std: 0.0}
  wrench.wrist: {body: tool, frame: tool, std: {force: 0.5, torque: 0.05}}
contact:
  - {bodies: [tool, wall], stiffness: 4500.0, damping: 50.0, friction: 0.4, slip_velocity: 0.002}
unknown:
  - {parameter: stiffness, contact: [tool, wall], std: 225.0}
  - {parameter: friction, contact: [tool, wall], std: 0.02}
"""


USUAL, QUICK, SLOW = Shape(), Shape(spacing=0.04), Shape(spacing=0.16)
"""As many numbers in half or twice the time. The quick one is for explanations that are milliseconds apart; an
elasticity that quick motions only just show would be stiffer than the steps of simulation can follow. The slow one is
for those that only differ in where the arm is, which it must have time to reach."""


@dataclass(frozen=True)
class Group:
    """Explanations, as EFFECT@PLACE, the machine, by its model and scenario, and the shape of all its motions."""

    name: str
    explanations: tuple[str, ...]
    model: str = field(default=ARM, repr=False)
    scenario: str = field(default=ARM_SCENARIO, repr=False)
    shape: Shape = USUAL

    @property
    def slug(self) -> str:
        """Of files."""
        return self.name.replace(", ", "-").replace(" ", "_")

    def scene(self, folder: Path) -> Scene:
        """The machine, its files written to `folder`."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "model.urdf").write_text(self.model)
        (folder / "scenario.yaml").write_text(self.scenario)
        return Scene.load(folder / "scenario.yaml")


GROUPS = (
    Group("bias, spring", ("actuator_bias@elbow", "joint_spring@elbow")),
    # a measured effort has been through the dead zone: only a commanded one can lack it
    Group("dead zone, gain", ("actuator_dead_zone@elbow", "actuator_gain_error@elbow"), ARM, COMMANDED_SCENARIO),
    Group("lag, delay", ("actuator_lag@elbow", "actuator_delay@elbow"), ARM, COMMANDED_SCENARIO, QUICK),
    Group("delay, elasticity", ("actuator_delay@elbow", "joint_elasticity@elbow"), ARM, COMMANDED_SCENARIO),
    Group(
        "gain, payload, load friction",
        ("actuator_gain_error@elbow", "payload@fore", "joint_load_dependent_friction@elbow"),
    ),
    Group("tilt, spring, payload", ("gravity_misalignment@world", "joint_spring@shoulder", "payload@fore"), shape=SLOW),
    Group("stiffness, offset", ("contact_nonlinear_stiffness@tool/wall", "surface_offset@wall"), STAGE, STAGE_SCENARIO),
    Group(
        "Stribeck, presliding",
        ("contact_stribeck_friction@tool/wall", "contact_presliding@tool/wall"),
        STAGE,
        STAGE_SCENARIO,
    ),
)


def random_motion(designer: Designer, random: np.random.Generator) -> Motion:
    """A cycle of the package's random policy: velocities through four random knots, as far as the range allows."""
    limits, shape = designer.limits, designer.shape
    knots = random.uniform(-limits.speed, limits.speed, size=(PlannerConfig().knots, len(limits.speed)))
    velocity = candidate_commands(knots[None], shape.points, (-limits.speed, limits.speed))[0]
    position = limits.home + np.cumsum(velocity, axis=0) * shape.spacing
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    return designer.motion(np.clip((position - middle) / half, -1.0, 1.0))


def models(group: Group, designer: Designer, random: np.random.Generator) -> tuple[Model, ...]:
    """The group's explanations with their numbers."""
    motions = [random_motion(designer, random) for _ in range(RANDOM_MOTIONS)]
    problems = [designer.problem(item) for item in motions]
    effects = [parsed(designer.scene, word) for word in group.explanations]
    unknown = designer.scene.priors.mean
    found = []
    for k, effect in enumerate(effects):
        low, high = np.log(SMALLEST), np.log(LARGEST)
        for _ in range(HALVINGS):
            size = float(np.exp(0.5 * (low + high)))
            truth, *rivals = (
                Model(unknown, (sized(item, size, designer.scene),))
                for item in (effect, *effects[:k], *effects[k + 1 :])
            )
            if _worth(problems, truth, rivals) < TWENTY_TO_ONE:
                low = np.log(size)
            else:
                high = np.log(size)
        found.append(Model(unknown, (sized(effect, float(np.exp(high)), designer.scene),)))
    return tuple(found)


def _worth(problems: Sequence[WeakProblem], truth: Model, rivals: Sequence[Model]) -> float:
    """The median of what the motions are expected to bring for `truth`."""
    return float(np.median([min(_worth_of(problem, truth, rival) for rival in rivals) for problem in problems]))


def _worth_of(problem: WeakProblem, truth: Model, rival: Model) -> float:
    """ln of the likelihood ratio after `KNOWN` s of the motion again and again, the rival's numbers being its best."""
    time = problem.runs[0].weak.samples.time
    repeats = KNOWN / float(time[-1] - time[0]) - 1.0
    own, other = (
        course.after(course, repeats)
        for course in expected(problem, linearise(problem, truth), linearise(problem, rival))
    )
    return 0.5 * float(other.misfit[-1] - own.misfit[-1])


def sized(effect: Effect, size: float, scene: Scene) -> Effect:
    """The effect at `size` times the typical; what only says what it looks like is typical."""
    values = {s.name: strength_at(s, size if s.amplitude else 1.0) for s in effect.strengths}
    if effect.name == "contact_stribeck_friction":
        # absent where it equals the friction of the contact
        values["static"] += scene.physics.contacts[0].parameters.friction
    if effect.name == "contact_presliding":
        # the shorter, the nearer to dry friction, which the nominal law is not either: it never vanishes
        values["distance"] = effect.strengths[0].typical
    if effect.name == "actuator_gain_error":
        # too little acts, as with all that it is taken for
        values["gain"] = 2.0 - values["gain"]
    if effect.name == "payload":
        # a load of a usual place; its mass is its size
        values |= {s.name: s.typical for s in effect.strengths[1:]}
    if effect.name == "joint_load_dependent_friction":
        values["torque"] = 0.0
    if effect.name == "joint_spring":
        values["rest"] = effect.strengths[1].typical
    return effect.with_values(values)


def pairs(found: Sequence[Model]) -> tuple[Pair, ...]:
    """Every two of the explanations."""
    return tuple(Pair(a, b) for i, a in enumerate(found) for b in found[i + 1 :])
