"""The contents of a run's replay as plain data: motion, forces, candidate plans, beliefs, camera."""

from dataclasses import dataclass, field

from drake_cafim.typing import Array


@dataclass(frozen=True)
class Motion:
    """The plant's generalized positions (N, nq) at times (N,) s, increasing from 0."""

    time: Array
    positions: Array


@dataclass(frozen=True)
class Forces:
    """Contact forces (N, k, 3) N in W at points (N, k, 3) m in W, at times (N,) s; drawn `scale` m long a newton."""

    time: Array
    points: Array
    forces: Array
    scale: float = 0.1


@dataclass(frozen=True)
class Candidates:
    """The planner's candidates (M, c, h, 3) m in W at planning times (M,) s; `chosen` (M,) is the one executed."""

    time: Array
    paths: Array
    chosen: Array


@dataclass(frozen=True)
class BeliefHistory:
    """The belief over one parameter: means and standard deviations (B,), each from its time (B,) s on."""

    name: str
    unit: str
    time: Array
    mean: Array
    std: Array
    truth: float | None = None


@dataclass(frozen=True)
class Captions:
    """Lines of text above the title, each from its time (C,) s on until the next one's."""

    time: Array
    texts: tuple[str, ...]


@dataclass(frozen=True)
class Camera:
    """Where the eye stands and what it looks at, (3,) m in W."""

    eye: tuple[float, float, float] = (1.5, -1.2, 1.0)
    target: tuple[float, float, float] = (0.3, 0.0, 0.3)
    field_of_view: float = 45.0  # degrees, vertical


@dataclass(frozen=True)
class Replay:
    """A run to be looked at. The belief panels stand side by side from `panel` (3,) m in W on, facing the eye."""

    title: str
    motion: Motion
    forces: Forces | None = None
    candidates: Candidates | None = None
    beliefs: tuple[BeliefHistory, ...] = field(default=())
    captions: Captions | None = None
    camera: Camera = field(default_factory=Camera)
    panel: tuple[float, float, float] = (0.0, 0.6, 0.6)
    panel_width: float = 0.5  # m
    stroke: float = 1.0  # thickness of arrows and plans; 1 suits an arm, less a gripper
