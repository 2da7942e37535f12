"""Kills, full disks, jumping clocks and vanishing folders while commands run; see `table`."""
