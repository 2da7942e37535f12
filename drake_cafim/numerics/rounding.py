"""Formatting of numbers and lists in sentences and on pages of reports."""

from collections.abc import Sequence

import numpy as np

THIN_SPACE = "\u202f"
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def rounded(value: float, digits: int = 3) -> str:
    """The value as text with `digits` significant digits: 0.0123, 101 000 or, outside 10⁻⁴ … 10⁶, 1.10 × 10⁶; or ∞."""
    if np.isinf(value):
        return "∞" if value > 0.0 else "−∞"
    if value == 0.0 or np.isnan(value):
        return "0" if value == 0.0 else "nan"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    magnitude = int(exponent)  # after rounding: 99.96 becomes 100, whose magnitude is 2
    if -4 <= magnitude < 6:
        text = f"{float(f'{mantissa}e{exponent}'):.{max(digits - 1 - magnitude, 0)}f}"
        return grouped(text).replace("-", "−")
    return f"{mantissa} × 10{str(magnitude).translate(SUPERSCRIPT)}".replace("-", "−")


def short(value: float, digits: int = 4) -> str:
    """The same text as `rounded` gives, without trailing zeros after the decimal point."""
    number, cross, power = rounded(value, digits).partition(" × ")
    return (number.rstrip("0").rstrip(".") if "." in number else number) + cross + power


def grouped(text: str) -> str:
    """The decimal number `text` with the digits before the point in groups of three, if there are more than four."""
    whole, point, rest = text.partition(".")
    return (f"{int(whole):,}".replace(",", THIN_SPACE) if len(whole.lstrip("-")) > 4 else whole) + point + rest


def listed(names: Sequence[str]) -> str:
    """Such as "a, b and c"."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
