"""Study `landscapes`: Fisher information of one sample as a function of penetration and velocity."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from drake_cafim.information import fisher_information
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.sensitivity.tangent import TangentEvaluator
from drake_cafim.studies.cell import Cell
from drake_cafim.studies.findings import Claim, Findings
from drake_cafim.tasks.compliant_hefting import CompliantHefting
from drake_cafim.tasks.pinching import TRUE_DAMPING, TRUE_STIFFNESS, Pinching
from drake_cafim.tasks.rubbing import TRUE_FRICTION, Rubbing
from drake_cafim.typing import Array

DEPTH = np.linspace(0.0, 0.018, 73)  # m
SPEED = np.linspace(-0.3, 0.3, 61)  # m/s


def landscape_cells(short: bool) -> list[Cell]:
    """No cells: landscapes are computed without runs."""
    return []


def landscapes(results: Mapping[Cell, Any]) -> Findings:
    """Information of one sample, scaled by the prior's variance, for pinching, rubbing and hefting."""
    pinch, rub, heft = _pinching(), _rubbing(), _hefting()
    figures = (
        _figure("hefting", _RATE, 1e3 * _PENETRATION, heft, ("normal velocity, m/s", "depth, mm")),
        _figure("pinching", SPEED, 1e3 * DEPTH, pinch, ("opening velocity, m/s", "depth, mm")),
        _figure("rubbing", _TANGENTIAL, _NORMAL, rub, ("tangential velocity, m/s", "normal velocity, m/s")),
    )
    about = (
        "Trace of the Fisher information of one sample (hefting: the mean of those within 10 ms), in units of the "
        "prior's variance, at the true parameters."
    )
    return Findings("Information landscapes", about, landscape_claims(), (), figures)


def landscape_claims() -> tuple[Claim, ...]:
    """Tests of the paper's statements on each landscape (its A4)."""
    pinch, rub, heft = _pinching(), _rubbing(), _hefting()
    linear = _linearity(heft)
    _, across = np.unravel_index(int(heft.argmax()), heft.shape)
    pressed, moved = _place(pinch, DEPTH, SPEED)
    normal, tangential = _place(rub, _NORMAL, _TANGENTIAL)
    stuck = _of_one_sample(Rubbing(), np.array([0.02, 0.6, 0.0, 0.05]), np.array([TRUE_FRICTION]))
    pushed = _of_one_sample(Rubbing(), np.array([0.036, 0.6, -0.1, 0.5]), np.array([TRUE_FRICTION]))
    harder = _of_one_sample(Rubbing(), np.array([0.002, 0.6, -0.1, 0.5]), np.array([TRUE_FRICTION]))
    still = pinch[:, len(SPEED) // 2].max()
    return (
        _claim("Hefting's landscape is linear in depth and velocity", f"a plane explains {linear:.2f}", linear > 0.95),
        _claim(
            "Hefting is pulled to the bounds of velocity",
            f"most at {_RATE[across]:+.2f} m/s of ±{_RATE[-1]:g}",
            abs(_RATE[across]) == _RATE[-1],
        ),
        _claim(
            "Pinching has an optimum between depth and rate inside its bounds",
            f"most at {1e3 * pressed:.1f} mm of {1e3 * DEPTH[-1]:g} and {moved:+.2f} m/s of ±{SPEED[-1]:g}",
            pressed < DEPTH[-1] and abs(moved) < SPEED[-1],
        ),
        _claim(
            "Stiffness and damping ask for motion, not for depth alone",
            f"at rest at most {still:.3g}, in motion {pinch.max():.3g}",
            bool(pinch.max() > still),
        ),
        _claim(
            "Rubbing asks for pressing and sliding at once",
            f"most at {normal:+.2f} m/s along the normal, {tangential:+.2f} m/s along the wall",
            normal < 0 and abs(tangential) > 0.5,
        ),
        _claim(
            "Pressing harder always tells more of friction",
            f"{pushed:.3g} at 4 mm depth, {harder:.3g} at 38 mm: seen where μλ < R|v|; {stuck:.3g} at 20 mm, 5 cm/s",
            harder > pushed,
        ),
    )


def _claim(claim: str, found: str, holds: bool) -> Claim:
    return Claim(claim, found, "holds" if holds else "does not hold")


def _place(values: Array, up: Array, across: Array) -> tuple[float, float]:
    """The coordinates of the largest of `values` (up, across)."""
    row, column = np.unravel_index(int(values.argmax()), values.shape)
    return float(up[row]), float(across[column])


def _linearity(values: Array) -> float:
    """R² of a plane fitted to `values` (up, across)."""
    up, across = np.meshgrid(*(np.linspace(-1.0, 1.0, size) for size in values.shape), indexing="ij")
    columns = np.stack([np.ones(values.size), up.ravel(), across.ravel()], axis=-1)
    fitted = columns @ np.linalg.lstsq(columns, values.ravel(), rcond=None)[0]
    return float(1.0 - np.var(values.ravel() - fitted) / np.var(values))


_TANGENTIAL, _NORMAL = np.linspace(-1.0, 1.0, 81), np.linspace(-0.5, 0.5, 41)
_RATE, _PENETRATION = np.linspace(-1.0, 1.0, 41), np.linspace(0.0, 0.01, 21)


def _pinching() -> Array:
    """Information (depths, speeds)."""
    depth, speed = np.meshgrid(DEPTH, SPEED, indexing="ij")
    motion = np.stack([0.020 - depth, speed], axis=-1)
    return _of_one_sample_grid(Pinching(), motion, np.array([TRUE_STIFFNESS, TRUE_DAMPING]))


def _rubbing() -> Array:
    """Information (normal velocities, tangential velocities) at 1 cm depth."""
    normal, tangential = np.meshgrid(_NORMAL, _TANGENTIAL, indexing="ij")
    place = [np.full_like(normal, 0.03), np.full_like(normal, 0.7)]
    return _of_one_sample_grid(Rubbing(), np.stack([*place, normal, tangential], axis=-1), np.array([TRUE_FRICTION]))


def _hefting() -> Array:
    """Information (depths, velocities) of a palm that meets a ball at rest, mean over the samples of 10 ms.

    The force does not depend on the mass directly; the information comes from the ball's acceleration.
    """
    model, theta = CompliantHefting(period=2.5e-4, substeps=1), np.array([0.05])
    depth, rate = np.meshgrid(_PENETRATION, _RATE, indexing="ij")
    elapsed: Array = model.period * np.arange(41, dtype=float)
    velocity = np.broadcast_to(rate.reshape(-1, 1), (rate.size, len(elapsed)))
    height = depth.reshape(-1, 1) + velocity * elapsed
    motion = np.stack([height, velocity, np.zeros_like(velocity)], axis=-1)
    rest = model.start(np.array([theta[0] * model.gravity / model.stiffness, 0.0, 0.0]), theta)
    rollout = TangentEvaluator(model)(motion, theta, rest)
    fisher = fisher_information(rollout.sensitivities, model.noise_std)[:, 0, 0] / (len(elapsed) - 1)
    return np.asarray(fisher.reshape(depth.shape) * model.parameters.std[0] ** 2)


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
        axes.locator_params(axis="x", nbins=5)  # more would run into each other
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        axes.set_title(name)
        axes.grid(visible=False)
        return as_svg(figure, f"Information of one sample, {name}")
