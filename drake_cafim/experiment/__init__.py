"""The closed loop of planning, execution and estimation (Algorithm 1 of the paper), and the worlds it runs in."""
