"""What every part of a conversion works with."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.references import Folders
from rptcam_cl.importers.pbrt.files import FileStore
from rptcam_cl.importers.pbrt.report import Report
from rptcam_cl.importers.pbrt.source import Place
from rptcam_cl.importers.pbrt.state import PbrtScene


@dataclass
class Context:
    """The scene that is converted, and where things go.

    Attributes
    ----------
    folder : Path
        Of the pbrt scene file, where its names of files start.
    files : FileStore
        Files of the scene of ours.
    known : dict
        Textures by ``id`` that were converted before: one may be a part of many, and they of many more.
    pictures : dict
        Names of pictures that are written anew, by their path.
    """

    scene: PbrtScene
    report: Report
    folder: Path
    files: FileStore = field(repr=False)
    known: dict[int, object] = field(default_factory=dict, repr=False)
    pictures: dict[str, str] = field(default_factory=dict, repr=False)

    def find(self, name: str, place: Place) -> Path:
        """Return the path of a file that the pbrt scene names.

        Raises
        ------
        InputError
            When there is no such file, it is no regular one, or lies outside the folder of the pbrt scene.
        """
        try:
            return Folders(self.folder, owner="pbrt scene").find(name)
        except InputError as problem:
            raise place.error(f"{name[:80]}: {problem}") from None
