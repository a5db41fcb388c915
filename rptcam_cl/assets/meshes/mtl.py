"""MTL files: the materials that OBJ files name."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from rptcam_cl.assets.meshes.file_material import Colour, FileMaterial, FileTexture
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.references import read_whole

MOST_BYTES = 16_000_000

# Values that follow an option of a texture line.
OPTIONS = {
    "-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-imfchan": 1, "-texres": 1, "-bm": 1, "-boost": 1, "-type": 1,
    "-mm": 2, "-o": 3, "-s": 3, "-t": 3, "-colorspace": 1,
}  # fmt: skip
UP_TO = {"-o", "-s", "-t"}  # these take one to three numbers
PHYSICAL = {"pr", "pm", "map_pr", "map_pm"}
GLASS = (4, 6, 7, 9)  # illumination models with transparency by refraction

Lines = dict[str, tuple[int, list[str]]]


def read_mtl(path: Path) -> dict[str, FileMaterial]:
    """Return the materials of an MTL file by their names.

    Raises
    ------
    InputError
        When a value cannot be read.
    """
    try:
        content = read_whole(path, MOST_BYTES)
    except (InputError, StateError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
    materials: dict[str, Lines] = {}
    current: Lines | None = None
    for number, line in enumerate(content.decode("utf-8", "replace").splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if words[0] == "newmtl":
            current = materials.setdefault(" ".join(words[1:]), {})
        elif current is None:
            raise InputError(f"{path}:{number}: is not in a material (got {line.strip()[:60]!r}; allowed: newmtl NAME)")
        else:
            current[words[0].lower()] = (number, words[1:])
    return {name: _Material(path, lines).material(name) for name, lines in materials.items()}


class _Material:
    """The lines of one material."""

    def __init__(self, path: Path, lines: Lines) -> None:
        self._path = path
        self._lines = lines

    def material(self, name: str) -> FileMaterial:
        """Return what the lines say."""
        model = int(self._number("illum", 2))
        gloss = self._colour("ks", (0.0, 0.0, 0.0))
        exponent = max(0.0, self._number("ns", 0.0))
        plain = FileMaterial(
            name=name,
            base_color=self._colour("kd", (0.8, 0.8, 0.8)),
            base_texture=self._texture("map_kd"),
            matte=(model < 2 or max(gloss) == 0) and not PHYSICAL & self._lines.keys(),
            metallic=min(1.0, max(0.0, self._number("pm", float("map_pm" in self._lines)))),
            metallic_texture=self._texture("map_pm"),
            roughness=min(
                1.0, max(0.0, self._number("pr", 1.0 if "map_pr" in self._lines else (2 / (exponent + 2)) ** 0.25))
            ),
            roughness_texture=self._texture("map_pr"),
            opacity=self._opacity(),
            opacity_texture=self._texture("map_d"),
            normals=self._texture("norm") or self._texture("map_norm"),
            emission=self._colour("ke", (1.0,) * 3 if "map_ke" in self._lines else (0.0,) * 3, most=math.inf),
            emission_texture=self._texture("map_ke"),
            both_sides=True,
            index=self._number("ni", 1.5),
        )
        return self._with_model(plain, model, gloss)

    def _with_model(self, plain: FileMaterial, model: int, gloss: Colour) -> FileMaterial:
        """Return the material with what the illumination model says: glass, or a mirror where nothing is diffuse."""
        if model in GLASS:
            clear = self._colour("tf", (1.0, 1.0, 1.0))
            return replace(
                plain, matte=False, base_color=clear, base_texture=None, transmission=1.0, solid=True, opacity=1.0
            )
        if model in (3, 5) and max(gloss) > 0 and max(plain.base_color) == 0:
            return replace(plain, metallic=1.0, base_color=gloss)
        return plain

    def _opacity(self) -> float:
        if "d" in self._lines:
            return min(1.0, max(0.0, self._number("d", 1.0)))
        return min(1.0, max(0.0, 1 - self._number("tr", 0.0)))

    def _numbers(self, key: str) -> list[float] | None:
        if key not in self._lines:
            return None
        number, words = self._lines[key]
        words = [word for word in words if word != "-halo"]
        try:
            found = [float(word) for word in words]
            if not found or not all(map(math.isfinite, found)):
                raise ValueError
        except ValueError:
            got = " ".join([key, *words])[:60]
            raise InputError(f"{self._path}:{number}: is not a value (got {got!r}; allowed: finite numbers)") from None
        return found

    def _number(self, key: str, default: float) -> float:
        found = self._numbers(key)
        return default if found is None else found[0]

    def _colour(self, key: str, default: Colour, most: float = 1.0) -> Colour:
        found = self._numbers(key)
        if found is None:
            return default
        red, green, blue = (min(most, max(0.0, value)) for value in (found * 3 if len(found) < 3 else found)[:3])
        return (red, green, blue)

    def _texture(self, key: str) -> FileTexture | None:
        if key not in self._lines:
            return None
        options, name = _options(self._lines[key][1])
        if not name:
            return None
        return FileTexture(
            self._path.parent / name.replace("\\", "/"),
            name,
            scale=options.get("-s", (1.0, 1.0)),
            offset=options.get("-o", (0.0, 0.0)),
            wrap="clamp" if "-clamp" in options else "repeat",
        )


def _options(words: list[str]) -> tuple[dict[str, tuple[float, float]], str]:
    """Return the options of a texture line that are followed, and the name of the picture, which may have spaces."""
    found: dict[str, tuple[float, float]] = {}
    place = 0
    while place < len(words) and words[place] in OPTIONS:
        option = words[place]
        values = words[place + 1 : place + 1 + OPTIONS[option]]
        if option in UP_TO:
            values = values[: next((n for n, word in enumerate(values) if not _is_number(word)), len(values))]
        if option in ("-s", "-o") and values:
            default = 1.0 if option == "-s" else 0.0
            found[option] = (float(values[0]), float(values[1]) if len(values) > 1 else default)
        elif option == "-clamp" and values == ["on"]:
            found[option] = (1.0, 1.0)
        place += 1 + len(values)
    return found, " ".join(words[place:])


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False
