"""CA-MAP, contact-aware maximum a posteriori estimation of the parameters, with their covariance."""
