"""A task's result as plain data: its value, or why there is none."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drake_cafim.errors import InputError
from drake_cafim.interruption import pass_on_interruption

Function = Callable[..., Any]
Arguments = tuple[Any, ...]

ATTEMPTS = 3
"""How often a task is started whose process dies; after that it counts as one that kills every process."""


@dataclass(frozen=True)
class Task:
    """`function(*arguments)`, both of which can be pickled; `name` is what messages call it.

    It may be carried out again if a process or a scheduler dies, so it has to give the same files and value each time.
    """

    name: str
    function: Function
    arguments: Arguments


@dataclass(frozen=True)
class Result:
    """The outcome of task number `index`: its `value`, or `failure`, one sentence that says why there is none.

    `defect` says that the failure is neither unusable input nor a file that cannot be written, nor a process that died.
    """

    index: int
    value: Any = None
    failure: str = ""
    defect: bool = False

    def require(self) -> Any:
        """The value. Raises `InputError` with the failure where there is none."""
        if self.failure:
            raise InputError(self.failure)
        return self.value


def carry_out(index: int, task: Task) -> Result:
    """The result of the task in this process; an exception is a failure and does not leave the function."""
    try:
        return Result(index, task.function(*task.arguments))
    except Exception as error:
        pass_on_interruption()
        return _failure(index, task, error)


def _failure(index: int, task: Task, error: Exception) -> Result:
    if isinstance(error, InputError):
        return Result(index, failure=str(error))
    if isinstance(error, OSError):
        return Result(index, failure=f"{task.name}: {error.filename or 'a file'}: {error.strerror or error}")
    if isinstance(error, MemoryError):
        return Result(index, failure=f"{task.name}: there is not enough memory")
    words = " ".join(str(error).split())
    return Result(index, failure=f"{task.name}: {type(error).__name__}: {words}", defect=True)


def died(index: int, task: Task, attempts: int = ATTEMPTS) -> Result:
    """The result of a task whose process died at every one of the `attempts`."""
    return Result(index, failure=f"{task.name}: its process died in each of {attempts} attempts")
