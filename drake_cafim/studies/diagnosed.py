"""Diagnosis of a run's recordings: the effects that the scenario's model lacks, and its prediction errors with them."""

from typing import Any

from pydrake.systems.framework import Diagram

from drake_cafim.diagnosis.diagnose import diagnose
from drake_cafim.diagnosis.verdict import Quality
from drake_cafim.diagrams.catalogue import joint_names
from drake_cafim.experiment.closed_loop import RunResult
from drake_cafim.experiment.joint_recording import recordings_of
from drake_cafim.experiment.world import World
from drake_cafim.scene.scene import Scene


def diagnose_run(result: RunResult, scenario: str, world: World) -> dict[str, Any]:
    """The verdict on all experiments of `result` but the last, which is held out, as plain values."""
    assert isinstance(world.system, Diagram)
    scene, joints = Scene.load(scenario), joint_names(world.system)
    recordings = recordings_of(result, scene, joints, world)
    verdict = diagnose(scene, recordings[:-1], held_out=recordings[-1:])
    assert verdict.held_out is not None
    return {
        "verdict": verdict.kind,
        "sentence": str(verdict),
        "effects": [
            {
                "effect": accepted.effect.name,
                "at": accepted.effect.at,
                "probability": accepted.probability,
                "values": {name: [value.value, value.std] for name, value in accepted.values.items()},
            }
            for accepted in verdict.explanation
        ],
        "nominal": _quality(verdict.held_out.nominal),
        "corrected": _quality(verdict.held_out.corrected),
    }


def _quality(quality: Quality) -> dict[str, Any]:
    return {"nll": quality.nll, "rmse": dict(quality.rmse)}
