"""Carries out many independent tasks on processes of this machine or on a Dask cluster."""
