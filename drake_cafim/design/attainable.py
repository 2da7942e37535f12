"""What of a command a robot can do."""

import numpy as np

from drake_cafim.sensitivity.model import PlanningModel
from drake_cafim.typing import Array


def attainable(model: PlanningModel, robot_state: Array, command: Array) -> Array:
    """The velocity (nu,) that the robot will have if `command` (nu,) is given: inside the workspace, it brakes."""
    size = len(command)
    reached = model.motion(robot_state, command[np.newaxis, np.newaxis])[0, -1]
    # a position that was cut off at the workspace gives its velocity up to rounding
    return np.asarray(np.clip(reached[size : 2 * size], *model.velocity_bounds))
