"""The packaged worlds by name, each with the planner's task in it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from pydrake.geometry import Meshcat
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram

from drake_cafim.diagrams import contouring, hefting, pinching, rubbing
from drake_cafim.diagrams.concealing import Concealed, scenario_effects
from drake_cafim.diagrams.configured import configured
from drake_cafim.diagrams.showing import View
from drake_cafim.diagrams.tracked_contact import TrackedEvaluator, TrackedRobot
from drake_cafim.diagrams.world import WorldKind, start_context
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.errors import InputError
from drake_cafim.experiment.world import World
from drake_cafim.scenario.schema import Scenario
from drake_cafim.scene.scene import Scene
from drake_cafim.sensitivity.automatic import AutoDiffEvaluator
from drake_cafim.sensitivity.evaluator import Evaluator
from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.configure import configure
from drake_cafim.tasks.contouring import contouring as contouring_task
from drake_cafim.tasks.hefting import hefting as hefting_task
from drake_cafim.tasks.pinching import pinching as pinching_task
from drake_cafim.tasks.rubbing import rubbing as rubbing_task
from drake_cafim.tasks.task import Candidate, Task

RECORDED = (
    "joint_state", "joint_effort", "contact_wrench", "tracked_pose", "plant_state", "measured_state", "true_force"
)  # fmt: skip
"""The outputs of a world that are recorded at every step of its plant."""


@dataclass(frozen=True)
class _Packaged:
    """`touching` and `tracked` are bodies of the scenario's model, see `World`."""

    config: Callable[[], Any]
    build: Callable[..., Diagram]
    view: Callable[[Any], View]
    task: Callable[[], Task]
    touching: str
    tracked: str
    other_laws: Callable[[Any, Task], tuple[Candidate, ...]] = lambda config, task: ()
    tracked_robot: Callable[[Any], TrackedRobot] | None = None
    true_contact: Callable[[Any, Mapping[str, float], SphereContact], SphereContact] = lambda config, truth, given: (
        given
    )


def _soft_hefting() -> Task:
    """Hefting with a compliant palm, as in the worlds; plans with a rigid one throw the ball 1/8 of the time."""
    return hefting_task(CompliantHefting())


_WORLDS: Mapping[str, _Packaged] = {
    "hefting": _Packaged(hefting.HeftingConfig, hefting.build_world, hefting.view, _soft_hefting, "palm", "ball"),
    "rubbing": _Packaged(
        rubbing.RubbingConfig,
        rubbing.build_world,
        rubbing.view,
        rubbing_task,
        "tip",
        "tip",
        rubbing.other_laws,
        rubbing.tracked_robot,
        rubbing.true_contact,
    ),
    "pinching": _Packaged(
        pinching.PinchingConfig,
        pinching.build_world,
        pinching.view,
        pinching_task,
        "left_jaw",
        "left_jaw",
        pinching.other_laws,
        pinching.tracked_robot,
        pinching.true_contact,
    ),
    "contouring": _Packaged(
        contouring.ContouringConfig,
        contouring.build_world,
        contouring.view,
        contouring_task,
        "tip",
        "tip",
        contouring.other_laws,
        contouring.tracked_robot,
        contouring.true_contact,
    ),
}


_UNDECIDED = {"hefting": "what a ball weighs that lies in a hand depends on no contact law"}


_CONTACTLESS = {"hefting": "its ball is free in the hand, and contacts here are of the robot with something fixed"}


@dataclass(frozen=True)
class Stage:
    """A scenario that `cafim run` can carry out: its task, its world's configuration, and the view of its replay."""

    name: str
    task: Task
    config: Any
    view: View
    effects: tuple[Concealed, ...] = ()
    """Effects under `effects:` of the scenario, which are part of its world."""
    contacts: tuple[SphereContact, ...] = ()
    """Contacts under `contact:` of the scenario."""

    def with_laws(self, task: Task, law: str | None) -> Task:
        """This scenario's task with the candidate contact laws that `law` names: `all`, one of them, None for its own.

        Raises `InputError` for a law that the scenario does not have.
        """
        if law is None:
            return task
        several = replace(task, others=_WORLDS[self.name].other_laws(self.config, task))
        return several if law == "all" else several.with_law(law)

    def evaluator(self, model: PlanningModel) -> Evaluator:
        """Sensitivities of `model` by AutoDiffXd through this scenario's robot, its control and the contact.

        Hefting's, whose ball is free in the hand, go through the planner's own Diagram, without the robot.
        """
        make = _WORLDS[self.name].tracked_robot
        return AutoDiffEvaluator(model) if make is None else TrackedEvaluator(make(self.config), model)

    @property
    def undecided(self) -> str:
        """Why no other contact law is a candidate in this scenario."""
        return _UNDECIDED.get(self.name, "its unknowns are those of the law itself, or its sensor does not see the law")

    def diagram(
        self,
        kind: WorldKind,
        seed: int,
        *,
        concealed: Sequence[Concealed] = (),
        meshcat: Meshcat | None = None,
    ) -> Diagram:
        """A world of this kind, see `build_world` of the scenario's module.

        Raises `InputError` for an effect on a contact in world `model`, where contact is the planner's law, and in a
        scenario that names none.
        """
        touching = _WORLDS[self.name].true_contact
        contacts = tuple(touching(self.config, self.task.truth, contact) for contact in self.contacts)
        together = [replace(effect, contacts=contacts) for effect in (*self.effects, *concealed)]
        for effect in together:
            if effect.touches and kind != "drake":
                raise InputError(
                    f"{effect.address}: found --world {kind}, expected drake: effects on contacts need Drake's contact"
                )
            if effect.touches and not self.contacts:
                why = _CONTACTLESS.get(self.name, "its file has nothing under contact:")
                raise InputError(f"{effect.address}: {self.name} names no contact that it could act on: {why}")
        build = _WORLDS[self.name].build
        return build(self.config, self.task.truth, kind, seed=seed, concealed=together, meshcat=meshcat)

    def world(self, kind: WorldKind, seed: int, concealed: Sequence[Concealed] = ()) -> World:
        """The diagram as a world for `experiment.run`, with the joints recorded at every step of the plant."""
        diagram = self.diagram(kind, seed, concealed=concealed)
        return World(
            kind,
            diagram,
            lambda number: start_context(diagram, number),
            recorded=RECORDED,
            recording_period=float(self.config.plant_config.time_step),
            touching=_WORLDS[self.name].touching,
            tracked=_WORLDS[self.name].tracked,
            automatic=self.evaluator,
        )


def joint_names(diagram: Diagram) -> tuple[str, ...]:
    """The joints of the world's robot, in the order of `joint_state`."""
    plant = diagram.GetSubsystemByName("plant")
    assert isinstance(plant, MultibodyPlant)
    robot = plant.GetModelInstanceByName("arm7" if plant.HasModelInstanceNamed("arm7") else "gripper")
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(robot)]
    moving = [joint for joint in joints if joint.num_velocities() == 1]
    return tuple(joint.name() for joint in sorted(moving, key=lambda joint: int(joint.velocity_start())))


def stage_of(scenario: Scenario, source: str) -> Stage:
    """The stage that the sections `diagram:` and `task:` of `scenario` describe.

    Raises `InputError`, which names `source`, for an unknown world and for keys that its configuration does not have.
    """
    name = str(scenario.diagram.get("world", ""))
    if name not in _WORLDS:
        found = "no section diagram" if not scenario.diagram else f"diagram: world: {name}"
        raise InputError(
            f"{source}: found {found}, expected a world that can be run: diagram: {{world: {' | '.join(_WORLDS)}}}"
        )
    packaged = _WORLDS[name]
    config = configured(scenario.diagram, packaged.config(), source)
    task = packaged.task()
    values = dict(scenario.task)
    model = configure(task.model, values.pop("model", {}), f"{source}: task: model")
    # a scenario may give its planner another law than the packaged task has
    law = str(getattr(model, "law", task.law)) if task.law else task.law
    task = replace(configure(task, values, f"{source}: task"), model=model, law=law)
    contacts = Scene.load(source).nominal_contacts if scenario.contact else ()
    return Stage(name, task, config, packaged.view(config), scenario_effects(scenario.effects, source), contacts)
