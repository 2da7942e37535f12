"""A simulated window that holds one sample, as before a gap, has no interval in which a servo could act."""

import numpy as np

from drake_cafim.diagnosis.predict.servo_input import ServoInput, stacked


def test_it_is_as_long_as_the_others_with_its_servos_off() -> None:
    whole = ServoInput(*(np.full((3, 2), float(k + 1)) for k in range(6)))
    first, *_, last = stacked([whole, ServoInput(*(np.empty((0, 2)) for _ in range(6))).padded(3)])
    assert np.array_equal(first.on, [[1.0, 1.0], [0.0, 0.0]])
    assert np.array_equal(last.command, [[2.0, 2.0], [1.0, 1.0]])
