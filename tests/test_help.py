"""The text of help() of the public names: enough to use them, with the ports of systems."""

import dataclasses
import inspect
import re

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem

import drake_cafim
from drake_cafim import testing
from drake_cafim.design.guard_system import ForceGuard
from drake_cafim.design.policies import make_policy
from drake_cafim.design.system import CaOed
from drake_cafim.diagrams.tutorials.own_diagram import make_model
from drake_cafim.estimation.system import CaMap

PUBLIC = [*(getattr(drake_cafim, name) for name in drake_cafim.__all__), testing.assert_explained, CaOed, CaMap]


@pytest.mark.parametrize("thing", PUBLIC, ids=lambda thing: thing.__name__)
def test_all_that_is_public_is_described(thing: type) -> None:
    said = inspect.getdoc(thing) or ""
    assert said.count(" ") > 10 and said.split("\n")[0].endswith(".")
    assert "InputError" in said or inspect.isclass(thing)
    if dataclasses.is_dataclass(thing):
        for field in dataclasses.fields(thing):
            assert f"`{field.name}`" in said, f"{thing.__name__} does not say what {field.name} is"
    for name, member in vars(thing).items():
        function = getattr(member, "__func__", member)
        if not name.startswith("_") and (inspect.isfunction(function) or isinstance(member, property)):
            assert inspect.getdoc(function), f"{thing.__name__}.{name} is not described"


@pytest.mark.parametrize("name", drake_cafim.__all__)
def test_every_argument_of_a_function_is_spoken_of(name: str) -> None:
    thing = getattr(drake_cafim, name)
    if inspect.isfunction(thing):
        for argument in inspect.signature(thing).parameters:
            assert argument.removesuffix("s") in (inspect.getdoc(thing) or ""), argument


@pytest.mark.parametrize("system", [CaOed, CaMap])
def test_every_argument_of_a_system_is_spoken_of(system: type) -> None:
    for argument in list(inspect.signature(system.__init__).parameters)[1:]:
        assert f"`{argument}`" in (inspect.getdoc(system) or ""), argument


def test_ports_are_as_described() -> None:
    model = make_model()
    policy = make_policy("contact-aware", model)
    for system in (CaOed(model, policy), CaMap(model, periods=3, experiments=1), ForceGuard(model, 10.0)):
        assert described(system) == ports(system)
    assert described(CaOed(model, policy), optional=True) == ports(CaOed(model, policy, force_hypotheses=4))


def test_the_ports_have_the_described_sizes() -> None:
    model = make_model()
    design = CaOed(model, make_policy("contact-aware", model))
    n, nu = len(model.parameters.names), len(model.velocity_bounds[0])
    assert design.GetInputPort("belief").size() == n + n**2 and design.GetOutputPort("command").size() == nu
    assert design.GetOutputPort("information").size() == n**2
    estimator = CaMap(model, periods=3, experiments=1)
    assert estimator.GetInputPort("measured_force").size() == len(np.asarray(model.noise_std))


def described(system: LeafSystem, *, optional: bool = False) -> tuple[list[str], list[str]]:
    """Input and output ports of the system's `.. pydrake_system::` block; with the optional ones, if asked for."""
    said = inspect.getdoc(type(system)) or ""
    assert f".. pydrake_system::\n\n    name: {type(system).__name__}" in said
    found = [re.search(rf"{kind}_ports: \[(.*?)\]", said) for kind in ("input", "output")]
    listed = [[port.strip() for port in match[1].split(",")] for match in found if match]
    mark = " (optional)"
    kept = [[port.removesuffix(mark) for port in ports if optional or not port.endswith(mark)] for ports in listed]
    return tuple(kept)  # type: ignore[return-value]


def ports(system: LeafSystem) -> tuple[list[str], list[str]]:
    inputs = [system.get_input_port(k).get_name() for k in range(system.num_input_ports())]
    return inputs, [system.get_output_port(k).get_name() for k in range(system.num_output_ports())]
