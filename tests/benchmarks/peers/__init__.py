"""`cafim estimate` and `mujoco.sysid` on the same recordings."""
