"""Friction and rotors that a model file states and the recordings refute, as the round numbers of many public files."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import adequacy
from drake_cafim.diagnosis.fit.columns import Nuisance
from drake_cafim.diagnosis.fit.fitting import CONVERGED, Fit, fit
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.fit.problem import Problem
from drake_cafim.diagnosis.fit.screening import by_row, solve_beside
from drake_cafim.diagnosis.joints.weak_form_rows import WeakFormRows
from drake_cafim.diagnosis.thresholds import (
    MISFIT_REDUCED_CHI_SQUARE,
    NAMED_EXCESS_SHARE,
    STATED_SHARE_FAR_LESS,
    UNDETERMINED_STD_SHARE,
)
from drake_cafim.diagnosis.trace import NOMINAL, Record
from drake_cafim.dynamics.tree import Joint
from drake_cafim.effects.joint import JointCoulombFriction, JointViscousFriction
from drake_cafim.effects.link import RotorInertia
from drake_cafim.numerics.rounding import rounded
from drake_cafim.scenario.unknown import DRY_FRICTION, stated_friction
from drake_cafim.scene.scene import Scene
from drake_cafim.typing import Array

STEP = "overstated"
"""The step of the trace at which it is found."""
NEGLIGIBLE = 1e-6
"""Share of what is stated that hardly acts."""
FRICTION, ROTOR = "friction", "rotor inertia"
PARAMETERS = {FRICTION: ("damping", DRY_FRICTION), ROTOR: ("rotor_inertia",)}
"""What a file may state too large, and the parameters that it is."""


@dataclass(frozen=True)
class Overstated:
    """Far too large friction and rotor inertias that a model file states, and the p-value of the model as stated.

    `notes` are by `FRICTION` and `ROTOR` one a joint, `share` that of the excess over noise in the joint's equation
    which less of it removes. `turning` are the joints that do have a rotor, a smaller one; `friction` those of which
    the file states damping and dry friction, far too large or not.
    """

    notes: Mapping[str, Mapping[str, str]]
    share: Mapping[str, Mapping[str, float]]
    p_value: float
    turning: Sequence[str] = ()
    friction: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @property
    def joints(self) -> dict[str, tuple[str, ...]]:
        """The joints of which each is told."""
        return {kind: tuple(notes) for kind, notes in self.notes.items() if notes}

    @property
    def words(self) -> list[str]:
        """All notes."""
        return [note for notes in self.notes.values() for note in notes.values()]

    @property
    def records(self) -> list[Record]:
        """The decisions, for a trace."""
        share = "share of the excess over noise"
        return [
            Record(STEP, NOMINAL, self.share[kind][at], NAMED_EXCESS_SHARE, True, note, share)
            for kind, notes in self.notes.items()
            for at, note in notes.items()
        ]


def find_overstated(problem: Problem) -> Overstated | None:
    """The joints whose stated friction or rotor is far too large, by a fit of the nominal model; None without one.

    No effect can say so: friction that is missing resists, and so does a rotor. Told are joints where far less
    friction, viscous and Coulomb's fitted together, removes half of what is left in the joint's equation without it,
    and those where far less rotor inertia does.
    """
    if not isinstance(problem, WeakFormRows) or any(form.samples.commands for form in problem.forms):
        return None
    nominal = problem.nominal()
    physics = nominal.physics(problem.scene)
    if not (np.any(physics.dampings) or np.any(physics.rotor_inertias) or stated_friction(problem.scene.of_model)):
        return None
    fitted = fit(problem, nominal, tolerance=CONVERGED)
    found = list(_overstated(problem, fitted))
    if not found:
        return None
    notes: dict[str, dict[str, str]] = {FRICTION: {}, ROTOR: {}}
    shares: dict[str, dict[str, float]] = {FRICTION: {}, ROTOR: {}}
    for kind, at, share, note, _ in found:
        notes[kind][at], shares[kind][at] = note, share
    turning = [at for kind, at, _, _, shown in found if kind == ROTOR and shown]
    joints = problem.scene.tree.joints
    stated = np.array([_stated(problem.scene, joint)[:2] for joint in joints])
    friction = {
        name: [joint.name for joint, value in zip(joints, values, strict=True) if value > 0.0]
        for name, values in zip(PARAMETERS[FRICTION], stated.T, strict=True)
    }
    return Overstated(notes, shares, adequacy(problem, fitted.residual, 0).p_value, turning, friction)


def without_overstated(scene: Scene, overstated: Overstated) -> Scene:
    """The scene in which there is none of what the model file states far too large.

    `scene` has it unknown. What is there instead a search finds as effects, in all shapes that they have. Of friction
    that is all that the file states: where some is far too large the other may be far too small, and beside an unknown
    as uncertain as it is large what is missing could not be told. A smaller rotor, which has one shape alone, stays
    unknown: without it a light link would follow each step of its effort.
    """
    gone = {("rotor_inertia", at) for at in overstated.joints.get(ROTOR, ()) if at not in overstated.turning}
    if FRICTION in overstated.joints:
        gone |= {(name, at) for name, joints in overstated.friction.items() for at in joints}
    without = replace(
        scene,
        unknown=tuple(
            replace(
                unknown,
                prior=replace(unknown.prior, mean=0.0, std=NEGLIGIBLE * unknown.prior.std),
                settled=True,
                left_out=True,
            )
            if unknown.kind == "joint" and (unknown.parameter, unknown.at) in gone
            else unknown
            for unknown in scene.unknown
        ),
    )
    return replace(without, physics=without.physics_at(without.priors.mean))


def _overstated(problem: WeakFormRows, nominal: Fit) -> Iterator[tuple[str, str, float, str, bool]]:
    """`FRICTION` or `ROTOR`, joint, share and note, each judged beside the other; whether the joint has a rotor."""
    scene, nuisance = problem.scene, Nuisance.of(nominal)
    left, windows = by_row(problem, nominal.residual), sum(run.shape[0] for run in problem.runs)
    model = scene.scenario.model or "the model"
    for j, joint in enumerate(scene.tree.joints):
        stated = _stated(scene, joint)
        if not np.any(stated > 0.0):
            continue
        row = problem.runs[0].weak.dynamic.start + j
        columns = _columns(problem, nominal.model, j, rotor=bool(stated[-1] > 0.0))
        friction, rotor = columns[:, :2], columns[:, 2:]
        together, without_rotor = (_solved(problem, X, nuisance, row) for X in (columns, friction))
        without_friction = _solved(problem, rotor, nuisance, row) if rotor.shape[1] else (np.zeros(0), left[row])
        if together is None or without_rotor is None or without_friction is None:
            continue
        found = stated + np.append(together[0], np.zeros(3 - columns.shape[1]))
        far = (stated > 0.0) & (found < STATED_SHARE_FAR_LESS * stated)
        misfits = without_friction[1], without_rotor[1]
        # of noise alone there is no share
        shares = [
            (had - together[1]) / (had - windows) if had > MISFIT_REDUCED_CHI_SQUARE * windows else 0.0
            for had in misfits
        ]
        if shares[0] > NAMED_EXCESS_SHARE and np.any(far[:2]):
            yield FRICTION, joint.name, float(shares[0]), _words(joint, stated[:2], found[:2], model), False
        if shares[1] > NAMED_EXCESS_SHARE and far[2]:
            without_any = _solved(problem, friction, _shifted(nuisance, -stated[2] * rotor[:, 0]), row)
            # (value / std)² by the decrease of χ², in units of what remains
            decrease = 0.0 if without_any is None else without_any[1] - together[1]
            ratio = decrease * windows / max(together[1], windows)
            turning = bool(found[2] > 0.0 and ratio > UNDETERMINED_STD_SHARE**-2.0)
            yield ROTOR, joint.name, float(shares[1]), _words_of_rotor(joint, stated[2], found[2], model), turning


def _stated(scene: Scene, joint: Joint) -> Array:
    """(3,) damping, dry friction and rotor inertia that the model file states of a joint; 0 of what is unknown."""
    known = {(unknown.parameter, unknown.at) for unknown in scene.unknown if unknown.kind == "joint"}
    values = (joint.damping, stated_friction(scene.of_model).get(joint.name, 0.0), joint.rotor_inertia)
    names = ("damping", DRY_FRICTION, "rotor_inertia")
    return np.array([0.0 if (name, joint.name) in known else value for name, value in zip(names, values, strict=True)])


def friction_columns(problem: WeakFormRows, model: Model, j: int) -> Array:
    """(R, 2) whitened rows by viscous and Coulomb friction of the joint `j`."""
    at, physics = problem.scene.tree.joints[j].name, model.physics(problem.scene)
    laws = (JointViscousFriction(at, {"coefficient": 1.0}), JointCoulombFriction(at, {"torque": 1.0}))
    along = [run.weak.law_samples(physics)[j] for run in problem.runs]
    forces = [np.concatenate([law.force(samples).d_strengths for law in laws], axis=1) for samples in along]
    return problem.joint_columns(j, forces)


def _columns(problem: WeakFormRows, model: Model, j: int, rotor: bool) -> Array:
    """(R, 2 or 3) whitened rows by viscous and Coulomb friction of the joint `j`, and by its rotor's inertia."""
    X = friction_columns(problem, model, j)
    if not rotor:
        return X
    turning = model.with_effects([RotorInertia(problem.scene.tree.joints[j].name, {"inertia": 0.0})])
    return np.column_stack([X, problem.effect_columns(turning, len(turning.effects) - 1)[: len(X)]])


def _shifted(nuisance: Nuisance, change: Array) -> Nuisance:
    """The nuisance beside which the first rows' residuals are larger by `change` (R,)."""
    whole = np.concatenate([change, np.zeros(len(nuisance.residual) - len(change))])
    return Nuisance(nuisance.basis, nuisance.residual + whole - nuisance.basis @ (nuisance.basis.T @ whole))


def _solved(problem: WeakFormRows, X: Array, nuisance: Nuisance, row: int) -> tuple[Array, float] | None:
    """The coefficients of the columns `X` (R, k) that fit best, and χ² of a kind of `row` with them."""
    solved = solve_beside(X, nuisance)
    if solved is None:
        return None
    change, basis = X @ solved[0], nuisance.basis[: len(X)]
    after = by_row(problem, nuisance.residual[: len(X)] + change - basis @ (basis.T @ change))[row]
    return solved[0], float(after)


def _words(joint: Joint, stated: Array, found: Array, model: str) -> str:
    units = ("N s/m", "N") if joint.prismatic else ("N m s/rad", "N m")
    kinds = ("a damping of", "a dry friction of")
    said = " and ".join(
        f"{kind} {value:g} {unit}" for kind, value, unit in zip(kinds, stated, units, strict=True) if value
    )
    fitted = " and ".join(f"{rounded(max(value, 0.0), 2)} {unit}" for value, unit in zip(found, units, strict=True))
    return (
        f"{joint.name}: {model} states {said}, of which the recordings show far less: {fitted} of viscous and "
        "Coulomb friction fit best"
    )


def _words_of_rotor(joint: Joint, stated: float, found: float, model: str) -> str:
    unit = "kg" if joint.prismatic else "kg m^2"
    return (
        f"{joint.name}: {model} states a rotor inertia of {stated:g} {unit}, of which the recordings show far less: "
        f"{rounded(max(found, 0.0), 2)} {unit} fit best"
    )
