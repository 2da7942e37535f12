"""`python -m tests.concealed.moved_diagnosis [NAME FACTOR] diagnose ...`: `cafim` with one threshold times a factor.

Modules take thresholds by name when they are imported, so that one is moved before anything else is.
"""

from __future__ import annotations

import sys

from drake_cafim.diagnosis import thresholds

Value = float | int | tuple[float, ...]


def moved(value: Value, factor: float) -> Value:
    """The value times the factor; a whole number stays one, and is moved by one at least."""
    if isinstance(value, tuple):
        return tuple(factor * part for part in value)
    if isinstance(value, int):
        nearest = round(factor * value)
        return nearest if nearest != value else value + (1 if factor > 1.0 else -1)
    return factor * value


def move(name: str, factor: float) -> None:
    """Moves a threshold of this process."""
    setattr(thresholds, name, moved(getattr(thresholds, name), factor))


def main() -> int:
    arguments = sys.argv[1:]
    if arguments[0] in vars(thresholds):
        name, factor, *arguments = arguments
        move(name, float(factor))
    sys.argv = ["cafim", *arguments]
    from drake_cafim.cli import run_cli

    run_cli()
    return 0


if __name__ == "__main__":
    sys.exit(main())
