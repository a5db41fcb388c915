"""How the picture is computed: samples, layers, and how colour is carried along paths."""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from rptcam_cl.scene.base import SceneModel, refuse
from rptcam_cl.scene.quantities import NUMBER, WHOLE_NUMBER

LayerName = Literal[
    "depth",
    "distance",
    "position",
    "normal",
    "geometric_normal",
    "albedo",
    "coverage",
    "coc",
    "object_id",
    "material_id",
    "uv",
    "pupil",
    "samples",
    "variance",
    "direct",
    "ghosts",
    "crypto_object",
    "crypto_material",
    "sharp_depth",
    "pupil_depth",
    "sharp_position",
    "sharp_normal",
    "sharp_object_id",
    "sharp_material_id",
    "sharp_class_id",
    "occlusion",
    "flow_forward",
    "flow_backward",
    "motion",
    "ray_origin",
    "ray_direction",
]
LAYER_NAMES: tuple[LayerName, ...] = get_args(LayerName)
# Of the picture itself, not of what its rays meet.
FILM_LAYERS: tuple[LayerName, ...] = ("samples", "variance", "direct", "ghosts")
# Of the chief rays alone, without the samples of the picture.
SHARP_LAYERS: tuple[LayerName, ...] = LAYER_NAMES[LAYER_NAMES.index("sharp_depth") :]


def _as_list(names: object) -> object:
    if not isinstance(names, (list, tuple)):
        raise refuse("must be a list of layers", allowed="as [depth, normal]")
    return names


def _each_once(names: tuple[LayerName, ...]) -> tuple[LayerName, ...]:
    for index, name in enumerate(names):
        if name in names[:index]:
            raise refuse("is listed twice", got=name, allowed="each layer once", path=(index,))
    return names


Layers = Annotated[tuple[LayerName, ...], BeforeValidator(_as_list), AfterValidator(_each_once)]

MAX_SPP = 2**32 - 1
MAX_SEED = 2**64 - 1
MAX_DEPTH = 1_000_000
ADAPTIVE_SPP = 16384  # where a noise target is out of reach


class RenderSettings(SceneModel):
    """How the light paths are sampled."""

    spp: Annotated[int, Field(ge=1, le=MAX_SPP), WHOLE_NUMBER] = 64
    """Samples per pixel."""

    max_depth: Annotated[int, Field(ge=1, le=MAX_DEPTH), WHOLE_NUMBER] = 8
    """Longest path [edges], the camera's included: 1 sees lamps only, 2 adds direct light."""

    seed: Annotated[int, Field(ge=0, le=MAX_SEED), WHOLE_NUMBER] = 0
    """Seed of the random numbers; another seed gives other noise."""

    roulette_depth: Annotated[int, Field(ge=0, le=MAX_DEPTH), WHOLE_NUMBER] = 4
    """Edge from which on Russian roulette may end a path; 0 means never."""

    sampler: Literal["lattice", "independent"] = "lattice"
    """How the samples of a pixel are spread: on a lattice, which lowers the noise, or each by itself."""

    noise: Annotated[float, Field(gt=0, lt=1), NUMBER] | None = None
    """Relative standard error at which a tile of 8 x 8 pixels is done; `spp` is then the most that a pixel gets."""

    clamp: Annotated[float, Field(ge=1e-6, le=1e30), NUMBER] | None = None
    """Most that a sample may bring to a channel of the film; brighter ones are scaled down, which is biased."""

    caustics: Literal["off", "auto", "on"] = "auto"
    """Whether photons bring the light that smooth glass and mirrors throw onto surfaces that scatter it; `auto`: where
    the scene has such light from lamps that paths hardly find, and no `clamp`."""

    layers: Layers = ()
    """Auxiliary layers to record beside the picture, as depth and normal."""

    layers_spp: Annotated[int, Field(ge=1, le=MAX_SPP), WHOLE_NUMBER] = 64
    """Samples per pixel that the layers are made of at most, the first ones of the picture."""

    @property
    def most_spp(self) -> int:
        """Samples of a pixel at most: `spp`, which unless it is given leaves a noise target room."""
        return self.spp if self.noise is None or "spp" in self.model_fields_set else ADAPTIVE_SPP


LensColour = Literal["off", "auto", "on"]


class SpectrumSettings(SceneModel):
    """How the colour of light is carried along paths; a word alone is the mode."""

    mode: Literal["auto", "rgb", "dispersive", "spectral"] = "auto"
    """Red, green and blue through a lens of one wavelength; the same with a wavelength per path, which lens and glass
    disperse; spectra at three wavelengths per path. By default what the scene needs."""

    lens: LensColour | None = None
    """Whether the lens refracts each wavelength separately; `auto`: where that moves light by more than half a pixel,
    or than `camera.accuracy` allows."""

    @model_validator(mode="before")
    @classmethod
    def _word(cls, value: Any) -> Any:
        return {"mode": value} if isinstance(value, str) else value

    @property
    def lens_colour(self) -> LensColour:
        """Whether the lens refracts each wavelength separately."""
        if self.mode == "rgb":
            return "off"
        return self.lens or ("on" if self.mode == "dispersive" else "auto")
