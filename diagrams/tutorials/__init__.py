"""Tutorials, each a short script: `python -m drake_cafim.diagrams.tutorials.<name>`.

- `own_robot`: from one's own URDF and bags to a simulation with the physics that the URDF lacks.
- `own_servo`: a robot that is commanded by position, from tables of commands and positions without any torque.
- `own_effect`: an effect that the catalogue does not have.
- `own_diagram`: one's own plant in a Diagram with the CA-OED and CA-MAP systems.

`why.md` is a page, not a script: how to ask a finished report why it says what it says.
"""
