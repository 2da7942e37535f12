"""Joints whose servos have unknown parameters: what they lack, by the errors of simulations from their commands."""
