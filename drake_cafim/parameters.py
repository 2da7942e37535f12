"""Named, bounded parameters with Gaussian priors, and conversion to and from a vector."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from drake_cafim.errors import InputError
from drake_cafim.typing import Array


@dataclass(frozen=True)
class Parameter:
    """A scalar parameter with a Gaussian prior, truncated at physical bounds.

    `mean` and `std` are in `unit`; `std` may be infinite (no prior). A `frozen` parameter keeps its mean.
    """

    name: str
    mean: float
    std: float = np.inf
    lower: float = -np.inf
    upper: float = np.inf
    unit: str = "1"
    frozen: bool = False
    nuisance: bool = False  # learned since the measurements depend on it, but not what an experiment is for

    def __post_init__(self) -> None:
        if not self.std > 0:
            raise InputError(f"parameter {self.name}: std is {self.std}, expected a positive number")
        if not self.lower <= self.mean <= self.upper:
            raise InputError(
                f"parameter {self.name}: mean {self.mean} lies outside its bounds [{self.lower}, {self.upper}]"
            )


@dataclass(frozen=True)
class Parameters:
    """An ordered set of parameters; vectors hold the free (not frozen) ones, in this order."""

    items: tuple[Parameter, ...] = field(default=())

    def __post_init__(self) -> None:
        names = [parameter.name for parameter in self.items]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise InputError(f"parameters named twice: {', '.join(repeated)}")

    @classmethod
    def of(cls, items: Iterable[Parameter]) -> "Parameters":
        """The set of `items`, in their order."""
        return cls(tuple(items))

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.items)

    def __len__(self) -> int:
        return len(self.items)

    @cached_property
    def free(self) -> tuple[Parameter, ...]:
        """The parameters that are not frozen."""
        return tuple(parameter for parameter in self.items if not parameter.frozen)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, the order of every vector."""
        return tuple(parameter.name for parameter in self.free)

    @property
    def mean(self) -> Array:
        """Prior means of the free parameters, shape (n,)."""
        return np.array([parameter.mean for parameter in self.free], dtype=float)

    @property
    def std(self) -> Array:
        """Prior standard deviations of the free parameters, shape (n,)."""
        return np.array([parameter.std for parameter in self.free], dtype=float)

    @property
    def sought(self) -> Array:
        """Which of the free parameters are no nuisance, (n,) bool."""
        return np.array([not parameter.nuisance for parameter in self.free], dtype=bool)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the free parameters, each of shape (n,)."""
        return (
            np.array([parameter.lower for parameter in self.free], dtype=float),
            np.array([parameter.upper for parameter in self.free], dtype=float),
        )

    def values(self, vector: Array) -> dict[str, float]:
        """Name to value for all parameters: `vector` (n,) for the free ones, the mean for the frozen."""
        vector = np.asarray(vector, dtype=float)
        if vector.shape != (len(self.free),):
            raise ValueError(f"expected a vector of shape ({len(self.free)},), got {vector.shape}")
        free = dict(zip(self.names, vector.tolist(), strict=True))
        return {parameter.name: free.get(parameter.name, parameter.mean) for parameter in self.items}

    def vector(self, values: Mapping[str, float]) -> Array:
        """The vector (n,) of the free parameters; those missing in `values` have their prior mean."""
        unknown = sorted(set(values) - {parameter.name for parameter in self.items})
        if unknown:
            valid = ", ".join(parameter.name for parameter in self.items)
            raise InputError(f"no parameter named {', '.join(unknown)}; there are: {valid}")
        return np.array([values.get(p.name, p.mean) for p in self.free], dtype=float)

    def clip(self, vector: Array) -> Array:
        """`vector` (..., n) clipped to the bounds."""
        lower, upper = self.bounds
        return np.asarray(np.clip(vector, lower, upper), dtype=float)
