"""What became of one input: a result, a refusal in one sentence, or a fault."""

import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from drake_cafim.errors import InputError

PACKAGE = str(Path(__file__).resolve().parents[2])
RESULT, REFUSED = "result", "refused"
LONGEST = 500


def judge(action: Callable[[], object], names: Sequence[str]) -> str:
    """`result`, `refused`, or the fault in a line; a refusal names one of `names`, in one line of fewer characters."""
    try:
        action()
    except InputError as error:
        return judge_message(str(error), names)
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        return f"traceback: {type(error).__name__}: {' '.join(str(error).split())[:80]} at {_place(error)}"
    return RESULT


def judge_message(text: str, names: Sequence[str]) -> str:
    """`refused`, or what is wrong with the message."""
    if "\n" in text or len(text) >= LONGEST:
        return f"message of {len(text)} characters, {text.count(chr(10)) + 1} lines: {text[:60]}"
    if "takes longer than" in text:
        return f"hang: {text[:100]}"
    if names and not any(name in text for name in names):
        return f"message without the file's name: {text[:100]}"
    return REFUSED


def _place(error: BaseException) -> str:
    """The innermost line of the package, or else of any module, that the exception went through."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/drake_cafim/" in frame.filename] or frames[-1:]
    return f"{own[-1].filename.rpartition('/drake_cafim/')[2]}:{own[-1].lineno}" if own else "?"
