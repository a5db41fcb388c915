"""Rendering: waves of paths through the kernels, and the film that they add to."""

from rptcam_cl.rendering.account import (
    GEOMETRY,
    anomalies,
    clamp_text,
    described,
    described_before,
    of_makers,
    self_knowledge,
    statistics,
    summary,
    truncation,
    window,
)
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.checkpoint import SUFFIX, Checkpoint, Saver, write_checkpoint
from rptcam_cl.rendering.compile_apart import SMALL, Compiler, order
from rptcam_cl.rendering.diffraction import Diffraction, FilmSpread, diffracted, diffraction_of, spread_of
from rptcam_cl.rendering.film import TILE, TILE_PIXELS, FilmLayout
from rptcam_cl.rendering.film_part import WHOLE, FilmPart
from rptcam_cl.rendering.film_run import FilmRun, SavedState
from rptcam_cl.rendering.float32_margin import LensMargin, film_rays, lens_margin
from rptcam_cl.rendering.forecast import Forecast, forecast
from rptcam_cl.rendering.ghosts import Ghosting, ghosting_of, has_ghosts, saved_ghosts
from rptcam_cl.rendering.ground_truth import GroundTruth, ground_truth_of, saved_truth
from rptcam_cl.rendering.lamp_sights import aimed_plan
from rptcam_cl.rendering.memory import amount
from rptcam_cl.rendering.merge import layout_of, merged_state, read_part
from rptcam_cl.rendering.metering import SPOT_AREA, metered_cd_m2, reading_cd_m2, resolve_exposure
from rptcam_cl.rendering.metering import weights as metering_weights
from rptcam_cl.rendering.passes import signature
from rptcam_cl.rendering.precise_lens import check_precision
from rptcam_cl.rendering.progressive import Progress, Rendering, render_plan, render_state, rendering_of
from rptcam_cl.rendering.saved_picture import SavedPicture, picture_of
from rptcam_cl.rendering.several import AnyWavefront, SharedWavefront
from rptcam_cl.rendering.shares import Part, joined, split_of, split_text
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.rendering.trees.cache import cache_folder
from rptcam_cl.rendering.trees.scene_trees import scene_trees
from rptcam_cl.rendering.wavefront_pool import WavefrontPool

__all__ = [
    "GEOMETRY",
    "SMALL",
    "SPOT_AREA",
    "SUFFIX",
    "TILE",
    "TILE_PIXELS",
    "WHOLE",
    "AnyWavefront",
    "Checkpoint",
    "Compiler",
    "Diffraction",
    "FilmLayout",
    "FilmPart",
    "FilmRun",
    "FilmSpread",
    "Forecast",
    "Ghosting",
    "GroundTruth",
    "LensMargin",
    "Part",
    "Progress",
    "Rendering",
    "SavedPicture",
    "SavedState",
    "Saver",
    "SceneBuffers",
    "SharedWavefront",
    "Wavefront",
    "WavefrontPool",
    "aimed_plan",
    "amount",
    "anomalies",
    "cache_folder",
    "check_precision",
    "clamp_text",
    "described",
    "described_before",
    "diffracted",
    "diffraction_of",
    "film_rays",
    "forecast",
    "ghosting_of",
    "ground_truth_of",
    "has_ghosts",
    "joined",
    "layout_of",
    "lens_margin",
    "merged_state",
    "metered_cd_m2",
    "metering_weights",
    "of_makers",
    "order",
    "picture_of",
    "read_part",
    "reading_cd_m2",
    "render_plan",
    "render_state",
    "rendering_of",
    "resolve_exposure",
    "saved_ghosts",
    "saved_truth",
    "scene_trees",
    "self_knowledge",
    "signature",
    "split_of",
    "split_text",
    "spread_of",
    "statistics",
    "summary",
    "truncation",
    "window",
    "write_checkpoint",
]
