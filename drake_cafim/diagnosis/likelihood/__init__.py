"""The likelihood of whole recordings: trajectories, information and estimates by a Kalman smoother of the model."""
