"""Innovations under doubt about unknown parameters: its axes do not matter, nor that its physics go together."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.doubts import OFF, doubts
from drake_cafim.diagnosis.predict.innovations import innovations
from drake_cafim.diagnosis.predict.stepper import State, advance, advance_each
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.effects.catalogue import effect_named
from tests import two_links

UNKNOWN = "unknown: [{parameter: inertials, body: lower, std: 0.2}]"


def test_innovations_do_not_depend_on_the_axes_of_the_doubt(tmp_path: Path) -> None:
    scene = two_links.scene(tmp_path, unknown=UNKNOWN)
    prepared = prepare(scene, [two_links.recording("run", 1, duration=0.6)])
    assert isinstance(prepared, Prepared)
    scene, forms = prepared.scene, prepared.weak
    priors, model = scene.priors, Model(scene.priors.mean)
    physics, count = model.physics(scene), len(priors.std)
    [found] = innovations(forms, physics, doubts(scene, model, np.diag(priors.std**2)), OFF)
    axes, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(count, count)))
    turned = [replace(model, unknown=priors.mean + change).physics(scene) for change in OFF * axes * priors.std]
    assert found.mean == pytest.approx(innovations(forms, physics, turned, OFF)[0].mean, abs=0.02)
    assert abs(innovations(forms, physics)[0].mean - found.mean) > 0.1, "the doubt is felt"


@pytest.mark.parametrize("dry", [False, True])
def test_physics_that_share_laws_are_carried_on_together_as_each_alone(tmp_path: Path, dry: bool) -> None:
    """Inertials differ, and with `dry` a friction does; some joints turn round within the step."""
    scene = two_links.scene(tmp_path, unknown=UNKNOWN)
    laws = [
        effect_named("joint_asymmetric_coulomb_friction")(
            "elbow", {"torque_positive": 0.3, "torque_negative": 0.2, "slip_velocity": 0.01, "slip": 0.002}
        ),
        effect_named("joint_viscous_friction")("shoulder", {"coefficient": 0.1}),
    ]
    model, priors = Model(scene.priors.mean).with_effects(laws), scene.priors
    each = doubts(scene, model, np.diag(priors.std**2))
    assert len({id(physics.joint_forces[0]) for physics in each}) == 1
    if dry:
        changed = [
            law.with_values({**law.values, "torque_positive": 0.3 + 0.1 * k}) for k, law in enumerate(laws[:1] * 3)
        ]
        each = [
            replace(physics, joint_forces=(law, physics.joint_forces[1]))
            for physics, law in zip(each, changed, strict=False)
        ]
    rng = np.random.default_rng(2)
    start = State(rng.normal(size=(9, 2)), 0.01 * rng.normal(size=(9, 2)), rng.uniform(-1.0, 1.0, size=(9, 1)))
    effort, duration = rng.normal(size=(9, 2)), np.full(9, 0.005)
    for physics, found in zip(each, advance_each(each, start, effort, duration), strict=True):
        alone = advance(physics, start, effort, duration)
        for name in ("q", "v", "memory"):
            np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-12, atol=1e-12)
