"""Unknown parameters of position servos, by the errors of simulations from their commands (output error).

The equations of a joint that a servo drives, kp (cmd − q) − kv v + … = 0, can be multiplied by any number where neither
inertia nor gravity fixes their scale. Where physics is missing, a stiffness of nearly zero then satisfies them best.
The error of a simulation over a second has no such scale (Ljung, System Identification, 1999, §4.3). Of each joint j,

    −2 ln p_j = W ln mean (q_j − q̂_j)² + Σ (x − μ)²/σ²

is minimised over the unknowns x of its servo and its encoder. W is the number of windows: the errors within one, which
are correlated, count as one observation of unknown size. Two further numbers stand for what nearly every servo has and
what would otherwise be taken for its stiffness and damping: Coulomb friction, and a delay of the command.

What moves another joint hardly moves this one, so that each joint has its own Jacobian, and the same number of all
joints is moved in one simulation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.predict.forecast import HORIZON, Forecast, simulated_courses, window_starts
from drake_cafim.diagnosis.predict.initial_state import state_at
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.effects.joint import JointCoulombFriction
from drake_cafim.effects.servo_effect import CommandDelay
from drake_cafim.scenario.servos import SERVO_PARAMETERS
from drake_cafim.scenario.unknown import UnknownParameter
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

MOST_WINDOWS = 600
"""Most windows that are simulated, spread evenly over all recordings."""
MOST_STEPS = 15
"""Most Gauss-Newton steps."""
LEAST_DECREASE = 1.0
"""Decrease of −2 ln p by a step below which the fit ends: it then moves no number by more than its std."""
RELATIVE_STEP = 0.02
"""Step of the differences, over the number or its std, the larger of the two: simulations with friction are rough."""
FRICTION_SHARE = 0.1
"""Torque of the friction at the start, over the root mean square of the servo's effort at the prior means."""
MOST_DAMPING = 1e4
"""Damping (Levenberg, Marquardt) beyond which no step is looked for."""
SCALES = (0.03, 0.1, 0.3, 0.6, 1.0)
"""Changes of the logarithm of a joint's efforts at which simulations are compared."""
BLOCKS = 4
"""Blocks of a recording whose errors count as independent of each other in the standard deviations."""


def servos_with_unknowns(scene: Scene, forms: Sequence[WeakForm]) -> tuple[str, ...]:
    """The joints that a servo with an unknown parameter drives in at least one recording."""
    driven = {scene.tree.joint_names[j] for form in forms for j in form.samples.commands}
    return tuple(
        name
        for name in scene.tree.joint_names
        if name in driven and any(u.parameter in SERVO_PARAMETERS and u.at == name for u in scene.unknown)
    )


def simulation_error(scene: Scene, forms: Sequence[WeakForm], model: Model) -> float:
    """Root mean square error of positions over a second, by `model`: the geometric mean over joints, rad (m).

    The joints are those whose servos have unknown parameters.
    """
    errors = _Errors(scene, tuple(forms), servos_with_unknowns(scene, forms))
    return float(np.exp(0.5 * np.mean(np.log(np.maximum(np.mean(errors.of(model) ** 2, axis=0), _TINY)))))


def fit_servos(scene: Scene, forms: Sequence[WeakForm]) -> Scene:
    """The scene with the priors of its servos' unknowns at what simulations of the recordings tell of them.

    Their standard deviations are those of the curvature or those of blocks of the recordings (`BLOCKS`), the larger of
    the two; to these come that of the scale of all efforts at the joint (`_scale_std`), and what the priors of the
    scene's other unknowns, as masses, let each value vary by. None is wider than its stated prior's. Such a prior is
    not set aside by a search.
    """
    joints = servos_with_unknowns(scene, forms)
    errors = _Errors(scene, tuple(forms), joints)
    model = _beside_nuisance(scene, forms, joints)
    numbers = [_numbers_of(scene, model, name) for name in joints]
    lower, upper = _bounds(scene, model)
    mean, std = _priors(scene, model)

    def costs(found: Array, vector: Array) -> Array:
        prior = [float(np.sum(((vector[own] - mean[own]) / std[own]) ** 2)) for own in indices]
        return np.asarray(errors.costs(found) + np.array(prior), dtype=float)

    vector, found, indices = model.vector, errors.of(model), [_indices(own) for own in numbers]
    damping = np.full(len(joints), 1e-2)
    for _ in range(MOST_STEPS):
        systems = _systems(errors, model.at(vector), found, numbers, (mean, std), (lower, upper))
        before, taken = costs(found, vector), None
        while taken is None and np.any(damping < MOST_DAMPING):
            trial = vector.copy()
            for own, system, own_damping in zip(indices, systems, damping, strict=True):
                trial[own] -= system.step(own_damping)
            trial = np.clip(trial, lower, upper)
            after = errors.of(model.at(trial))
            # a joint whose own error grows stays where it is
            worse = costs(after, trial) >= before
            for own in (own for own, stays in zip(indices, worse, strict=True) if stays):
                trial[own] = vector[own]
            if np.any(worse) and not np.all(worse):
                after = errors.of(model.at(trial))
            taken = (trial, after) if np.sum(costs(after, trial)) < np.sum(before) else None
            damping = np.where(worse | (taken is None), damping * 10.0, np.maximum(damping / 10.0, 1e-4))
        if taken is None:
            break
        vector, found = taken
        if np.sum(before - costs(found, vector)) < LEAST_DECREASE:
            break
    systems = _systems(errors, model.at(vector), found, numbers, (mean, std), (lower, upper))
    scales = _scale_stds(errors, model.at(vector), found, numbers, systems, (mean, std))
    moved = _moved_by_others(errors, model.at(vector), found, numbers, systems, (mean, std))
    known = dict[int, tuple[float, float]]()
    for names, system, scale, by_others in zip(numbers, systems, scales, moved, strict=True):
        own = _indices(names)
        by_scale = np.where([_scaled(name) for name in names], scale * vector[own], 0.0)
        total = np.sqrt(system.std**2 + by_scale**2 + by_others)
        known |= dict(zip(own.tolist(), zip(vector[own].tolist(), total.tolist(), strict=True), strict=True))
    return replace(
        scene,
        unknown=tuple(
            _settled(unknown, *known[i]) if i in known else unknown for i, unknown in enumerate(scene.unknown)
        ),
    )


def _settled(unknown: UnknownParameter, value: float, std: float) -> UnknownParameter:
    """The unknown with a prior at `value`, no wider than its own."""
    prior = replace(unknown.prior, mean=value, std=min(std, unknown.prior.std))
    return replace(unknown, prior=prior, settled=True)


def _beside_nuisance(scene: Scene, forms: Sequence[WeakForm], joints: Sequence[str]) -> Model:
    """The scene's model at its prior means, with a friction and a command's delay at each of the `joints`."""
    known = {effect.key for effect in (*scene.of_model, *scene.known)}
    effects = []
    for name in joints:
        j = scene.tree.joint_index(name)
        period = float(np.median(np.concatenate([np.diff(form.samples.time) for form in forms])))
        for effect in (
            CommandDelay(name, {"delay": period}),
            JointCoulombFriction(name, {"torque": FRICTION_SHARE * _effort(scene, forms, j)}),
        ):
            if effect.key not in known:
                effects.append(effect)
    return Model(scene.priors.mean).with_effects(effects)


def _effort(scene: Scene, forms: Sequence[WeakForm], joint: int) -> float:
    """Root mean square of a servo's effort, N m (N), along the recorded motion at the prior means."""
    servo = scene.physics.servo_at(scene.tree.joint_names[joint])
    squares = []
    for form in forms:
        command = form.samples.commands.get(joint)
        if command is not None:
            here = servo.effort(command.position, form.samples.q[:, joint], 0.0 * command.position)
            squares.append(here.value**2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _numbers_of(scene: Scene, model: Model, joint: str) -> dict[str, int]:
    """By name, the indices in the model's vector of the numbers that are fitted at a joint."""
    found = {
        f"{unknown.effect or ''}.{unknown.parameter}": i
        for i, unknown in enumerate(scene.unknown)
        if (unknown.parameter in SERVO_PARAMETERS and unknown.at == joint)
        or (unknown.effect is not None and unknown.at in (joint, f"q.{joint}"))
    }
    i = len(model.unknown)
    for effect in model.effects:
        for strength in effect.strengths:
            if effect.at == joint:
                found[f"{effect.name}.{strength.name}"] = i
            i += 1
    return found


def _indices(numbers: Mapping[str, int]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.array(list(numbers.values()), dtype=np.int64)


def _bounds(scene: Scene, model: Model) -> tuple[Array, Array]:
    """The least and largest values (n + k,); of unknowns above zero, a hundredth of the prior mean at least."""
    lower = [max(p.lower, 0.01 * p.mean) if p.lower == 0.0 else p.lower for p in scene.priors.free]
    upper = [p.upper for p in scene.priors.free]
    strengths = [strength for effect in model.effects for strength in effect.strengths]
    return (
        np.array([*lower, *(strength.lower for strength in strengths)]),
        np.array([*upper, *(strength.upper for strength in strengths)]),
    )


def _priors(scene: Scene, model: Model) -> tuple[Array, Array]:
    """Means and standard deviations (n + k,); a nuisance is zero, give or take ten times the value that it starts at.

    That is so wide that it only keeps apart what the recordings do not.
    """
    start = model.vector[len(model.unknown) :]
    mean = np.concatenate([scene.priors.mean, np.zeros(len(start))])
    return mean, np.concatenate([scene.priors.std, 10.0 * np.maximum(np.abs(start), 1e-9)])


@dataclass(frozen=True)
class _System:
    """The normal equations of one joint: the information `H` (m, m), the `gradient` (m,), and blocks' gradients."""

    H: Array
    gradient: Array
    blocks: Array
    """(b, m) gradients of the blocks of the recordings, the prior left out."""

    slopes: Array
    """(S, m) derivatives of the errors."""
    weight: float
    """What a squared error counts."""

    def step(self, damping: float) -> Array:
        """(m,) what is to be subtracted."""
        return np.asarray(np.linalg.solve(self.H + damping * np.diag(np.diag(self.H)), self.gradient), dtype=float)

    @property
    def std(self) -> Array:
        """(m,) standard deviations: √diag H⁻¹ or √diag(H⁻¹ Σ g_b g_bᵀ H⁻¹), the larger of the two."""
        inverse = np.linalg.inv(self.H)
        g = self.blocks - np.mean(self.blocks, axis=0)
        spread = g.T @ g * len(g) / max(1, len(g) - 1)
        return np.asarray(np.sqrt(np.maximum(np.diag(inverse), np.diag(inverse @ spread @ inverse))), dtype=float)


def _systems(
    errors: "_Errors",
    model: Model,
    found: Array,
    numbers: Sequence[Mapping[str, int]],
    priors: tuple[Array, Array],
    bounds: tuple[Array, Array],
) -> list[_System]:
    """The normal equations of each joint at `model`, whose errors are `found` (S, joints)."""
    vector, (mean, std), (lower, upper) = model.vector, priors, bounds
    # of the two further numbers the prior says nothing: what they begin with is their size
    size = np.where(np.arange(len(std)) < len(model.unknown), std, 0.1 * std)
    step = RELATIVE_STEP * np.maximum(np.abs(vector), size)
    step = np.where(vector + step > upper, -step, step)
    slopes: list[dict[str, Array]] = [{} for _ in numbers]
    for name in dict.fromkeys(name for own in numbers for name in own):
        beside = vector.copy()
        at = [own[name] for own in numbers if name in own]
        beside[at] += step[at]
        change = errors.of(model.at(np.clip(beside, lower, upper))) - found
        for j, own in enumerate(numbers):
            if name in own:
                slopes[j][name] = change[:, j] / step[own[name]]
    systems = []
    weight = errors.windows / np.maximum(np.sum(found**2, axis=0), _TINY)
    for j, own in enumerate(numbers):
        at_joint = _indices(own)
        J = np.stack([slopes[j][name] for name in own], axis=1)
        P = np.diag(std[at_joint] ** -2.0)
        blocks = weight[j] * np.stack(
            [J[errors.block == b].T @ found[errors.block == b, j] for b in np.unique(errors.block)]
        )
        systems.append(
            _System(
                weight[j] * J.T @ J + P,
                np.sum(blocks, axis=0) + P @ (vector[at_joint] - mean[at_joint]),
                blocks,
                J,
                float(weight[j]),
            )
        )
    return systems


def _scaled(name: str) -> bool:
    """Whether a number is an effort over a position, a velocity or nothing."""
    return name.startswith(".servo_") or name == "joint_coulomb_friction.torque"


def _scale_stds(
    errors: "_Errors",
    model: Model,
    found: Array,
    numbers: Sequence[Mapping[str, int]],
    systems: Sequence[_System],
    priors: tuple[Array, Array],
) -> Array:
    """(joints,) relative standard deviations of the scale of all efforts of each joint's servo and friction.

    Where neither inertia nor gravity fixes it, simulations hardly depend on it, and slopes by differences, rough as
    simulations with friction are, seem to know it all the same. It is the change of ln scale by which −2 ln p rises by
    one, all other numbers adapted to first order: the widest of those that changes of several sizes imply, since what
    is rough rises too much over small ones.
    """
    (mean, std), vector = priors, model.vector

    def costs(scale: float) -> Array:
        beside = vector.copy()
        for names in numbers:
            at = [i for name, i in names.items() if _scaled(name)]
            beside[at] *= scale
        left = errors.of(model.at(beside)) if scale != 1.0 else found.copy()
        prior = np.zeros(len(numbers))
        for j, (names, system) in enumerate(zip(numbers, systems, strict=True)):
            first = next(name for name in names if _scaled(name))
            others = system.slopes[:, [name != first for name in names]]
            left[:, j] -= others @ np.linalg.lstsq(others, left[:, j], rcond=None)[0]
            at = [i for name, i in names.items() if name.startswith(".servo_")]
            prior[j] = np.sum(((beside[at] - mean[at]) / std[at]) ** 2)
        return errors.costs(left) + prior

    here, widest = costs(1.0), np.zeros(len(numbers))
    for change in (sign * size for size in SCALES for sign in (-1.0, 1.0)):
        # a rise by Δ at a change c is a standard deviation of c/√Δ; without a rise, of c at least
        rise = np.maximum(costs(float(np.exp(change))) - here, 1.0)
        widest = np.maximum(widest, abs(change) / np.sqrt(rise))
    return np.asarray(widest, dtype=float)


def _moved_by_others(
    errors: "_Errors",
    model: Model,
    found: Array,
    numbers: Sequence[Mapping[str, int]],
    systems: Sequence[_System],
    priors: tuple[Array, Array],
) -> list[Array]:
    """For each joint (m,), the variance of its numbers by the unknowns of the scene that are no joint's numbers."""
    own = {i for names in numbers for i in names.values()}
    variances = [np.zeros(len(names)) for names in numbers]
    for i in range(len(model.unknown)):
        if i in own:
            continue
        beside = model.vector.copy()
        beside[i] += priors[1][i]
        change = errors.of(model.at(beside)) - found
        for j, system in enumerate(systems):
            variances[j] += np.linalg.solve(system.H, system.weight * system.slopes.T @ change[:, j]) ** 2
    return variances


_TINY = 1e-30
"""rad² (m²): least sum of squared errors, of a joint that does not move."""


@dataclass
class _Errors:
    """Errors (S, c) of the simulated positions of `joints` at all samples of the windows."""

    scene: Scene
    forms: tuple[WeakForm, ...]
    joints: tuple[str, ...]

    def __post_init__(self) -> None:
        starts = [window_starts(form.samples.time, HORIZON) for form in self.forms]
        total = sum(map(len, starts))
        every = max(1, -(-total // MOST_WINDOWS))
        self.starts = [own[:: min(every, len(own))] for own in starts]
        self.windows = sum(map(len, self.starts))
        self.block = np.zeros(0, dtype=np.int64)

    def of(self, model: Model) -> Array:
        """Errors (S, c) of `model`; what is no number counts as the range in which the joint moved."""
        chosen = {id(form): own for form, own in zip(self.forms, self.starts, strict=True)}
        found = simulated_courses(
            self.forms,
            model.physics(self.scene),
            lambda weak: (chosen[id(weak)], HORIZON),
            lambda weak, under, start: state_at(weak.samples, weak.measurement(under), start)[:2],
        )
        if not len(self.block):
            self.block = np.concatenate([_blocks(k, forecast) for k, forecast in enumerate(found)])
        return np.concatenate([self._misses(forecast) for forecast in found])

    def costs(self, found: Array) -> Array:
        """(c,) W ln mean of the squared errors of each joint."""
        return np.asarray(self.windows * np.log(np.maximum(np.mean(found**2, axis=0), _TINY)), dtype=float)

    def _misses(self, forecast: Forecast) -> Array:
        columns = []
        for name in self.joints:
            measured = forecast.measured[f"q.{name}"]
            miss = forecast.predicted[f"q.{name}"] - measured
            columns.append(np.where(np.isfinite(miss), miss, np.nanmax(measured) - np.nanmin(measured)))
        return np.stack(columns, axis=1)


def _blocks(recording: int, forecast: Forecast) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """(S,) the block of each sample of a recording, numbered through."""
    windows = np.unique(forecast.window)
    at = np.searchsorted(windows, forecast.window)
    return np.asarray(BLOCKS * recording + at * BLOCKS // len(windows), dtype=np.int64)
