"""Whether the path of a thrown body's origin depends on how the body is turned."""

import numpy as np

from drake_cafim.diagnosis.tosses.free_body import FreeBody
from drake_cafim.scenario.physics import Physics

OFF_CENTRE = 1e-3
"""Largest distance from the body's origin that counts as none, as a share of the ball's radius (of √(tr I/m))."""
UNEVEN = 1e-2
"""Largest difference of moments of inertia about a ball's axes that counts as none, as a share of the largest."""


def why_turns_matter(physics: Physics) -> str:
    """Why the body's rotation is needed, as a clause; empty where the path of its origin follows from itself.

    It does in flight where the centre of mass is at the origin, and in contact where besides the body is a ball about
    it with one moment of inertia about all axes: its spin acts by friction, its orientation does not.
    """
    mass, center, inertia, _ = FreeBody(physics).inertial
    contact = physics.contacts[0] if physics.contacts else None
    ball = contact is not None and len(contact.points) == 1 and contact.radius > 0.0
    if contact is not None and not ball:
        return f"the collision shape of {contact.bodies[0]} is not a sphere"
    size = contact.radius if contact is not None else float(np.sqrt(np.trace(inertia) / max(mass, 1e-300)))
    off = float(np.linalg.norm(center))
    if off > OFF_CENTRE * size:
        return f"the centre of mass can be {1e3 * off:.3g} mm from the tracked origin of the body"
    if contact is None:
        return ""
    apart = float(np.linalg.norm(contact.points[0]))
    if apart > OFF_CENTRE * size:
        return f"the sphere's centre is {1e3 * apart:.3g} mm from the tracked origin of the body"
    moments = np.linalg.eigvalsh(inertia)
    if moments[2] - moments[0] > UNEVEN * moments[2]:
        return f"the moments of inertia differ by axis ({moments[0]:.3g} to {moments[2]:.3g} kg m²)"
    return ""
