"""What the last plan was made of, for the next: the frames of a dataset and what a viewfinder shows change little."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from rptcam_cl.cameras import CameraModel, camera_model, turned
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.plan.environment import Surroundings, pack_environment
from rptcam_cl.plan.materials import Materials, pack_materials
from rptcam_cl.plan.optical_constants import KnownSpectra
from rptcam_cl.plan.textures import Textures, TextureTable
from rptcam_cl.scene import Exposure, Film, LensCamera, Material, Scene, Shutter, SpectrumSettings, file_references

Part = TypeVar("Part")
BY_VALUE = (str, bytes, int, float, LensCamera, Film, Exposure, Shutter, SpectrumSettings)


@dataclass(frozen=True, eq=False)
class Appearance:
    """What surfaces and surroundings look like: records, textures and spectra."""

    table: TextureTable
    spectra: KnownSpectra
    shown: Materials
    surroundings: Surroundings

    def copied(self) -> Appearance:
        """Return these to be added to: lights have textures and spectra too, and write into the surroundings."""
        surroundings = replace(self.surroundings, record=self.surroundings.record.copy())
        return Appearance(self.table.copied(), self.spectra.copied(), self.shown, surroundings)


class PlanParts:
    """Keeps each part of a plan until it is made of something else."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[tuple[Any, ...], Any]] = {}

    def part(self, name: str, of: tuple[Any, ...], make: Callable[[], Part]) -> Part:
        """Return the part of a name that is made of the same as before, else what ``make`` returns; not to be changed.

        Parameters
        ----------
        of
            Instances that do not change, or what compares by its content; tuples of them.
        """
        known = self._known.get(name)
        if known is None or not _are_same(known[0], of):
            known = self._known[name] = of, make()
        found: Part = known[1]
        return found

    def appearance(self, scene: Scene, materials: Sequence[Material], files: tuple[str, ...]) -> Appearance:
        """Return what the materials of primitives and the environment of a scene look like; it can be added to.

        Parameters
        ----------
        files
            Digests of the files that they name, and perhaps of others.
        """

        def make() -> Appearance:
            table, spectra = TextureTable(scene), KnownSpectra()
            shown = pack_materials(materials, table, spectra)
            return Appearance(table, spectra, shown, pack_environment(scene, table, spectra))

        return self.part("appearance", (*materials, scene.environment, files), make).copied()

    def textures(self, appearance: Appearance) -> Textures:
        """Return the textures of appearance to which all has been added."""
        origin = appearance.table.unchanged_from
        return appearance.table.pack() if origin is None else self.part("textures", (origin,), appearance.table.pack)

    def camera(self, scene: Scene, *, coarse: bool) -> CameraModel:
        """Return the model of a scene's camera: the one before, turned, where it has only been moved about."""

        def make() -> CameraModel:
            return camera_model(scene, scene.spectrum.lens_colour, coarse=coarse)

        camera = scene.camera
        if not isinstance(camera, LensCamera) or not _is_portable(scene, camera):
            return make()
        still = camera.model_copy(update={"eye": (0.0, 0.0, 0.0), "target": (0.0, 0.0, -1.0), "up": (0.0, 1.0, 0.0)})
        of = (still, scene.film, scene.exposure, scene.shutter, scene.metres_per_unit, scene.spectrum, coarse)
        return turned(self.part("camera", of, make), camera)


def _is_portable(scene: Scene, camera: LensCamera) -> bool:
    """Return whether a camera is the same wherever it stands, and made of no file that somebody may write anew."""
    focus = camera.focus
    if camera.motion or scene.shutter.keys or not (focus.point is None and focus.object is None and focus.auto is None):
        return False
    if not (isinstance(scene.lens_source(), str) and isinstance(scene.tolerances_source(), str | None)):
        return False
    return not any(file_references(camera))


def _are_same(one: Any, other: Any) -> bool:
    """Return whether two things are: the same instances, but for numbers, texts and how a camera is set."""
    if one is other:
        return True
    if isinstance(one, tuple) and type(one) is type(other):
        return len(one) == len(other) and all(map(_are_same, one, other))
    return isinstance(one, BY_VALUE) and type(one) is type(other) and bool(one == other)
