"""Effects of one kind at many places are one part of the sentence."""

from collections.abc import Sequence

from drake_cafim.diagnosis.verdict import Explanation, Learned, Value, _learned, _spoken
from drake_cafim.effects.catalogue import effect_named
from drake_cafim.effects.learned_force import LearnedForce


def _found(name: str, at: str, values: dict[str, tuple[float, str]]) -> Explanation:
    effect = effect_named(name)(at, {key: value for key, (value, _) in values.items()})
    told = {key: Value(value, 0.01, unit) for key, (value, unit) in values.items()}
    return Explanation(effect, 1.0, told, f"{name} of {at}")


def _frictions(joints: Sequence[str]) -> list[Explanation]:
    return [_found("joint_coulomb_friction", j, {"torque": (0.2 + 0.1 * k, "N m")}) for k, j in enumerate(joints)]


def test_three_of_a_kind_are_told_together_with_the_range_of_their_parameters() -> None:
    gain = _found("actuator_gain_error", "b", {"gain": (0.9, "1")})
    a, b, c = _frictions("abc")
    words = "joint coulomb friction at a, b and c (torque 0.2 to 0.4 N m)"
    assert _spoken([a, gain, b, c]) == f"{words}; actuator_gain_error of b"


def test_equal_values_are_no_range_and_a_unit_of_one_is_left_out() -> None:
    gains = [_found("actuator_gain_error", at, {"gain": (0.9, "1")}) for at in "abc"]
    assert _spoken(gains) == "actuator gain error at a, b and c (gain 0.9)"


def test_two_of_a_kind_keep_their_own_words() -> None:
    assert _spoken(_frictions("ab")) == "joint_coulomb_friction of a; joint_coulomb_friction of b"


def test_laws_without_a_name_are_described_as_long_as_they_are_few() -> None:
    laws = [Learned(LearnedForce(at, {}), f"at {at} a force that changes") for at in "abc"]
    assert _learned(laws[:2]) == "at a a force that changes; at b a force that changes"
    assert _learned(laws) == "a force each at a, b and c"
