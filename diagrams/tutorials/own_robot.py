"""From your own URDF and bags to a simulation with the physics that the URDF lacks.

    python -m drake_cafim.diagrams.tutorials.stand_in robot
    python -m drake_cafim.diagrams.tutorials.own_robot robot/arm.urdf robot/run_1.mcap robot/run_2.mcap robot/run_3.mcap

The first line makes files to try it on; put yours in their place. The last bag is held out: nothing is fitted to it.
"""

import sys

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from drake_cafim import Scene, diagnose, read

if len(sys.argv) < 4:
    sys.exit(__doc__)
model, *bags, last = sys.argv[1:]
scene = Scene.from_model(model, channels={"q": 2e-4, "v": 2e-3, "u": 0.0}, weld=["base"])  # noise of one sample, SI
held_out = read(last)
verdict = diagnose(scene, [read(bag) for bag in bags], held_out=[held_out])
print(verdict)

for name, variant in (("the URDF alone", scene), ("with what it lacks", verdict.corrected)):
    builder = DiagramBuilder()
    robot = variant.add_to(builder)  # a plant with its physics around it; a controller connects to `robot.effort`
    effort = PiecewisePolynomial.ZeroOrderHold(held_out.time, held_out.matrix("u", robot.joints).T)
    builder.Connect(builder.AddSystem(TrajectorySource(effort)).get_output_port(), robot.effort)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = robot.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    robot.plant.SetPositions(context, held_out.matrix("q", robot.joints)[0])
    simulator.AdvanceTo(1.0)
    error = robot.plant.GetPositions(context) - held_out.window(1.0, 2.0).matrix("q", robot.joints)[0]
    print(f"{name}: after 1 s off by {abs(error).max():.4f} rad")
