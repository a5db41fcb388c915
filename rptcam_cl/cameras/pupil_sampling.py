"""A sampling of the pupil as the camera's kernel reads it: kind and facts, a few numbers and a table."""

from __future__ import annotations

from dataclasses import field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import PupilKind
from rptcam_cl.optics import DIRECTIONS


class PupilCircle(NamedTuple):
    """One circle: how far its centre moves per mm of the film point, and its radius [mm]."""

    shift: float
    radius: float


class PupilGrid(NamedTuple):
    """Boxes of the film's cells, or outlines along a film radius: how many there are per mm, and how many in all."""

    per_mm_across: float
    per_mm_down: float
    across: float
    down: float


class PupilLines(NamedTuple):
    """Outlines along lines from the axis outwards: lines in a quarter of a turn, nodes of each, and lines in all."""

    per_quarter: float
    nodes: float
    lines: float


@dataclass(frozen=True)
class PupilSampling:
    """What `kernels/lens/pupil.h` reads: kind and facts, a few numbers and a table."""

    tier: str
    kind: PupilKind
    parameters: PupilCircle | PupilGrid | PupilLines
    table: NDArray[np.float32] = field(default_factory=lambda: np.zeros(1, np.float32))
    instead_of: str = ""  # the requested tier, where its tables would lose light
    widened: float = 1.0  # factor on the paraxial pupil of the thick tier, without which it would lose light

    def facts_but_table(self) -> dict[str, Any]:
        """Return all but the table, as JSON holds it; see `of_facts`."""
        facts = {name: value for name, value in vars(self).items() if name != "table"}
        return facts | {"kind": int(self.kind), "parameters": [float(value) for value in self.parameters]}

    @classmethod
    def of_facts(cls, facts: dict[str, Any], table: NDArray[np.float32]) -> PupilSampling:
        """Return the sampling of a table and of what `facts_but_table` returned."""
        numbers = facts["parameters"]
        parameters = next(each for each in (PupilCircle, PupilGrid, PupilLines) if len(each._fields) == len(numbers))
        made = parameters(*numbers)
        return cls(**facts | {"kind": PupilKind(facts["kind"]), "parameters": made}, table=table)

    @property
    def radial(self) -> bool:
        """Whether outlines along one film radius stand for all."""
        return self.kind == PupilKind.OUTLINES and isinstance(self.parameters, PupilGrid)

    @property
    def member(self) -> str:
        """Which member of the record ``Pupil`` the parameters are."""
        return {PupilCircle: "circle", PupilGrid: "grid", PupilLines: "lines"}[type(self.parameters)]

    @property
    def metadata(self) -> dict[str, str | float]:
        """What the picture's metadata should say."""
        said: dict[str, str | float] = {"pupil": self.tier}
        if self.instead_of:
            said["pupil_instead_of"] = f"{self.instead_of}: the pupil has parts that its tables do not hold"
        return said | ({"pupil_widened": self.widened} if self.widened > 1.0 else {})

    @property
    def facts(self) -> dict[str, int]:
        """Facts for the compilation."""
        return {"PUPIL_KIND": int(self.kind), "PUPIL_RADIAL": int(self.radial), "PUPIL_DIRECTIONS": DIRECTIONS}
