"""Where the package's data lie, inside an installed package or beside it in a checkout; and where caches are kept."""

import os
import sys
from functools import lru_cache
from pathlib import Path

from rptcam_cl.core.errors import StateError

CACHE_VARIABLE = "RPTCAM_CACHE_DIR"
EXAMPLES = ("first_light", "colour_chart", "sunny_sixteen")  # those that the README renders; each is one file
# Scenes that come with the package: the files of each below the folder of examples, the scene file first.
_SINGLE = (
    "portrait", "materials", "daylight", "reading_room", "propeller", "panning", "prism", "lamps", "lamps_f16",
    "mirror_telephoto", "night_street", "sharpness", "sun_ghosts",
)  # fmt: skip
_TEA_TABLE = (
    "tea_table.yaml", "bouquet.glb", "cloth.ply", "flask.ply", "knot.ply", "linen.jpg", "room.hdr", "stone.ply",
    "tea_set.glb", "vase.ply", "wood.jpg",
)  # fmt: skip
_EVENING = (
    "evening.yaml", "bouquet.glb", "candle.ply", "candlestick.ply", "cloth.ply", "flask.ply", "goblet.ply", "knot.ply",
    "linen.jpg", "tea_set.glb", "vase.ply", "wine.ply", "wood.jpg",
)  # fmt: skip
SCENES = {name: (f"{name}.yaml",) for name in (*EXAMPLES, *_SINGLE)} | {
    "tea_table": tuple(f"studio/{name}" for name in _TEA_TABLE),
    "evening": tuple(f"studio/{name}" for name in _EVENING),
}
_PACKAGE = Path(__file__).resolve().parents[1]


@lru_cache(maxsize=8)
def _folder(name: str) -> Path:
    candidates = (_PACKAGE / "_data" / name, _PACKAGE.parent / name)
    for folder in candidates:
        if folder.is_dir():
            return folder
    places = " or ".join(str(folder) for folder in candidates)
    raise StateError(f"the installation is incomplete: no folder {places}; reinstall rptcam_cl")


def package_dir() -> Path:
    """Folder of the program."""
    return _PACKAGE


def kernels_dir() -> Path:
    """Folder of the OpenCL sources."""
    return _folder("kernels")


def lenses_dir() -> Path:
    """Folder of the lens files that come with the package."""
    return _folder("lenses")


def example_scenes() -> dict[str, Path]:
    """Return the scene files that come with the package, by name; the first is the one of the first picture."""
    folder = _folder("examples")
    return {name: folder / files[0] for name, files in SCENES.items()}


def example_files(name: str) -> tuple[Path, ...]:
    """Return the files of a scene that comes with the package, the scene file first; they lie in one folder."""
    folder = _folder("examples")
    return tuple(folder / file for file in SCENES[name])


def spectra_dir() -> Path:
    """Folder of the tables of spectra."""
    return _PACKAGE / "colour" / "tables"


def response_curves_dir() -> Path:
    """Folder of the response curves of cameras."""
    return _PACKAGE / "colour" / "curves"


def glass_catalogues_dir() -> Path:
    """Folder of the glasses of the makers."""
    return _PACKAGE / "optics" / "catalogues"


def cache_dir(kind: str) -> Path:
    """Return the folder of one kind of cache: in ``RPTCAM_CACHE_DIR``, else where the system keeps caches.

    It need not exist, and it may be impossible to make it.
    """
    named = os.environ.get(CACHE_VARIABLE)
    return (Path(named) if named else _system_cache() / "rptcam_cl") / kind


def _system_cache() -> Path:
    home = Path(os.path.expanduser("~"))  # noqa: PTH111 -- Path.home() raises where there is no home
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    if sys.platform == "darwin":
        return home / "Library" / "Caches"
    named = os.environ.get("XDG_CACHE_HOME", "")
    return Path(named) if os.path.isabs(named) else home / ".cache"  # noqa: PTH117 -- the standard ignores other paths
