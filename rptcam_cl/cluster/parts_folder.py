"""The folder of a render on a cluster: its plan, and the parts that have come back; a later run goes on from it."""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rptcam_cl.api import Found
from rptcam_cl.core.atomic import remove_strays, replacing, unlinked
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.kept import Maker
from rptcam_cl.rendering import SUFFIX, read_part

PLAN = "plan.json"


@dataclass(frozen=True)
class PartsPlan:
    """How a render is divided.

    Attributes
    ----------
    version, scene : str
        Of the program, and the hash of the scene with all that changes the picture.
    spp : int
        Samples per pixel.
    layers : list
        Their names, and their samples per pixel.
    count : int
        Parts.
    found : Found
        Focus and exposure, the same for all.
    made_by : dict
        What the first of them was made by.
    """

    version: str
    scene: str
    spp: int
    layers: list[Any]
    count: int
    found: Found
    made_by: Maker


class PartsFolder:
    """Parts of one render on disk.

    Parameters
    ----------
    path
        The folder; made when the plan is written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def clear(self) -> None:
        """Remove what an earlier render left, and the folder if nothing else is in it.

        Raises
        ------
        StateError
            It is no folder.
        """
        if not self.path.is_dir():
            if self.path.exists():
                raise StateError(f"{self.path}: is no folder, and parts are kept there (move it, or rename the output)")
            return
        remove_strays(self.path)
        for file in [*self.path.glob(f"*{SUFFIX}"), self.path / PLAN]:
            file.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self.path.rmdir()

    def plan(self) -> PartsPlan | None:
        """Return the plan of an earlier run; None where there is none.

        Raises
        ------
        StateError
            It cannot be read.
        """
        path = self.path / PLAN
        try:
            data: dict[str, Any] = json.loads(path.read_text("utf-8"))
            return PartsPlan(**{**data, "found": Found(**data["found"])})
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError, KeyError) as problem:
            raise StateError(f"{path}: cannot be read ({problem}; remove it, or render without --resume)") from None

    def begin(self, plan: PartsPlan) -> None:
        """Write the plan of a new render.

        Raises
        ------
        StateError
            The folder cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            raise StateError(f"{self.path}: cannot be made ({problem.strerror})") from None
        with replacing(unlinked(self.path / PLAN)) as temporary:
            temporary.write_text(json.dumps(asdict(plan), indent=1), "utf-8")

    def file(self, number: int) -> Path:
        """Return where a part is kept."""
        return self.path / f"{number}{SUFFIX}"

    def keep(self, number: int, content: bytes) -> None:
        """Write a part, whole or not at all."""
        with replacing(unlinked(self.file(number))) as temporary:
            temporary.write_bytes(content)

    def missing(self, plan: PartsPlan) -> list[int]:
        """Return the numbers of the parts that are not there; damaged ones are removed first."""
        lacking = []
        for number in range(1, plan.count + 1):
            try:
                read_part(self.file(number))
            except StateError:
                self.file(number).unlink(missing_ok=True)
                lacking.append(number)
        return lacking
