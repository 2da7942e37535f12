"""Stretches of time in which a recording differs from a model."""


def united(intervals: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """The intervals in order, those that touch made one."""
    united: list[tuple[float, float]] = []
    for start, stop in sorted(intervals):
        if united and start <= united[-1][1] + 1e-9:
            united[-1] = (united[-1][0], max(stop, united[-1][1]))
        else:
            united.append((start, stop))
    return tuple(united)
