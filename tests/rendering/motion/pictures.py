"""Exposures of scenes with motion, and the means of still pictures that they must agree with."""

import numpy as np

import rptcam_cl
from tests.rendering.pictures import seed_of
from tests.support.statistics import sampled

SKY = {"kind": "gradient", "bottom": 0.1, "top": 1.0, "up": [0, 1, 0]}
GREY = {"kind": "matte", "reflectance": 0.5}
FLOOR = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 1, 0], "material": GREY}
BALL = {"shape": "sphere", "center": [0, 1, 0], "radius": 1, "material": GREY}
POSE = {"eye": [0, 1, 5], "target": [0, 1, 0]}
PINHOLE = {"kind": "pinhole", "fov_degrees": 40, **POSE}


def scene_with(objects=(FLOOR, BALL), camera=PINHOLE, shutter=None, size=(32, 24), spp=16, depth=4, **rest):
    """Return the mapping of a scene under a sky."""
    film = {"resolution": list(size)}
    render = {"spp": spp, "max_depth": depth} | rest.pop("render", {})
    plain = {"film": film, "camera": camera, "objects": list(objects), "environment": SKY, "render": render}
    return plain | ({"shutter": shutter} if shutter else {}) | rest


def film(scene, session, name="", **options):
    """Return the film of a scene, float32, with a seed that follows from a name."""
    return np.asarray(rptcam_cl.render(scene, seed=seed_of(name), device=session, **options))


# Lanes per work item with the organisation that goes with them: on GPUs, on CPUs with AVX2 and with AVX-512. The other
# pairs are of no device.
PAIRS = [(lanes, way) for way in ("passes", "stream") for lanes in (1, 8, 16)]


def exposures(scene, session, name, count=4, **options):
    """Return the mean of some pictures of a scene."""
    return sampled([film(scene, session, f"{name} {k}", **options) for k in range(count)])


def still_mean(scene_at, span, session, name, count=3, strata=16, **options):
    """Return the mean of still pictures at moments by chance within even strata of a span of time."""
    rng = np.random.default_rng(seed_of(name))
    begin, end = span

    def mean(batch):
        moments = begin + (end - begin) * (np.arange(strata) + rng.random(strata)) / strata
        stills = [film(scene_at(t), session, f"{name} {batch} {t}", **options) for t in moments.tolist()]
        return np.mean(stills, axis=0, dtype=np.float64)

    return sampled([mean(batch) for batch in range(count)])
