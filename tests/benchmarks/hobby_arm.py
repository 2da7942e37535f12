"""`python -m tests.benchmarks.hobby_arm DATA`: a second's prediction of a real hobby arm from its commands.

DATA is the folder of the sets. Six of the eight recordings of `so101` are searched by simulations, with kp and kv of
all five servos unknown (priors of 50 %), and the two of `--held-out` are simulated in windows of a second, by the model
with its servos' unknowns fitted and nothing else, and with what was found. Printed: the root mean square error of each
joint on these, mrad, and what was found. It takes a quarter of an hour.
"""

import argparse
import tempfile
import time
from pathlib import Path

from drake_cafim import recordings
from drake_cafim.diagnosis.output_error.errors import OutputErrors, servos_with_unknowns
from drake_cafim.diagnosis.output_error.problem import OutputErrorProblem
from drake_cafim.diagnosis.output_error.search import Search
from drake_cafim.diagnosis.output_error.velocities import find_velocity_effects
from drake_cafim.diagnosis.predict.forecast import forecasts, root_mean_square
from drake_cafim.diagnosis.preparation import Prepared, prepare
from drake_cafim.diagnosis.trace import Trace
from drake_cafim.scene.scene import Scene

HELD_OUT = ("multisine", "chirp_sweep")


def scene_of(folder: Path, scratch: Path, acceleration: float | None = None) -> Scene:
    """The set's scenario with the servos' stiffness and damping unknown to a half.

    With an `acceleration`, rad/s², all servos are stated to bound that of the command that they follow.
    """
    text = (folder / "scenario.yaml").read_text(encoding="utf-8").replace("so101.urdf", str(folder / "so101.urdf"))
    stated = Scene.load(folder / "scenario.yaml").physics.servos
    text += "unknown:\n" + "".join(
        f"  - {{parameter: {name}, joint: {servo.joint}, std: {0.5 * value}}}\n"
        for servo in stated
        for name, value in (("servo_stiffness", servo.stiffness), ("servo_damping", servo.damping))
    )
    if acceleration is not None:
        text += "effects:\n" + "".join(
            f"  - {{effect: command_acceleration_limit, at: {servo.joint}, acceleration: {acceleration}}}\n"
            for servo in stated
        )
    path = scratch / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    return Scene.load(path)


def main() -> None:
    """The table, a row for each model."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--held-out", nargs="+", default=HELD_OUT, metavar="NAME", help="multisine chirp_sweep")
    parser.add_argument("--acceleration", type=float, help="rad/s², stated as the bound of all servos' firmware")
    arguments = parser.parse_args()
    folder = arguments.data.resolve() / "so101"
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        scene = scene_of(folder, Path(scratch), arguments.acceleration)
    files = sorted((folder / "runs").glob("*.parquet"))
    own, others = (
        [recordings.read(file) for file in files if (file.stem in arguments.held_out) == held_out]
        for held_out in (False, True)
    )
    prepared = prepare(scene, own, others)
    assert isinstance(prepared, Prepared)
    joints = servos_with_unknowns(prepared.scene, prepared.weak)
    problem = OutputErrorProblem(prepared.scene, OutputErrors(tuple(prepared.weak), joints), jobs=-1)
    velocities = find_velocity_effects(prepared.scene, problem.errors.forms, joints, Trace(), print)
    found = Search(problem, Trace(), print, velocities).run()
    print("| model | " + " | ".join(joints) + " |\n|---|" + "---|" * len(joints))
    for name, fitted in (("servos fitted alone", found.alone), ("with what was found", found.fitted)):
        errors = root_mean_square(forecasts(prepared.held_out, fitted.model.physics(prepared.scene)))
        print(f"| {name} | " + " | ".join(f"{1e3 * errors[f'q.{joint}']:.1f}" for joint in joints) + " |")
    for effect in found.fitted.model.effects:
        std = ", ".join(f"{deviation:.2g}" for deviation in found.uncertainty.strengths[effect.key])
        print(f"{effect.sentence(prepared.scene.tree)} ± {std}, p {found.probability.get(effect.key, 1.0):.2g}")
    print(f"{time.monotonic() - began:.0f} s, {problem.errors.windows} windows")


if __name__ == "__main__":
    main()
