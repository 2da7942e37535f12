"""Writes a scene's values back into the model file that they came from, and checks the file by simulation."""
