"""Innovations under doubt about unknown parameters: which axes the doubt is taken along does not matter."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.joints.doubts import OFF, doubts
from drake_cafim.diagnosis.predict.innovations import innovations
from drake_cafim.diagnosis.preparation import Prepared, prepare
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
