"""Robots that touch things learn what they are made of, and name the physics their model left out."""
