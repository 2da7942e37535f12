"""A simulated fleet with concealed changes, made by MuJoCo, sealed, and diagnosed as a user would."""
