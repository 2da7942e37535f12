"""ROS34PW2, a Rosenbrock method of order 3 that does not need an exact Jacobian (Rang, Angermann, BIT 45, 2005).

A step of length h from y has four stages kᵢ = (1 − γhJ)⁻¹ (f(y + h Σ αᵢⱼkⱼ) + hJ Σ sᵢⱼkⱼ), and ends at y + h Σ bᵢkᵢ;
the EMBEDDED weights give a solution of lower order for the error estimate. Also limits of the step size.
"""

import numpy as np

GAMMA = 4.3586652150845900e-01
ALPHA = np.array(
    [
        [0.0, 0.0, 0.0],
        [8.7173304301691801e-01, 0.0, 0.0],
        [8.4457060015369423e-01, -1.1299064236484185e-01, 0.0],
        [0.0, 0.0, 1.0],
    ]
)
SHIFT = np.array(
    [
        [0.0, 0.0, 0.0],
        [-8.7173304301691801e-01, 0.0, 0.0],
        [-9.0338057013044082e-01, 5.4180672388095326e-02, 0.0],
        [2.4212380706095346e-01, -1.2232505839045147e00, 5.4526025533510214e-01],
    ]
)
"""sᵢⱼ: row i has the coefficients of stage i for the earlier stages j."""
WEIGHTS = np.array([2.4212380706095346e-01, -1.2232505839045147e00, 1.5452602553351020e00, GAMMA])
EMBEDDED = np.array([3.7810903145819369e-01, -9.6042292212423178e-02, 5.0000000000000000e-01, 2.1793326075422950e-01])
SHARE, CAREFUL = 0.3, 0.1
"""1/s: tolerated error of a step in speed, m/s and rad/s, divided by a sample's noise, m and rad. The second, smaller
one holds for contacts with a memory or a force before touch-down, whose error the estimate underrates."""
LONGEST, SHORTEST = 5e-3, 1e-7
"""s, limits of the step length."""
LANDED = 1e-6
"""m, tolerance of the penetration at which a touch-down is located."""
MOST_STEPS = 20000
"""Largest number of steps."""
