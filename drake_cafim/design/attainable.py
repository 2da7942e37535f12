"""Commands limited to what the robot can execute within its workspace."""

import numpy as np

from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


def attainable(model: PlanningModel, robot_state: Array, command: Array) -> Array:
    """The velocity (nu,) m/s that the robot reaches for `command` (nu,); it brakes to stay within the workspace."""
    size = len(command)
    reached = model.motion(robot_state, command[np.newaxis, np.newaxis])[0, -1]
    # the velocity follows from a position clipped to the workspace, so it has rounding errors
    return np.asarray(np.clip(reached[size : 2 * size], *model.velocity_bounds))
