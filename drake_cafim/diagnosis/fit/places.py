"""The places of effects: what acts at one joint does not show in the equations of another."""

from drake_cafim.effects.effect import Effect, Place

ELSEWHERE = ""
"""The place of what moves the rows of many joints: loads on bodies, contacts, gravity."""


def place_of(effect: Effect) -> str:
    """The joint at which an effect acts, or the channel that it changes; `ELSEWHERE` where it is neither."""
    return effect.at if effect.place in (Place.JOINT, Place.ACTUATOR, Place.CHANNEL) else ELSEWHERE


def joint_of(effect: Effect) -> str:
    """The joint at which an effect acts or whose channel it changes; the channel's sensor, or `ELSEWHERE`."""
    return effect.at.partition(".")[2] if effect.place is Place.CHANNEL else place_of(effect)


def equations_of(effect: Effect) -> str:
    """Whose equations an effect changes: a place, but of the positions and velocities of a joint the readings together.

    An error of either shows in the equations between the two, so that each stands in for the other.
    """
    kind, _, joint = effect.at.partition(".")
    return f"readings.{joint}" if effect.place is Place.CHANNEL and kind in ("q", "v") else place_of(effect)
