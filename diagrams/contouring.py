"""Contouring: an arm touches a box on a table, whose size is unknown (paper, "Shape Estimation")."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydrake.geometry import Box, Meshcat
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import Diagram

from drake_cafim.contact.normal import NormalLaw
from drake_cafim.diagrams.arrays import as_array
from drake_cafim.diagrams.concealing import Concealed
from drake_cafim.diagrams.configured import load_section
from drake_cafim.diagrams.objects import Surface, add_fixture, add_shape, contact_with
from drake_cafim.diagrams.probing import Coordinates, ProbingArm, build_probing_world, tip_at_start, tracked_arm
from drake_cafim.diagrams.showing import View
from drake_cafim.diagrams.tracked_contact import TrackedRobot
from drake_cafim.diagrams.tracking import TrackingConfig
from drake_cafim.diagrams.workspace import Workspace
from drake_cafim.diagrams.world import WorldKind, check_kind, check_truth
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.report.replay_data import Camera
from drake_cafim.tasks.contouring import TRUE_LENGTH, TRUE_WIDTH, Contouring
from drake_cafim.tasks.laws import QuasiStatic
from drake_cafim.tasks.task import Candidate, Task

BOX_HEIGHT = 0.10  # m, above the tip's height of 0.08 m
TRUTH = {"length": TRUE_LENGTH, "width": TRUE_WIDTH}  # m, unless given
TABLE_SIZE = (0.7, 0.6, 0.04)  # m
DISSIPATION = 0.5  # s/m, believed, of a law that has one


@dataclass
class ContouringConfig:
    """Constants of the scenario. The planner's x and y are those of W; the tip moves 0.08 m above the table."""

    plant_config: MultibodyPlantConfig = field(
        default_factory=lambda: MultibodyPlantConfig(
            time_step=0.001, contact_model="hydroelastic_with_fallback", discrete_contact_approximation="lagged"
        )
    )
    # the rod upright, the arm reaches to x = 0.7 m, not to the paper's 0.8 m
    robot: ProbingArm = field(
        default_factory=lambda: ProbingArm(
            posture=[-0.26253, 0.30151, 0.06094, -2.36397, -0.0396, 2.66463, -0.1691],
            rod=0.12,
            tip_radius=0.01,
            tip=Surface(point_stiffness=1e9, friction=0.0, resolution=0.004),
            tracking=TrackingConfig(ramp=0.02, acceleration=20.0),
            workspace=Workspace(lower=[0.3, -0.15], upper=[0.7, 0.15]),
        )
    )
    # soft: the pressure grows over half the width; at half the force limit the force is the planner's 500 N/m times d
    box: Surface = field(
        default_factory=lambda: Surface(
            modulus=5.0e4, point_stiffness=500.0, dissipation=0.5, friction=0.0, resolution=0.02
        )
    )


def load_config(path: Path | None = None) -> ContouringConfig:
    """The configuration in the section `diagram:` of `contouring.yaml`, or of the scenario file at `path`."""
    return load_section(Path(__file__).with_name("contouring.yaml") if path is None else path, ContouringConfig())


def other_laws(config: ContouringConfig, task: Task) -> tuple[Candidate, ...]:
    """The contact laws that the box may have beside the task's own; length and width have the same priors under each.

    Beside them, as nuisance: Hunt and Crossley's dissipation; and the modulus of `hydroelastic`, whose prior is the
    task's stiffness at rest under half its force limit. (Without damping the paper's law is Kelvin and Voigt's.)
    """
    model = task.model
    assert isinstance(model, Contouring)
    rest = QuasiStatic(0.5 * model.force_limit, model.tip_radius, 0.5 * min(TRUE_WIDTH, BOX_HEIGHT))
    stiffness = Parameter("stiffness", model.stiffness, 0.15 * model.stiffness, lower=1.0, nuisance=True)
    damping = rest.force * DISSIPATION
    loss = Parameter("damping", damping, damping, lower=0.0, upper=20.0 * damping, nuisance=True)
    found = []
    laws: tuple[NormalLaw, ...] = ("kelvin_voigt", "hunt_crossley", "hydroelastic")
    for law in laws:
        if law == model.law:
            continue
        own = {"kelvin_voigt": (), "hunt_crossley": (1,), "hydroelastic": (0, 1)}[law]
        priors = rest.priors(law, stiffness, loss)
        parameters = Parameters.of([*model.parameters, *(priors[index] for index in own)])
        changed = replace(
            model,
            law=law,
            parameters=parameters,
            resolution=config.robot.tip.resolution if law == "hydroelastic" else 0.0,
            height=BOX_HEIGHT,
        )
        found.append(Candidate(law, changed, task.truth))
    return tuple(found)


def build_world(
    config: ContouringConfig,
    truth: Mapping[str, float] | None = None,
    world: WorldKind = "drake",
    seed: int = 0,
    meshcat: Meshcat | None = None,
    concealed: Sequence[Concealed] = (),
) -> Diagram:
    """The Diagram of arm, rod, table and box, as `build_probing_world`; `truth` may give `length` and `width`.

    Forces (2,) N on the tip along x and y.
    """
    check_kind(world)
    model = Contouring(tip_radius=config.robot.tip_radius)
    theta = check_truth("contouring", TRUTH, truth or {})

    def add_box(plant: MultibodyPlant, touches: bool) -> None:
        table = add_fixture(plant, "table", RigidTransform(as_array([*model.centre, -0.5 * TABLE_SIZE[2]])))
        add_shape(plant, table, Box(*TABLE_SIZE), RigidTransform(), None, color=(0.62, 0.50, 0.38, 1.0))
        box = add_fixture(plant, "box", RigidTransform(as_array([*model.centre, 0.5 * BOX_HEIGHT])))
        size = Box(theta["length"], theta["width"], BOX_HEIGHT)
        surface = config.box if touches else None
        add_shape(plant, box, size, RigidTransform(), surface, color=(0.25, 0.50, 0.75, 0.7))

    return build_probing_world(
        "contouring",
        config.robot,
        plant_config=config.plant_config,
        coordinates=_coordinates(),
        add_obstacle=add_box,
        model=model,
        theta=model.parameters.vector(theta),
        world=world,
        seed=seed,
        meshcat=meshcat,
        concealed=concealed,
    )


def true_contact(config: ContouringConfig, truth: Mapping[str, float], contact: SphereContact) -> SphereContact:
    """The contact of tip and box by the law and with the numbers of world `drake`."""
    for name, extent in {**check_truth("contouring", TRUTH, truth), "height": BOX_HEIGHT}.items():
        contact = contact.with_parameter(name, extent)
    return contact_with(config.box, contact, config.plant_config.contact_model, config.box.friction)


def tracked_robot(config: ContouringConfig) -> TrackedRobot:
    """The arm and rod with their control, for sensitivities through them."""
    return tracked_arm(config.robot, _coordinates(), config.plant_config.time_step)


def _coordinates() -> Coordinates:
    axes = as_array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return Coordinates(axes=axes, origin=as_array([0.0, 0.0, 0.0]), directions=axes)


def view(config: ContouringConfig) -> View:
    """The view of the replay: from above and in front of the box, the arm behind it."""
    coordinates = _coordinates()
    return View(
        axes=coordinates.axes,
        origin=as_array([0.0, 0.0, tip_at_start(config.robot)[2]]),
        force_directions=coordinates.directions,
        force_offset=as_array([0.0, 0.0, 0.0]),
        force_scale=0.015,
        spread=as_array([0.0, 0.0, 0.0]),
        camera=Camera(eye=(1.35, -0.35, 0.95), target=(0.36, -0.08, 0.16)),
        panel=(0.12, -0.72, 0.36),
        panel_width=0.42,
        stroke=0.6,
    )
