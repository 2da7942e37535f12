"""What one touch tells, by how it is done: information over penetration and velocity."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from drake_cafim.information import fisher_information
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.studies.cell import Cell
from drake_cafim.studies.findings import Claim, Findings
from drake_cafim.tasks.hefting import Hefting
from drake_cafim.tasks.pinching import TRUE_DAMPING, TRUE_STIFFNESS, Pinching
from drake_cafim.tasks.rubbing import TRUE_FRICTION, Rubbing
from drake_cafim.typing import Array

DEPTH = np.linspace(0.0, 0.018, 73)  # m
SPEED = np.linspace(-0.3, 0.3, 61)  # m/s


def landscape_cells(short: bool) -> list[Cell]:
    """None: a landscape needs no run."""
    return []


def landscapes(results: Mapping[Cell, Any]) -> Findings:
    """Information of one sample, scaled by the prior's variance, for pinching, rubbing and hefting."""
    pinch, rub, heft = _pinching(), _rubbing(), _hefting()
    stuck = _of_one_sample(Rubbing(), np.array([0.02, 0.6, 0.0, 0.05]), np.array([TRUE_FRICTION]))
    claims = (
        Claim(
            "Friction is seen only where μ λ_n < R |v_t|",
            f"information {stuck:.3g} at 2 cm depth and 5 cm/s",
            "holds" if stuck == 0.0 else "does not hold",
        ),
        Claim(
            "Damping is seen only in motion, stiffness in depth",
            f"at rest the largest is {pinch[:, len(SPEED) // 2].max():.3g}, in motion {pinch.max():.3g}",
            "holds" if pinch.max() > pinch[:, len(SPEED) // 2].max() else "does not hold",
        ),
    )
    figures = (
        _figure("pinching", SPEED, 1e3 * DEPTH, pinch, ("opening velocity, m/s", "depth, mm")),
        _figure("rubbing", _TANGENTIAL, _NORMAL, rub, ("tangential velocity, m/s", "normal velocity, m/s")),
        _figure("hefting", _VELOCITY, _ACCELERATION, heft, ("velocity, m/s", "acceleration, m/s²")),
    )
    about = "Trace of one sample's Fisher information in units of the prior's variance, at the true parameters."
    return Findings("Information landscapes", about, claims, (), figures)


_TANGENTIAL, _NORMAL = np.linspace(-1.0, 1.0, 81), np.linspace(-0.5, 0.5, 41)
_VELOCITY, _ACCELERATION = np.linspace(-1.0, 1.0, 41), np.linspace(-15.0, 15.0, 61)


def _pinching() -> Array:
    """(depths, speeds)."""
    depth, speed = np.meshgrid(DEPTH, SPEED, indexing="ij")
    motion = np.stack([0.020 - depth, speed], axis=-1)
    return _of_one_sample_grid(Pinching(), motion, np.array([TRUE_STIFFNESS, TRUE_DAMPING]))


def _rubbing() -> Array:
    """(normal, tangential) at 1 cm depth."""
    normal, tangential = np.meshgrid(_NORMAL, _TANGENTIAL, indexing="ij")
    place = [np.full_like(normal, 0.03), np.full_like(normal, 0.7)]
    return _of_one_sample_grid(Rubbing(), np.stack([*place, normal, tangential], axis=-1), np.array([TRUE_FRICTION]))


def _hefting() -> Array:
    """(accelerations, velocities): the rigid law sees the acceleration alone."""
    acceleration, velocity = np.meshgrid(_ACCELERATION, _VELOCITY, indexing="ij")
    motion = np.stack([np.full_like(velocity, 0.3), velocity, acceleration], axis=-1)
    return _of_one_sample_grid(Hefting(), motion, np.array([0.05]))


def _of_one_sample(model: Any, motion: Array, theta: Array) -> float:
    return float(_of_one_sample_grid(model, motion[np.newaxis, np.newaxis], theta)[0, 0])


def _of_one_sample_grid(model: Any, motion: Array, theta: Array) -> Array:
    slope = model.contact_jacobians(np.zeros((*motion.shape[:-1], 0)), motion, theta).wrt_parameters
    fisher = fisher_information(slope[..., np.newaxis, :, :], model.noise_std)
    return np.asarray(np.einsum("...ii,i->...", fisher, model.parameters.std**2))


def _figure(name: str, across: Array, up: Array, values: Array, labels: tuple[str, str]) -> str:
    with page_style():
        figure = Figure(figsize=(4.2, 3.0), layout="constrained")
        axes = figure.subplots()
        filled = axes.contourf(across, up, values, levels=14, cmap="cividis")
        figure.colorbar(filled, ax=axes)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        axes.set_title(name)
        axes.grid(visible=False)
        return as_svg(figure, f"Information of one sample, {name}")
