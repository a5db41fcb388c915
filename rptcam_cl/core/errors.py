"""Errors a user can cause or meet, each with the exit code of the command line."""

from collections.abc import Iterable


class RptcamError(Exception):
    """Base of every error that is reported in one line, without a traceback."""

    exit_code = 2


class InputError(RptcamError):
    """A scene, lens, argument or other input is wrong. The message says what, where and what would be right."""

    exit_code = 2


class MissingFileError(InputError):
    """A file that a scene or another file names is not there."""


class OutsideFolderError(InputError):
    """A file that a scene or another file names lies where that file may not read."""


class DeviceError(RptcamError):
    """No usable OpenCL device, or a kernel that did not build or run."""

    exit_code = 3


class StateError(RptcamError):
    """A file could not be read or written, or a saved state does not fit."""

    exit_code = 4


class NumericError(RptcamError):
    """A strict render met numbers that cannot be trusted, or autofocus that failed.

    Attributes
    ----------
    image
        The picture all the same.
    """

    exit_code = 5

    def __init__(self, message: str, image: object = None) -> None:
        super().__init__(message)
        self.image = image


def out_of_range(name: str, got: object, allowed: str) -> InputError:
    """The error of a number that is not in its range."""
    return InputError(f"{name}: is out of range (got {got}; allowed: {allowed})")


# Words that mean a name without looking like it, or while looking more like its opposite; and a name that was.
_MEANS = {
    "nearest": "closest",
    "near": "closest",
    "far": "farthest",
    "middle": "centre",
    "median": "weighted",
    "filmic": "aces",
}


def near_name(word: object, names: Iterable[str]) -> str:
    """Return ``; did you mean name?`` for the name that means the same as a word or is most like it, or nothing."""
    from difflib import get_close_matches  # late, as most runs meet no error

    lower, given = {name.lower(): name for name in names}, str(word).lower()
    same = _MEANS.get(given)
    matches = [same] if same in lower else get_close_matches(given, lower, n=1, cutoff=0.6)
    if not matches:  # the name without its unit, as fov for fov_degrees
        matches = [name for name in lower if given and name.startswith(f"{given}_")][:1]
    return f"; did you mean {lower[matches[0]]}?" if matches else ""
