"""The closed loop of planning, touching and estimating, and the worlds that it runs in."""
