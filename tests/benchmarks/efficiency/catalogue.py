"""The cells of the table: rigs, noise and motions over the ranges that recordings of robots have."""

from __future__ import annotations

from .cell import Cell, Motion, Noise
from .machines import Effect, Unknown, planar_arm, press, seven_joints, slider


def _mass(body: str, mean: float, std: float, true: float) -> Unknown:
    return Unknown({"parameter": "mass", "body": body, "mean": mean, "std": std}, true)


def _contact(parameter: str, mean: float, std: float, true: float) -> Unknown:
    return Unknown({"parameter": parameter, "contact": ["tool", "wall"], "mean": mean, "std": std}, true)


def _viscous(at: str, coefficient: float) -> Effect:
    return Effect("joint_viscous_friction", at, {"coefficient": coefficient})


def _coulomb(at: str, torque: float) -> Effect:
    return Effect("joint_coulomb_friction", at, {"torque": torque}, width=0.005)


BLOCK = (_mass("block", 2.0, 0.4, 2.2),)
FORE = (_mass("fore", 1.5, 0.15, 1.6),)
LAST = (_mass("link7", 0.828, 0.08, 0.87),)
HANGING, RAISED = (0.3, -0.4), (3.0, 0.2)
SPREAD = (0.1, 0.4, -0.3, 0.5, 0.2, -0.6, 0.3)
SLOW, FAST = (0.2, 0.5), (0.8, 1.7, 2.9)

CELLS = (
    Cell("slider, 1 ms, fine encoder, slow", slider, Motion(SLOW, 0.6, (0.0,)), 0.001, 5.0, Noise(1e-5),
         _viscous("rail", 0.5), BLOCK),
    Cell("slider, 2 ms, coarse q and v, slow", slider, Motion((0.3, 0.7), 0.4, (0.0,)), 0.002, 5.0,
         Noise(1.2e-3, 2.4e-2), _viscous("rail", 0.5), BLOCK),
    Cell("slider, 10 ms, coarse q, fast", slider, Motion(FAST, 0.5, (0.0,)), 0.01, 10.0, Noise(2e-3),
         _viscous("rail", 0.5), BLOCK),
    Cell("slider, 2 ms, rests, reversals", slider, Motion((0.5, 1.0), 0.4, (0.0,), rests=0.5), 0.002, 6.0,
         Noise(1e-4, 5e-3), _coulomb("rail", 0.6), BLOCK),
    Cell("slider, 4 ms, gaps", slider, Motion((0.3, 0.7), 0.5, (0.0,)), 0.004, 8.0, Noise(2e-4, 4e-3),
         _viscous("rail", 0.5), BLOCK, gaps=((1.0, 1.3), (3.1, 3.2), (5.5, 5.9))),
    Cell("slider, 2 ms, noise of u", slider, Motion((0.5, 1.3), 0.4, (0.0,)), 0.002, 4.0, Noise(2e-4, 4e-3, u=0.2),
         _viscous("rail", 0.5), BLOCK),
    Cell("2 joints, 2 ms, q and v, medium", planar_arm, Motion((0.4, 0.9), 0.8, HANGING), 0.002, 4.0,
         Noise(2e-4, 2e-3), _viscous("elbow", 0.3), FORE),
    Cell("2 joints, 5 ms, coarse q, slow", planar_arm, Motion(SLOW, 1.0, HANGING), 0.005, 8.0, Noise(1e-3),
         _coulomb("shoulder", 0.5), FORE),
    Cell("2 joints, 10 ms, fine q, fast", planar_arm, Motion(FAST, 0.8, HANGING), 0.01, 6.0, Noise(2e-5),
         Effect("actuator_gain_error", "elbow", {"gain": 0.93}), FORE),
    Cell("2 joints, 2 ms, noise fed back", planar_arm, Motion((0.4, 0.9), 0.8, HANGING), 0.002, 4.0,
         Noise(5e-4, 5e-3), _viscous("elbow", 0.3), FORE, fed_back=True, bandwidth=15.0),
    Cell("2 joints, 4 ms, noise of u", planar_arm, Motion((0.4, 1.1), 0.8, HANGING), 0.004, 6.0,
         Noise(2e-4, 2e-3, u=0.05), _viscous("shoulder", 0.3), FORE),
    Cell("2 joints raised, 2 ms, unstable", planar_arm, Motion((0.4, 0.9), 0.5, RAISED), 0.002, 4.0,
         Noise(2e-4, 2e-3), _viscous("elbow", 0.3), FORE),
    Cell("7 joints, 2 ms, fine q and v", seven_joints, Motion((0.3, 0.8), 0.7, SPREAD), 0.002, 3.0, Noise(5e-5, 1e-3),
         _viscous("j4", 0.3), LAST),
    Cell("7 joints, 4 ms, coarse q, slow", seven_joints, Motion(SLOW, 0.8, SPREAD), 0.004, 6.0, Noise(1e-3),
         _coulomb("j2", 0.5), LAST),
    Cell("press, 2 ms, rubs and leaves the wall", press,
         Motion((0.4, 1.1), (0.03, 0.03, 0.002), (0.0, 0.0, 0.1037)), 0.002, 4.0,
         Noise(1e-5, 5e-4, force=0.1, torque=0.01), _viscous("px", 1.0),
         (_contact("stiffness", 4500.0, 225.0, 4600.0), _contact("friction", 0.4, 0.02, 0.41)), bandwidth=15.0),
)  # fmt: skip
