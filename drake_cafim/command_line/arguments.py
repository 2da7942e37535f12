"""Rewrites the arguments of a command line into the form that click reads."""

from itertools import pairwise


def spread_values(arguments: list[str], options: tuple[str, ...]) -> list[str]:
    """The arguments with `--recording A B C` as `--recording A --recording B --recording C`, the form click reads.

    An option without a value goes to the end, where click says what it lacks.
    """
    result: list[str] = []
    bare: list[str] = []
    current: str | None = None
    for argument, following in pairwise([*arguments, "-"]):
        if argument in options:
            current = argument
            if following.startswith("-"):
                bare.append(argument)
        elif argument.startswith("-") or (current == "--conceal" and "=" not in argument and "@" not in argument):
            current = None
            result.append(argument)
        elif current is not None:
            result += [current, argument]
        else:
            result.append(argument)
    return result + bare
