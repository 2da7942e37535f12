"""Bags and logs as public libraries write them, and the table that they hold."""
