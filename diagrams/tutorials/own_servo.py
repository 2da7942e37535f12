"""From a URDF, tables of commands and positions, and a guess of kp and kv to a corrected simulation. No torque needed.

    python -m drake_cafim.diagrams.tutorials.stand_in_servo robot
    python -m drake_cafim.diagrams.tutorials.own_servo robot/arm.urdf robot/run_1.csv robot/run_2.csv robot/run_3.csv

The first line makes files to try it on; put yours in their place: `time`, `q.<joint>`, `cmd.<joint>`. The last table is
held out. What to record, so that the rest can be told apart: slow and fast motions that reverse often, poses in
which gravity pulls differently at each joint (it fixes the scale of kp) and, where the servos can be switched off, free
swings with `u` = 0 instead of `cmd`. Once a report exists, `cafim discriminate SCENARIO REPORT` designs the motion that
tells its rivals apart, as commands.
"""

import sys
from pathlib import Path

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_cafim import Scene, diagnose, read

if len(sys.argv) < 4:
    sys.exit(__doc__)
model, *tables, last = sys.argv[1:]
held_out, guess = read(last), {"servo_stiffness": (40.0, 20.0), "servo_damping": (3.0, 1.5)}  # mean, std: 50 %
joints = held_out.joints("cmd")
text = f"model: {Path(model).name}\nweld: [{{body: base}}]\nservo: {{kp: 40.0, kv: 3.0}}\nunknown:\n"
for joint in joints:
    for name, (mean, std) in guess.items():
        text += f"- {{parameter: {name}, joint: {joint}, mean: {mean}, std: {std}}}\n"
scenario = Path(model).with_name("scenario.yaml")
scenario.write_text(text)
scene = Scene.load(scenario)
verdict = diagnose(scene, [read(table) for table in tables], held_out=[held_out])
print(verdict)
for known in verdict.parameters:
    print(f"{known.parameter} of {known.at}: {known.value:.3g} ± {known.std:.2g} {known.unit}")
for name, variant in (("the guess alone", scene), ("with what it lacks", verdict.corrected)):
    builder = DiagramBuilder()
    robot = variant.add_to(builder)  # its servos take the commands at `robot.servo["command"]`
    command = PiecewisePolynomial.ZeroOrderHold(held_out.time, held_out.matrix("cmd", robot.joints).T)
    builder.Connect(builder.AddSystem(TrajectorySource(command)).get_output_port(), robot.servo["command"])
    simulator = Simulator(builder.Build())
    context = robot.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    robot.plant.SetPositions(context, held_out.matrix("q", robot.joints)[0])
    simulator.AdvanceTo(4.0)
    error = robot.plant.GetPositions(context) - held_out.window(4.0, 5.0).matrix("q", robot.joints)[0]
    print(f"{name}: after 4 s off by {abs(error).max():.4f} rad")
