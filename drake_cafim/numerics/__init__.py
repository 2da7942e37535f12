"""Numerical tools that do not depend on robot models."""
