"""The levels of a diagnosis's tests, as options of `cafim diagnose`."""

from dataclasses import asdict, dataclass

from drake_cafim.diagnosis.search.state import Settings


@dataclass(frozen=True)
class Levels:
    """The options of the command that are levels of tests; None for the usual one. Checked as soon as they are given.

    Raises `InputError` for one that is not between 0 and 1.
    """

    false_alarm_rate: float | None = None
    adequacy_level: float | None = None

    def __post_init__(self) -> None:
        self.settings()

    @property
    def given(self) -> dict[str, float]:
        """Those that are not the usual ones, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    @property
    def words(self) -> list[str]:
        """Those that are not the usual ones, as on the command line."""
        return [f"--{name.replace('_', '-')}={value:g}" for name, value in self.given.items()]

    def settings(self) -> Settings:
        """The options of the search with these levels."""
        return Settings(**self.given)  # type: ignore[arg-type]


USUAL = Levels()
