"""Rigid-body quantities of a Drake plant, vectorised over samples."""
