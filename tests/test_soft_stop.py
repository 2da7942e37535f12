"""A soft `joint_hard_stop` is named only where it leaves noise alone, not as a substitute for another law."""

from pathlib import Path

import numpy as np

from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.effects.joint import JointViscousFriction
from drake_cafim.effects.transmission import JointHardStop
from tests.concealed.make import make
from tests.concealed_case import written


def test_a_soft_stop_is_one_where_only_noise_is_left(tmp_path: Path) -> None:
    """At its deepest this one pushes back with a twentieth of the effort."""
    case = make("single:joint_hard_stop", "arm2", 6)
    scene, read = written(case, tmp_path)
    prepared = prepare(scene, read)
    assert isinstance(prepared, Prepared)
    problem, [truth] = prepared.problem(), case.truth["effects"]
    stop = JointHardStop(truth["at"], {name: value for name, (value, _) in truth["parameters"].items()})
    known = case.truth["nominal_parameters_true"]
    unknown = np.array([known[f"{parameter.parameter}.{parameter.at}"] for parameter in scene.unknown])
    assert problem.plausible(Model(unknown, (stop,)))
    wrong = JointViscousFriction(truth["at"], {"coefficient": 1.0})
    assert not problem.plausible(Model(unknown, (stop, wrong)))
