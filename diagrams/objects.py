"""Adds balls, boxes and fixtures whose properties are the true parameters of an experiment to a plant."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    ProximityProperties,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody, SpatialInertia, UnitInertia

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.diagrams.arrays import as_array
from drake_cafim.dynamics.contact import SphereContact
from drake_cafim.effects.contact_law import SLIP_VELOCITY


@dataclass
class Surface:
    """Contact properties of a surface; with `modulus` 0 it is rigid."""

    modulus: float = 0.0  # Pa, hydroelastic; of a sphere on a flat rigid body, force = π·modulus·depth²
    point_stiffness: float = 0.0  # N/m, of compliant point contact; 0: Drake's default
    dissipation: float = 0.0  # s/m, Hunt and Crossley's
    friction: float = 0.6
    resolution: float = 0.007  # m, size of the mesh's elements


def proximity(surface: Surface) -> ProximityProperties:
    """Drake's proximity properties of `surface`, for hydroelastic and for point contact."""
    properties = ProximityProperties()
    if surface.modulus > 0:
        AddCompliantHydroelasticProperties(surface.resolution, surface.modulus, properties)
    else:
        AddRigidHydroelasticProperties(surface.resolution, properties)
    AddContactMaterial(
        surface.dissipation,
        surface.point_stiffness if surface.point_stiffness > 0 else None,
        CoulombFriction(surface.friction, surface.friction),
        properties,
    )
    return properties


def contact_with(surface: Surface, contact: SphereContact, contact_model: str, friction: float) -> SphereContact:
    """The `contact` by the law that Drake's has where `surface` is the compliant one of the two, the other rigid.

    `contact_model` is that of Drake's plant; `friction` the coefficient of the pair.
    """
    given = contact.parameters
    rubbed = {"friction": friction, "slip_velocity": SLIP_VELOCITY, "dissipation": surface.dissipation}
    if contact_model == "point":
        own = ContactParameters(stiffness=surface.point_stiffness, **rubbed)
        return replace(contact, law=ContactLaw("hunt_crossley"), parameters=own)
    own = ContactParameters(
        modulus=surface.modulus,
        radius=given.radius,
        half_extent=given.half_extent,
        resolution=given.resolution,
        **rubbed,
    )
    return replace(contact, law=ContactLaw("hydroelastic"), parameters=own)


def add_ball(plant: MultibodyPlant, *, mass: float, radius: float, surface: Surface | None) -> RigidBody:
    """A thin spherical shell named `ball`, of `mass` kg and `radius` m; without `surface` it has no contact."""
    instance = plant.AddModelInstance("ball")
    inertia = SpatialInertia(mass, as_array(np.zeros(3)), UnitInertia.HollowSphere(radius))
    ball = plant.AddRigidBody("ball", instance, inertia)
    add_shape(plant, ball, Sphere(radius), RigidTransform(), surface, color=(0.80, 0.93, 0.24, 1.0))
    return ball


def add_shape(
    plant: MultibodyPlant,
    body: RigidBody,
    shape: Shape,
    X_BG: RigidTransform,
    surface: Surface | None,
    *,
    color: tuple[float, float, float, float],
) -> None:
    """Registers `shape` on `body` as visual geometry in `color` and, with a `surface`, as collision geometry."""
    name = body.name()
    if surface is not None:
        plant.RegisterCollisionGeometry(body, X_BG, shape, name, proximity(surface))
    plant.RegisterVisualGeometry(body, X_BG, shape, f"{name}_visual", as_array(color))


def add_fixture(plant: MultibodyPlant, name: str, X_WB: RigidTransform) -> RigidBody:
    """A body `name` without geometry, welded to the world."""
    instance: ModelInstanceIndex = plant.AddModelInstance(name)
    body = plant.AddRigidBody(name, instance, SpatialInertia(1.0, as_array(np.zeros(3)), UnitInertia.SolidCube(0.1)))
    plant.WeldFrames(plant.world_frame(), body.body_frame(), X_WB)
    return body
