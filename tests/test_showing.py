"""From a run in a Diagram to its replay: the same motion again, plans and beliefs in their places."""

import numpy as np
import pytest
from pydrake.systems.framework import Diagram

from drake_cafim.diagrams import hefting
from drake_cafim.diagrams.showing import execute, make_replay
from drake_cafim.diagrams.world import start_context
from drake_cafim.experiment import closed_loop as experiment
from drake_cafim.experiment.closed_loop import Options, RunResult
from drake_cafim.experiment.world import World
from drake_cafim.tasks.hefting import hefting as hefting_task

SEED = 4


def make_diagram() -> Diagram:
    return hefting.build_world(hefting.load_config(), hefting_task().truth, "model", seed=SEED)


@pytest.fixture(scope="module")
def result() -> RunResult:
    diagram = make_diagram()
    world = World("model", diagram, lambda number: start_context(diagram, number))
    return experiment.run(hefting_task(), Options(seed=SEED, experiments=2), world)


@pytest.mark.long
def test_running_the_commands_again_gives_the_same_motion(result: RunResult) -> None:
    diagram, first = make_diagram(), result.experiments[0]
    again = execute(diagram, start_context(diagram, 0), first.commands, 0.05)
    per_command = len(again.time) // len(first.commands)
    # what the first run logged at a command's time is what it had before that command
    np.testing.assert_allclose(again.tool[::per_command, 0], first.robot_states[:-1, 0], atol=2e-3)


@pytest.mark.long
def test_replay_holds_the_run(result: RunResult) -> None:
    diagram = make_diagram()
    config = hefting.load_config()
    view = hefting.view(config)
    replay = make_replay(result, diagram, lambda number: start_context(diagram, number), view, experiments=[1])
    assert np.all(np.diff(replay.motion.time) > 0)
    (belief,) = replay.beliefs
    assert belief.truth == 0.05
    np.testing.assert_allclose(belief.mean, [result.experiments[0].belief.mean[0], result.belief.mean[0]])
    assert belief.std[-1] < belief.std[0]
    assert replay.candidates is not None and replay.forces is not None
    assert len(replay.candidates.time) == 60
    # every plan starts at the palm, whose height the planner read
    heights = replay.candidates.paths[:, :, 0, 2]
    expected = result.experiments[1].robot_states[:60, :1]
    np.testing.assert_allclose(heights, np.broadcast_to(expected, heights.shape), atol=1e-12)
    assert replay.forces.forces[..., 2].max() > 0.4
    np.testing.assert_allclose(replay.forces.forces[..., :2], 0.0)
