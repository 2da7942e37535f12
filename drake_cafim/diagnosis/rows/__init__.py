"""Rows of residuals from one recording: the equations of motion, integrated against test functions (weak form)."""
