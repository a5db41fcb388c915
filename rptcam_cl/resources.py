"""Where the kernels and the lens files lie: inside an installed package, or beside it in a checkout."""

from pathlib import Path

from rptcam_cl.errors import StateError

_PACKAGE = Path(__file__).resolve().parent


def _folder(name: str) -> Path:
    candidates = (_PACKAGE / "_data" / name, _PACKAGE.parent / name)
    for folder in candidates:
        if folder.is_dir():
            return folder
    places = " or ".join(str(folder) for folder in candidates)
    raise StateError(f"the installation is incomplete: no folder {places}; reinstall rptcam_cl")


def kernels_dir() -> Path:
    """Folder of the OpenCL sources."""
    return _folder("kernels")


def lenses_dir() -> Path:
    """Folder of the lens files that come with the package."""
    return _folder("lenses")


def spectra_dir() -> Path:
    """Folder of the tables of spectra."""
    return _PACKAGE / "spectra" / "tables"


def response_curves_dir() -> Path:
    """Folder of the response curves of cameras."""
    return _PACKAGE / "sensor" / "curves"


def glass_catalogues_dir() -> Path:
    """Folder of the glasses of the makers."""
    return _PACKAGE / "optics" / "catalogues"
