"""The vocabulary in words and formulas, for readers who have not met it."""

from dataclasses import dataclass
from html import escape

from drake_cafim.effects.effect import Effect


@dataclass(frozen=True)
class Law:
    """What an effect does, as an HTML formula and as a sentence's end."""

    formula: str
    words: str


def law_of(effect: Effect) -> Law:
    """The law of an effect; of one that is not in the vocabulary, the first line of its documentation."""
    found = LAWS.get(effect.name)
    if found is not None:
        return Law(*found)
    first = (type(effect).__doc__ or "").strip().split("\n")[0]
    return Law(escape(first), "")


_DRY = "tanh(<i>v</i>/<i>w</i>)"
LAWS: dict[str, tuple[str, str]] = {
    "joint_viscous_friction": ("−<i>c</i> <i>v</i>", "opposes the motion, in proportion to its speed"),
    "joint_coulomb_friction": (f"−<i>T</i> {_DRY}", "opposes the motion with the same force at every speed"),
    "joint_asymmetric_coulomb_friction": (
        "−<i>T</i><sub>+</sub> for <i>v</i> &gt; 0, +<i>T</i><sub>−</sub> for <i>v</i> &lt; 0",
        "opposes the motion with a constant force, of another size in each direction",
    ),
    "joint_stribeck_friction": (
        f"−(<i>T</i><sub>c</sub> + (<i>T</i><sub>s</sub> − <i>T</i><sub>c</sub>) "
        f"exp(−(<i>v</i>/<i>v</i><sub>s</sub>)²)) {_DRY}",
        "opposes the motion, more near rest than at speed",
    ),
    "joint_load_dependent_friction": (
        f"−(<i>T</i> + <i>c</i> |<i>u</i>|) {_DRY}",
        "opposes the motion, more the more effort the transmission carries",
    ),
    "joint_spring": ("−<i>k</i> (<i>q</i> − <i>q</i><sub>rest</sub>)", "pulls the joint towards a rest position"),
    "joint_backlash": (
        "0 within the gap; a stiff, damped flank on either side",
        "lets the rotor turn freely over a gap before it moves the link",
    ),
    "joint_hard_stop": (
        "−(<i>k</i> δ + <i>d</i> δ̇) beyond the stop, 0 before it",
        "pushes the joint back beyond a position",
    ),
    "joint_elasticity": (
        "<i>k</i> ψ + <i>d</i> ψ̇, ψ the twist of the rotor against the link",
        "couples rotor and link by a spring in place of a rigid shaft",
    ),
    "rotor_inertia": ("−<i>J</i> <i>v̇</i>", "resists acceleration of this joint alone, as a motor's rotor does"),
    "torque_ripple": (
        "<i>A</i> sin(<i>n</i> <i>q</i> + φ)",
        "pushes back and forth as the joint turns, as cogging does",
    ),
    "actuator_delay": ("<i>u</i>(<i>t</i> − τ) acts", "lets the effort act later than it was asked for"),
    "actuator_lag": (
        "τ <i>ẏ</i> = <i>u</i> − <i>y</i>, <i>y</i> acts",
        "lets the effort follow what is asked for slowly",
    ),
    "actuator_saturation": ("<i>u</i> acts, cut at ±limit", "cuts the effort at a limit"),
    "actuator_gain_error": ("<i>g</i> <i>u</i> acts", "scales the effort"),
    "actuator_bias": ("<i>u</i> + <i>b</i> acts", "adds a constant effort to what is asked for"),
    "actuator_dead_zone": (
        "0 for |<i>u</i>| &lt; <i>w</i>, else <i>u</i> − <i>w</i> sign(<i>u</i>)",
        "swallows small efforts, and takes as much off large ones",
    ),
    "payload": (
        "a point mass <i>m</i> at (<i>x</i>, <i>y</i>, <i>z</i>) of the body",
        "rides on the body as a point mass",
    ),
    "gravity_misalignment": (
        "<i>g</i> = R<sub>x</sub>(roll) R<sub>y</sub>(pitch) (0, 0, −9.81)",
        "tilts gravity: the robot does not stand upright",
    ),
    "aerodynamic_drag": ("−<i>c</i> |<i>v</i>| <i>v</i>", "opposes the motion with the square of the speed"),
    "external_disturbance": (
        "<i>F</i> sin²(π (<i>t</i> − <i>t</i><sub>0</sub>)/<i>T</i>)",
        "pushes the body for a while",
    ),
    "unmodeled_contact": (
        "<i>k</i> δ + <i>d</i> δ̇ below the plane",
        "pushes back where the model has nothing to touch",
    ),
    "contact_stribeck_friction": (
        "μ + (μ<sub>s</sub> − μ) exp(−(<i>v</i><sub>t</sub>/<i>v</i><sub>s</sub>)²)",
        "makes the contact stick more at slow sliding than at fast",
    ),
    "contact_adhesion": ("−<i>F</i>, times exp(δ/range) outside", "pulls the two bodies together"),
    "contact_nonlinear_stiffness": ("+ <i>c</i> δ³", "stiffens the contact as it is pressed in"),
    "contact_viscoelastic_relaxation": (
        "+ <i>s</i>, <i>ṡ</i> = <i>k</i> δ̇ − <i>s</i>/τ",
        "adds a force on pressing in that dies away",
    ),
    "contact_hunt_crossley_dissipation": (
        "+ <i>K</i> δ <i>c</i> δ̇",
        "damps the contact, more the deeper it is pressed",
    ),
    "contact_rolling_resistance": (
        "−<i>c</i> λ against the rolling",
        "resists rolling in proportion to the normal force",
    ),
    "contact_anisotropic_friction": (
        "μ<sub>1</sub>, μ<sub>2</sub> along two axes",
        "makes one sliding direction rougher",
    ),
    "contact_presliding": (
        "−μ λ <i>z</i>/<i>d</i>, <i>ż</i> = <i>v</i> − |<i>v</i>| <i>z</i>/<i>d</i>",
        "gives elastically before it slides, as bristles do",
    ),
    "surface_offset": ("raised by the offset along its normal", "puts the surface elsewhere than the model has it"),
    "surface_tilt": ("normal ∝ (−tan <i>s</i><sub>x</sub>, −tan <i>s</i><sub>y</sub>, 1)", "tilts the surface"),
    "sensor_bias": ("reads the truth + <i>b</i>", "adds a constant to what is read"),
    "sensor_gain_error": ("reads <i>g</i> × the truth", "scales what is read"),
    "sensor_drift": ("reads the truth + <i>r</i> <i>t</i>", "moves away from the truth steadily"),
    "sensor_delay": ("reads the truth of <i>t</i> − τ", "reads the past"),
    "sensor_lag": ("τ <i>ẏ</i> = truth − <i>y</i>, <i>y</i> is read", "follows the truth slowly"),
    "sensor_misalignment": ("reads R<sup>T</sup> <i>f</i>", "is mounted askew"),
    "clock_skew": ("reads the truth of <i>t</i> (1 + <i>s</i>)", "runs on a clock of its own"),
}
