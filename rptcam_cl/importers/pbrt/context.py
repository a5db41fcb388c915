"""What every part of a conversion works with."""

from __future__ import annotations

from dataclasses import field
from pathlib import Path

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, MissingFileError
from rptcam_cl.core.references import Folders
from rptcam_cl.importers.pbrt.files import FileStore
from rptcam_cl.importers.pbrt.report import Report
from rptcam_cl.importers.pbrt.source import Place
from rptcam_cl.importers.pbrt.state import PbrtScene
from rptcam_cl.scene import Missing


@dataclass
class Context:
    """The scene that is converted, and where things go.

    Attributes
    ----------
    folder : Path
        Of the pbrt scene file, where its names of files start.
    files : FileStore
        Files of the scene of ours.
    missing : "error" or "grey"
        What becomes of pictures and meshes that are not there.
    absent : list of str
        What there is to say of them.
    known : dict
        Textures by ``id`` that were converted before: one may be a part of many, and they of many more.
    pictures : dict
        Names of pictures that are written anew, by their path.
    """

    scene: PbrtScene
    report: Report
    folder: Path
    files: FileStore = field(repr=False)
    missing: Missing = "error"
    absent: list[str] = field(default_factory=list)
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
            raise type(problem)(str(place.error(f"{name[:80]}: {problem}"))) from None

    def find_or_note(self, name: str, place: Place, otherwise: str) -> Path | None:
        """Return the path of a picture or mesh; None for one that is missing, after noting what there is otherwise."""
        try:
            return self.find(name, place)
        except MissingFileError as problem:
            if str(problem) not in self.absent:
                self.absent.append(str(problem))
            self.report.approximated(place, f"{name[:80]}: no such file; {otherwise}")
            return None

    def refuse_missing(self) -> None:
        """Raise an error that names all files that are missing, if any are."""
        if self.absent and self.missing == "error":
            raise MissingFileError("\n".join(self.absent))
