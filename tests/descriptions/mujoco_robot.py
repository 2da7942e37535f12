"""A shipped description in MuJoCo: its own frictions, springs, rotors and motors, on a base that stands still."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

DRAWN = ("visual", "collision")
"""Elements of a link that have no part in its motion, and whose meshes MuJoCo would read."""
SUBSTEP = 2.5e-4
"""s, one step of MuJoCo."""

DRY_SOLREF, DRY_SOLIMP = (2.0 * SUBSTEP, 1.0), 0.999
"""As stiff as dry friction can be at this step: full from some 1e-4 rad/s on."""


def specification(scene: Scene, path: Path) -> Any:
    """MuJoCo's editable model of the file, with the joints welded that the scene holds.

    Raises `ValueError` for a file that MuJoCo refuses.
    """
    if path.suffix == ".urdf":
        root = ET.parse(path).getroot()
        for link in root.findall("link"):
            for shape in [child for child in link if child.tag in DRAWN]:
                link.remove(shape)
        for joint in root.findall("joint"):
            for mimic in joint.findall("mimic"):  # of fingers, which are held
                joint.remove(mimic)
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    else:
        spec = mujoco.MjSpec.from_file(str(path))
    assert not isinstance(scene.scenario.lock, str)
    for name in scene.scenario.lock:
        spec.delete(spec.joint(name))
    return spec


@dataclass(frozen=True)
class Robot:
    """A compiled model, and where the scene's joints are in it: their indices and those of their motors, −1 for none.

    A joint without a motor of its own gets its effort directly. A motor that holds a position is switched off: efforts
    are commanded.
    """

    model: Any
    names: tuple[str, ...]
    joints: tuple[int, ...]
    motors: tuple[int, ...]

    @classmethod
    def of(cls, spec: Any, scene: Scene) -> "Robot":
        model = spec.compile()
        known = [model.joint(k).name for k in range(model.njnt)]
        names = scene.tree.joint_names
        # a joint without a name is known here by its place
        joints = tuple(known.index(name) if name in known else k for k, name in enumerate(names))
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, SUBSTEP
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_EQUALITY
        # at its defaults MuJoCo makes of a light joint's dry friction a viscous one that is full from 1 rad/s only
        model.dof_solref[:], model.dof_solimp[:, :2] = DRY_SOLREF, DRY_SOLIMP
        model.opt.density = model.opt.viscosity = 0.0
        model.opt.gravity = scene.scenario.gravity
        motors = _motors(model)
        return cls(model, names, joints, tuple(motors.get(joint, -1) for joint in joints))

    @cached_property
    def scratch(self) -> Any:
        return mujoco.MjData(self.model)

    @property
    def places(self) -> Array:
        return np.asarray(self.model.jnt_qposadr[list(self.joints)])

    @property
    def degrees(self) -> Array:
        return np.asarray(self.model.jnt_dofadr[list(self.joints)])

    def drive(self, data: Any, effort: Array) -> None:
        """Put the efforts (n,) at the joints, by their motors where they have one."""
        for degree, motor, value in zip(self.degrees, self.motors, effort, strict=True):
            if motor < 0:
                data.qfrc_applied[degree] = value
            else:
                data.ctrl[motor] = value / (self.model.actuator_gear[motor, 0] * self.model.actuator_gainprm[motor, 0])

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """Efforts (N, n) of motions (N, n), with all that the file says acts but dry friction."""
        model, data, found = self.model, self.scratch, []
        disabled = int(model.opt.disableflags)
        model.opt.disableflags = disabled | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        for k in range(len(q)):
            data.qpos[self.places], data.qvel[self.degrees], data.qacc[self.degrees] = q[k], v[k], a[k]
            mujoco.mj_inverse(model, data)
            found.append(data.qfrc_inverse[self.degrees].copy())
        model.opt.disableflags = disabled
        return np.array(found)

    @property
    def frictions(self) -> Array:
        """Dry friction (n,) as the file states it, N m or N."""
        return np.asarray(self.model.dof_frictionloss[self.degrees])

    def mass_matrices(self, q: Array) -> Array:
        """(N, n, n) at q (N, n), rotors included."""
        data, full = mujoco.MjData(self.model), np.zeros((self.model.nv, self.model.nv))
        found = []
        for place in q:
            data.qpos[self.places] = place
            mujoco.mj_fwdPosition(self.model, data)
            mujoco.mj_fullM(self.model, data, full)
            found.append(full[np.ix_(self.degrees, self.degrees)])
        return np.array(found)


def _motors(model: Any) -> dict[int, int]:
    """The motor of each joint that has just one; other actuators are switched off."""
    found: dict[int, list[int]] = {}
    for k in range(model.nu):
        plain = (
            model.actuator_trntype[k] == mujoco.mjtTrn.mjTRN_JOINT
            and model.actuator_gaintype[k] == mujoco.mjtGain.mjGAIN_FIXED
            and model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_NONE
            and model.actuator_dyntype[k] == mujoco.mjtDyn.mjDYN_NONE
        )
        if plain:
            found.setdefault(int(model.actuator_trnid[k, 0]), []).append(k)
    motors = {joint: of[0] for joint, of in found.items() if len(of) == 1}
    for k in set(range(model.nu)) - set(motors.values()):
        model.actuator_gainprm[k], model.actuator_biasprm[k] = 0.0, 0.0
    return motors
