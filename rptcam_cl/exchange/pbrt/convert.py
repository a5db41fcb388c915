"""From a pbrt scene file to a scene of ours."""

from __future__ import annotations

import tempfile
from collections import Counter
from dataclasses import field
from pathlib import Path
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import Folders, plain, replacing
from rptcam_cl.exchange.pbrt.camera import convert_camera, exposure_ev, filter_keys, frame_of, raster_of, render_keys
from rptcam_cl.exchange.pbrt.files import Context, FileStore
from rptcam_cl.exchange.pbrt.lights import convert_lights, convert_sky
from rptcam_cl.exchange.pbrt.shapes import Objects
from rptcam_cl.exchange.pbrt.source import Report
from rptcam_cl.exchange.pbrt.world import read_world
from rptcam_cl.scene.load import Missing, load_scene, scene_text

# Parameters of every camera that concern motion, which is not converted.
SHUTTER = ("shutteropen", "shutterclose")


@dataclass(frozen=True, eq=False)
class Conversion:
    """A converted scene, not yet written.

    Attributes
    ----------
    scene : dict
        The mapping of a scene of ours.
    report : Report
        What was ignored or approximated.
    files : FileStore
        The files that the scene needs beside it.
    """

    source: Path
    scene: dict[str, Any]
    report: Report
    files: FileStore = field(repr=False)

    def write(self, target: Path) -> tuple[str, ...]:
        """Write the scene file and the files beside it, once the whole is known to be a scene that can be used.

        All is written to a hidden folder first and read from there; then the files are moved to their places, the
        scene file last.

        Returns
        -------
        tuple of str
            Warnings about the scene.

        Raises
        ------
        InputError
            When what the pbrt scene became cannot be used; nothing is left of it.
        StateError
            When the files cannot be written.
        """
        try:
            with tempfile.TemporaryDirectory(prefix=".rptcam-convert-", dir=target.parent) as name:
                staged = Path(name)
                self.files.stage(staged)
                warnings = self._load_staged(staged, target)
                self.files.place(staged)
        except OSError as problem:
            raise StateError(f"{target}: cannot be written ({problem.strerror})") from None
        text = scene_text(self.scene, (f"Converted from {self.source.name}.",))
        with replacing(target) as temporary:
            temporary.write_text(text, "utf-8")
        return warnings

    def _load_staged(self, staged: Path, target: Path) -> tuple[str, ...]:
        """Return the warnings of the scene with its staged files, which have their later names there."""
        prefix = f"{staged.name}/"
        try:
            scene = load_scene(self.files.named_in(staged, self.scene), base_dir=target.parent)
            return tuple(text.replace(prefix, "") for text in scene.warnings)
        except InputError as problem:
            reason = str(problem).replace(prefix, "")
            raise InputError(f"{self.source}: became a scene that cannot be used: {reason}") from None


def convert_scene(source: Path, target: Path, *, missing: Missing = "error", root: Path | None = None) -> Conversion:
    """Convert a pbrt scene file to a scene of ours.

    Parameters
    ----------
    source
        A scene file of pbrt-v2, v3 or v4.
    target
        Where the scene of ours is to go; files that it names lie in the folder of it.
    missing
        What becomes of pictures and meshes that are not there: an error that names them all, or grey in place of
        pictures and no object in place of meshes; the report lists them.
    root
        A further folder inside which files of the pbrt scene may lie, such as one above that of the scene.

    Raises
    ------
    InputError
        ``FILE:LINE:COL: problem`` for what is not a pbrt scene, or cannot be said.
    """
    report = Report()
    folders = Folders(source.parent, () if root is None else (root,), owner="pbrt scene")
    pbrt = read_world(source, report, folders)
    context = Context(pbrt, report, folders, FileStore(target.parent, target.stem, report), missing)
    scene = _scene_keys(context, source)
    context.refuse_missing()
    _note_unused(context)
    return Conversion(source, scene, report, context.files)


def _scene_keys(context: Context, source: Path) -> dict[str, Any]:
    options = context.scene.options
    camera = options.get("Camera")
    if camera is None:
        raise InputError(f"{source}: has no Camera; is it a part that another file includes?")
    frame = frame_of(camera)
    film = options.get("Film")
    raster = raster_of(context, film)
    camera_keys, film_keys, own_keys = convert_camera(context, camera, frame, raster, film)
    if film is not None:
        film.parameters.skip("diagonal")
    scene: dict[str, Any] = {"film": {**film_keys, **filter_keys(context)}, "camera": camera_keys, **own_keys}
    scene["render"] = render_keys(context)
    if frame.metres_per_unit != 1:
        scene["metres_per_unit"] = frame.metres_per_unit
    if ev := exposure_ev(context, film, camera):
        scene["picture"] = {"ev": ev}
    camera.parameters.skip(*SHUTTER)
    objects = Objects(context, frame)
    objects.add_all()
    sections = objects.keys()
    if "objects" not in sections:
        context.refuse_missing()
        raise InputError(_no_objects(context, source))
    scene |= sections
    lights, sky, maps = convert_lights(context, frame)
    if lights:
        scene["lights"] = lights
    if (environment := convert_sky(context, frame, sky, maps)) is not None:
        scene["environment"] = environment
    return dict(plain(scene))


def _no_objects(context: Context, source: Path) -> str:
    """Return the error for a scene in which nothing could be seen, with the first reason."""
    count = sum(1 for _ in context.scene.placed())
    if not count:
        return f"{source}: 0 objects: the scene has no shapes that are placed"
    why = next((line for line in context.report if "ignored: Shape" in line), "")
    return f"{source}: 0 objects: none of its {count} shapes can be shown{f'; {why}' if why else ''}"


def _note_unused(context: Context) -> None:
    """Report every parameter that was never looked up, and count the objects that each line says something of."""
    scene = context.scene
    entities = [*scene.options.values(), *scene.lights]
    uses = {id(use): use for use, _, _ in scene.placed()}
    counts = Counter(id(use) for use, _, _ in scene.placed())
    for index, use in uses.items():
        shown = [entity for entity in (use.shape, scene.material_of(use.material), use.lamp) if entity is not None]
        shown += [texture for entity in shown for texture in entity.textures.values()]
        entities += shown
        places = [entity.place for entity in shown]
        places += [item.place for entity in shown for item in entity.parameters.items.values()]
        for line in {(place.source.name, place.line_number) for place in places}:
            context.report.objects[line] += counts[index]
    for parameters in dict.fromkeys(entity.parameters for entity in entities):
        for item in parameters.unused():
            context.report.ignored(item.place, f'{parameters.what}: "{item.kind} {item.name}"')
