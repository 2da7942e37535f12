"""Figures of a run: each estimate's error and standard deviation against the number of experiments."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from drake_cafim.belief import Belief
from drake_cafim.experiment.closed_loop import ExperimentResult, RunResult
from drake_cafim.parameters import Parameter
from drake_cafim.report.colours import CORRECTED, MUTED, NOMINAL
from drake_cafim.report.svg import as_svg, page_style
from drake_cafim.typing import Array

NINETY_FIVE = 1.96
SVG = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


def error_figure(result: RunResult) -> str:
    """SVG: each estimate's error in percent with the belief's 95 % interval; row 0 is the prior."""
    time, mean, std = _beliefs(result)
    candidate = result.candidate
    truth = candidate.model.parameters.vector(candidate.truth)
    sought = _sought(result)
    with page_style():
        figure, row = _panels(result)
        for axes, (index, parameter) in zip(row, sought, strict=True):
            error = 100.0 * (mean[:, index] - truth[index]) / truth[index]
            spread = 100.0 * NINETY_FIVE * std[:, index] / truth[index]
            axes.fill_between(time, error - spread, error + spread, color=CORRECTED, alpha=0.15, linewidth=0)
            axes.plot(time, error, color=CORRECTED, marker="o", markersize=3.5)
            axes.axhline(0.0, color=MUTED, linewidth=0.8)
            largest = np.abs(error).max() + spread[1:].max(initial=1.0)
            axes.set_ylim(-1.15 * largest, 1.15 * largest)
            axes.set_title(f"error of {parameter.name}, %")
            _count(axes, time)
        return _standalone(as_svg(figure, f"Error of the estimate after each experiment, {result.task.name}"))


def information_figure(result: RunResult) -> str:
    """SVG: each parameter's posterior standard deviation, and the one by each experiment's Fisher information alone."""
    time, _, std = _beliefs(result)
    alone = np.array([_alone(result, experiment) for experiment in result.experiments])
    with page_style():
        figure, row = _panels(result)
        for axes, (index, parameter) in zip(row, _sought(result), strict=True):
            unit = "" if parameter.unit == "1" else f", {parameter.unit}"
            axes.plot(
                time, std[:, index], color=CORRECTED, marker="o", markersize=3.5, label="all so far, with the prior"
            )
            if result.task.estimate_every == 0:
                axes.plot(time[1:], alone[:, index], color=NOMINAL, marker="s", markersize=3.5, label="this one alone")
            axes.set_yscale("log")
            axes.set_title(f"standard deviation of {parameter.name}{unit}")
            axes.legend()
            _count(axes, time)
        return _standalone(as_svg(figure, f"Information after each experiment, {result.task.name}"))


def _panels(result: RunResult) -> tuple[Figure, list[Axes]]:
    count = len(_sought(result))
    figure = Figure(figsize=(3.6 * count, 2.6), layout="constrained")
    row = figure.subplots(1, count, squeeze=False)[0]
    for axes in row:
        axes.set_xlabel("experiments" if result.task.estimate_every == 0 else "time, s")
    return figure, list(row)


def _beliefs(result: RunResult) -> tuple[Array, Array, Array]:
    """Times, means and stds: of the prior, then after each experiment; of all updates, in s, if it estimates online.

    Of several contact laws, the beliefs under the one that is the most probable at the end.
    """
    best = result.best
    prior = Belief.prior(result.candidate.model.parameters)
    rows = [(0.0, prior.mean, prior.std)]
    for number, experiment in enumerate(result.experiments):
        if result.task.estimate_every:
            start = number * float(experiment.time[-1])
            then = [(start + time, over_laws.beliefs[best]) for time, over_laws in experiment.history]
            rows += [(time, belief.mean, belief.std) for time, belief in then]
        else:
            belief = experiment.over_laws.beliefs[best]
            rows.append((number + 1.0, belief.mean, belief.std))
    return np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), np.array([r[2] for r in rows])


def _sought(result: RunResult) -> list[tuple[int, Parameter]]:
    """The parameters of the most probable law that are no nuisance, with their indices."""
    free = result.candidate.model.parameters.free
    return [(index, parameter) for index, parameter in enumerate(free) if not parameter.nuisance]


def _alone(result: RunResult, experiment: ExperimentResult) -> Array:
    """√diag(F⁻¹) (n,), by the eigenvalues of F; infinite where F is singular along a parameter.

    NaN after an experiment in which another law was the most probable: there F is that law's.
    """
    if experiment.over_laws.best != result.best:
        return np.full(len(result.candidate.model.parameters.free), np.nan)
    fisher = experiment.fisher
    values, vectors = np.linalg.eigh(fisher)
    inverse = np.where(values > 1e-12 * max(float(values.max()), 1e-300), 1.0 / np.maximum(values, 1e-300), np.inf)
    with np.errstate(invalid="ignore"):
        variance = np.where(vectors**2 > 0, vectors**2 * inverse, 0.0).sum(axis=1)
    return np.asarray(np.sqrt(variance))


def _count(axes: Axes, time: Array) -> None:
    if np.all(time == np.round(time)):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _standalone(svg: str) -> str:
    """The element as a file of its own."""
    return f'<?xml version="1.0" encoding="utf-8"?>\n{svg.replace("<svg", SVG, 1)}\n'
