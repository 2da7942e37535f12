"""The covariance of the equations' residuals, and the transformation to independent rows of unit variance."""
