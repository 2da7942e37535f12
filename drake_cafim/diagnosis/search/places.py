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
