"""Rubbing: an arm slides a round tip on a wall of unknown friction (paper, "Friction Estimation Experiments")."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

from pydrake.geometry import Box, Meshcat
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import Diagram

from drake_cafim.contact.normal import NORMAL_LAWS, NormalLaw
from drake_cafim.diagrams.arrays import as_array
from drake_cafim.diagrams.concealing import Concealed
from drake_cafim.diagrams.configured import load_section
from drake_cafim.diagrams.objects import Surface, add_fixture, add_shape, contact_with
from drake_cafim.diagrams.probing import Coordinates, ProbingArm, build_probing_world, tracked_arm
from drake_cafim.diagrams.showing import View
from drake_cafim.diagrams.tracked_contact import TrackedRobot
from drake_cafim.diagrams.tracking import TrackingConfig
from drake_cafim.diagrams.workspace import Workspace
from drake_cafim.diagrams.world import WorldKind, check_kind, check_truth
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.parameters import Parameter, Parameters
from drake_cafim.report.replay_data import Camera
from drake_cafim.tasks.laws import QuasiStatic
from drake_cafim.tasks.rubbing import Rubbing
from drake_cafim.tasks.task import Candidate, Task

WALL_AT = 0.8  # m, along y of W (paper)
SLIP_VELOCITY = 0.005  # m/s, width of friction to the planner, smooth enough for its derivatives
WALL_SIZE = (0.9, 0.05, 1.3)  # m


@dataclass
class RubbingConfig:
    """Constants of the scenario. The planner's x is the distance from the wall, its y the height above the floor."""

    plant_config: MultibodyPlantConfig = field(
        default_factory=lambda: MultibodyPlantConfig(
            time_step=0.001, contact_model="hydroelastic_with_fallback", discrete_contact_approximation="lagged"
        )
    )
    # the arm does not reach behind itself: x ends at 0.55 m, not at the paper's 1 m
    robot: ProbingArm = field(
        default_factory=lambda: ProbingArm(
            # from here to the wall the joints' speeds and efforts allow most of what is commanded; the rod points at
            # the wall, 12 degrees down
            posture=[-2.0523, -1.2284, 1.522, -2.0797, 2.0121, 0.4472, 0.9845],
            floor_height=-0.51275,
            rod=0.26,
            tip_radius=0.04,
            # soft: at d = 3 cm, as far as the workspace lets it press, the force at rest is 100 N/m times d
            tip=Surface(modulus=2300.0, dissipation=0.5, point_stiffness=1e9, friction=1.0, resolution=0.02),
            tracking=TrackingConfig(ramp=0.02, acceleration=14.0),
            # pressed in as far as its centre, a soft ball no longer pushes: the paper's 0 m is 0.01 m here; braking is
            # within the reference's acceleration
            workspace=Workspace(lower=[0.01, 0.5], upper=[0.55, 1.0], braking_at_lower=11.0, braking_at_upper=11.0),
        )
    )
    # with `truth: stiffness`, its point stiffness is that, and the tip's modulus in proportion
    wall: Surface = field(default_factory=lambda: Surface(point_stiffness=100.0, dissipation=0.5))
    damping: float = Rubbing.damping  # N s/m, of world `model`
    measures_normal: bool = True  # else the sensor measures the tangential force alone
    along: float = 0.45239  # m, x of W where the tip meets the wall


def load_config(path: Path | None = None) -> RubbingConfig:
    """The configuration in the section `diagram:` of `rubbing.yaml`, or of the scenario file at `path`."""
    return load_section(Path(__file__).with_name("rubbing.yaml") if path is None else path, RubbingConfig())


def other_laws(config: RubbingConfig, task: Task) -> tuple[Candidate, ...]:
    """The contact laws that tip and wall may have beside the task's own; the friction has the same prior under each.

    Beside it, as nuisance, the law's own two parameters, whose priors are the task's stiffness and damping at rest
    under the force at `deepest`. Drake's field comes with Drake's friction, without the paper's resistance. None for a
    task that seeks the stiffness, too, or does not measure the normal force.
    """
    model = task.model
    assert isinstance(model, Rubbing)
    if model.parameters.names != ("friction",) or not model.measures_normal:
        return ()
    depth = model.tip_radius - config.robot.workspace.lower[0]
    rest = QuasiStatic(model.stiffness * depth, model.tip_radius)
    stiffness = Parameter("stiffness", model.stiffness, 0.15 * model.stiffness, lower=1.0, nuisance=True)
    damping = Parameter("damping", model.damping, model.damping, lower=0.0, upper=20.0 * model.damping, nuisance=True)
    found = []
    for law in NORMAL_LAWS:
        if law == model.law:
            continue
        changed = replace(
            model,
            law=cast(NormalLaw, law),
            parameters=Parameters.of([*model.parameters, *rest.priors(law, stiffness, damping)]),
            resolution=config.robot.tip.resolution if law == "hydroelastic" else 0.0,
            slip_velocity=SLIP_VELOCITY if law == "hydroelastic" else 0.0,
        )
        found.append(Candidate(law, changed, task.truth))
    return tuple(found)


def build_world(
    config: RubbingConfig,
    truth: Mapping[str, float] | None = None,
    world: WorldKind = "drake",
    seed: int = 0,
    meshcat: Meshcat | None = None,
    concealed: Sequence[Concealed] = (),
) -> Diagram:
    """The Diagram of arm, rod and wall, as `build_probing_world`; `truth` may give `friction` and `stiffness` N/m.

    Forces (2,) N: normal, away from the wall, unless it is not measured, and tangential, upwards, on the tip.
    """
    check_kind(world)
    mu, stiffness = _truth(truth)
    model = Rubbing(
        tip_radius=config.robot.tip_radius,
        stiffness=stiffness,
        damping=config.damping,
        measures_normal=config.measures_normal,
    )
    tip, wall = _surfaces(config, mu, stiffness)

    def add_wall(plant: MultibodyPlant, touches: bool) -> None:
        # Drake combines the two coefficients as 2 μ₁μ₂/(μ₁ + μ₂): the tip's is set to the wall's
        surface = wall if touches else None
        pose = RigidTransform(
            as_array([config.along, WALL_AT + 0.5 * WALL_SIZE[1], config.robot.floor_height + 0.5 * WALL_SIZE[2]])
        )
        body = add_fixture(plant, "wall", pose)
        add_shape(plant, body, Box(*WALL_SIZE), RigidTransform(), surface, color=(0.55, 0.65, 0.72, 0.6))

    return build_probing_world(
        "rubbing",
        replace(config.robot, tip=tip),
        plant_config=config.plant_config,
        coordinates=_coordinates(config),
        add_obstacle=add_wall,
        model=model,
        theta=model.parameters.vector({"friction": mu}),
        world=world,
        seed=seed,
        meshcat=meshcat,
        concealed=concealed,
    )


def true_contact(config: RubbingConfig, truth: Mapping[str, float], contact: SphereContact) -> SphereContact:
    """The contact of tip and wall by the law and with the numbers of world `drake`."""
    mu, stiffness = _truth(truth)
    tip, wall = _surfaces(config, mu, stiffness)
    model = config.plant_config.contact_model
    return contact_with(wall if model == "point" else tip, contact, model, mu)


def _truth(truth: Mapping[str, float] | None) -> tuple[float, float]:
    """Friction and stiffness N/m, checked."""
    theta = check_truth("rubbing", {"friction": Rubbing.friction, "stiffness": Rubbing.stiffness}, truth or {})
    return theta["friction"], theta["stiffness"]


def _surfaces(config: RubbingConfig, friction: float, stiffness: float) -> tuple[Surface, Surface]:
    """Tip and wall with this `friction` and `stiffness` N/m."""
    harder = stiffness / Rubbing.stiffness
    tip = replace(config.robot.tip, friction=friction, modulus=harder * config.robot.tip.modulus)
    return tip, replace(config.wall, friction=friction, point_stiffness=harder * config.wall.point_stiffness)


def tracked_robot(config: RubbingConfig) -> TrackedRobot:
    """The arm and rod with their control, for sensitivities through them."""
    return tracked_arm(config.robot, _coordinates(config), config.plant_config.time_step)


def _coordinates(config: RubbingConfig) -> Coordinates:
    axes = as_array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    origin = as_array([config.along, WALL_AT, config.robot.floor_height])
    return Coordinates(axes=axes, origin=origin, directions=axes)


def view(config: RubbingConfig) -> View:
    """The view of the replay: along the wall, with the arm at the left and the wall at the right."""
    coordinates = _coordinates(config)
    return View(
        axes=coordinates.axes,
        origin=coordinates.origin,
        force_directions=coordinates.directions if config.measures_normal else coordinates.directions[1:],
        force_offset=as_array([0.06, 0.0, 0.0]),  # before the tip, not within
        force_scale=0.05,
        spread=as_array([0.0, 0.0, 0.0]),
        camera=Camera(eye=(1.75, 0.0, 0.62), target=(0.2, 0.12, 0.18)),
        panel=(-0.1, -0.85, 0.27),
    )
