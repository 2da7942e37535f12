"""Sensitivities dy/dθ of predicted measurements: by analytic tangents, AutoDiffXd, and finite differences."""
