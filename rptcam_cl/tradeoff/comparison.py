"""What a comparison of configurations found, as data."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.tradeoff.measurement import Measurement
from rptcam_cl.tradeoff.statistics import CONFIDENCE
from rptcam_cl.tradeoff.tiers.errors import FIELDS, TierError


@dataclass(frozen=True)
class Advice:
    """Which configuration suits a wish.

    Attributes
    ----------
    wish : str
        ``time`` or ``error``.
    amount : float
        Time [s] or relative error (root of relMSE).
    chosen : str or None
        Name of the configuration; None where none reaches the error, or gives every pixel a sample in the time.
    seconds, error : float
        What it takes and errs by; the error counts the bias at the upper end of its interval.
    samples : int
        Samples per pixel that it takes; 0 where none reaches the error.
    least_error, most_error : float
        Between which the error lies after these samples, with noise and bias at the ends of their intervals.
    full_seconds, full_error : float
        The same of the most accurate configuration.
    perhaps : str or None
        Another one that would be clearly better yet if its bias were what was measured and not the most it may be.
    """

    wish: str
    amount: float
    chosen: str | None
    seconds: float
    error: float
    samples: int
    least_error: float
    most_error: float
    full_seconds: float
    full_error: float
    perhaps: str | None


@dataclass(frozen=True)
class Comparison:
    """What a comparison of configurations found, as data.

    Attributes
    ----------
    scene, device : str
    resolution : (width, height)
    tiles : (rendered, all)
        Tiles of 8 x 8 pixels that the pictures were made of.
    grid : (rows, columns)
        How the rendered ones lie, row by row.
    samples : (int, int, int)
        Numbers of samples per pixel of the pictures; the last of some of the tiles only.
    long_tiles : int
        How many these are.
    seeds : int
        Independent pictures of each of the first two.
    seconds : float
        Time that all took [s].
    by_cpu : bool
        Whether the times that count are CPU times divided by the cores.
    measurements : tuple of Measurement
        The most accurate configuration first.
    cameras : tuple of TierError
        Errors of cheaper camera models over the field, traced in float64.
    allowed : str
        Camera model that `camera.accuracy: auto` takes; empty without a lens of surfaces.
    lens_colour_px : float or None
        How far the lens moves light of other wavelengths [pixels].
    truncation : dict
        How much paths beyond the scene's depth could bring, as `rendering.truncation` bounds it.
    advice : tuple of Advice
    skipped : dict
        Configurations that could not be rendered, and why.
    """

    scene: str
    device: str
    resolution: tuple[int, int]
    tiles: tuple[int, int]
    grid: tuple[int, int]
    samples: tuple[int, int, int]
    long_tiles: int
    seeds: int
    seconds: float
    by_cpu: bool
    measurements: tuple[Measurement, ...]
    cameras: tuple[TierError, ...]
    allowed: str
    lens_colour_px: float | None
    truncation: dict[str, Any]
    advice: tuple[Advice, ...] = ()
    skipped: dict[str, str] = field(default_factory=dict)

    def named(self, name: str) -> Measurement:
        """Return the measurement of a configuration by its name or by that of another that is the same way."""
        for found in self.measurements:
            if name in (found.name, *found.same_as):
                return found
        names = [known for found in self.measurements for known in (found.name, *found.same_as)]
        raise InputError(f"{name}: was not compared (there are: {', '.join(names)})")

    def camera_of(self, found: Measurement) -> TierError | None:
        """Return the errors of a configuration's camera model, where it is not the traced lens."""
        return next((each for each in self.cameras if each.tier == found.tier), None)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values; what is infinite becomes null in JSON, which means never (or always)."""
        values = asdict(self)
        for found in values["measurements"]:
            found["seconds_to"] = {f"{target:g}": value for target, value in found["seconds_to"].items()}
        return values | {"fields": list(FIELDS), "confidence": CONFIDENCE}
