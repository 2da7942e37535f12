"""How many samples of a robot a diagnosis may hold at once, by the width of the data and the memory it may take."""

from dataclasses import dataclass

from drake_cafim.recordings.recording import WRENCH_COMPONENTS
from drake_cafim.scene.scene import Scene

GIB = 2**30
DEFAULT_MEMORY = 4 * GIB
"""bytes that a diagnosis may take unless it is told otherwise."""
BYTES_BY_PAIR, BYTES_BY_COLUMN = 530.0, 1500.0
"""bytes of a sample by each pair of measured columns (the rows' derivatives by the noise of each) and by each column:
a search that finds an effect takes 85 kB a sample of seven joints at 1 kHz, one of several effects up to 140."""
FIRST_SECONDS = 60.0
"""s of the recordings about which something is said first, where they fit."""
SEARCHED_SHARE, PART_SHARE = 0.5, 1.0 / 8.0
"""Shares of the memory for the parts that are searched, where whatever is missing takes more, and for one part."""
FEWEST_ROWS = 2000
"""Samples of the smallest part, however little memory there is: of fewer the slow effects say too little."""


@dataclass(frozen=True)
class Budget:
    """The memory of a diagnosis of one robot, `memory` bytes, of which each sample takes `sample`."""

    memory: float
    sample: float

    @classmethod
    def of(cls, scene: Scene, memory: float = DEFAULT_MEMORY) -> "Budget":
        """The budget for recordings of `scene`: positions and velocities of its joints, and its wrench sensors."""
        columns = 2 * len(scene.tree.joint_names) + len(WRENCH_COMPONENTS) * len(scene.wrench_sensors)
        return cls(memory, BYTES_BY_PAIR * columns**2 + BYTES_BY_COLUMN * columns)

    @property
    def rows(self) -> int:
        """The samples that are diagnosed at once, as they are."""
        return int(self.memory / self.sample)

    @property
    def part(self) -> int:
        """The samples of a part."""
        return max(FEWEST_ROWS, int(PART_SHARE * self.memory / self.sample))

    def most(self, rows: int) -> int:
        """How many parts of that many samples are searched, at least two."""
        return max(2, round(SEARCHED_SHARE * self.memory / self.sample / rows))
