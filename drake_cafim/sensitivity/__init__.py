"""Sensitivity of predicted measurements to the unknown parameters: one question, three answers."""
