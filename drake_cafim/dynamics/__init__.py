"""Rigid-body kinematics and dynamics of a Drake plant, vectorised over samples."""
