"""Scene files: a validated, frozen model of everything that a picture needs. Knows nothing of OpenCL."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rptcam_cl.scene.autofocus import METHODS, POLICIES, AutoFocus, FoundFocus, ZonesFile, read_zones
from rptcam_cl.scene.base import FLOAT32_MAX, FLOAT32_MIN_NORMAL, listed, near_name
from rptcam_cl.scene.board import Board
from rptcam_cl.scene.camera import (
    NOT_FOUND_YET,
    Camera,
    EnvironmentCamera,
    LensCamera,
    PinholeCamera,
    RealisticCamera,
    ThickLensCamera,
    ThinLensCamera,
    unknown_camera,
)
from rptcam_cl.scene.change import apply_overrides, change_scene, with_camera
from rptcam_cl.scene.dielectric import AbsorbingMaterial, Dielectric, ThinGlass
from rptcam_cl.scene.exposure import LEAST_CD_M2, LEAST_ISO, MOST_CD_M2, MOST_ISO, MOST_STOPS, Exposure, Shutter
from rptcam_cl.scene.file_reference import FileReference, file_references
from rptcam_cl.scene.film import SIDES_MM, Film, FilmFilter
from rptcam_cl.scene.focus import Focus
from rptcam_cl.scene.lens_settings import (
    Accuracy,
    Aperture,
    CircularAperture,
    CoatingLayers,
    Dirt,
    HeartAperture,
    ImageAperture,
    OutlineAperture,
    PolygonAperture,
    StarAperture,
    Transmission,
)
from rptcam_cl.scene.light import (
    ConstantEnvironment,
    DirectionalLight,
    Environment,
    GradientEnvironment,
    ImageEnvironment,
    Light,
    PointLight,
    ProfileLight,
    SkyEnvironment,
    SpotLight,
    SunLight,
)
from rptcam_cl.scene.load import Missing, load_picture, load_scene, scene_json_schema, scene_json_schema_text
from rptcam_cl.scene.material import Emissive, Material, Matte, Mirror, Mix, Plastic, Principled
from rptcam_cl.scene.material_parts import (
    AnisotropyMap,
    BumpyMaterial,
    CoveringMaterial,
    NormalMap,
    alpha_pair,
    has_holes,
)
from rptcam_cl.scene.mesh import LoadedMesh, MeshObject, NamedMesh
from rptcam_cl.scene.metal import Conductor, MetalSpectrum, MetalTable, OpticalConstants
from rptcam_cl.scene.moment import at_opening, at_rest, camera_changes, exposure_steps
from rptcam_cl.scene.motion import CameraKeyframe, ObjectKeyframe, Trajectory, moments, quaternion_of
from rptcam_cl.scene.movements import NO_MOVEMENTS, Movements
from rptcam_cl.scene.picture import (
    COOLEST,
    HOTTEST,
    LIGHTS,
    NO_BALANCE,
    TONES,
    PictureSettings,
    ToneCurve,
    WhiteBalance,
)
from rptcam_cl.scene.pose import Pose, pose_matrix
from rptcam_cl.scene.problems import input_error
from rptcam_cl.scene.quantities import LARGEST_RADIANCE, LONGEST_S, SHORTEST_S, Colour
from rptcam_cl.scene.real_lens import GRADES, AsBuilt, RealLens
from rptcam_cl.scene.render_settings import (
    ADAPTIVE_SPP,
    FILM_LAYERS,
    LAYER_NAMES,
    MAX_SPP,
    SHARP_LAYERS,
    LayerName,
    LensColour,
    RenderSettings,
    SpectrumSettings,
)
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.scene_object import PlacedObject, SceneObject, Solid
from rptcam_cl.scene.scene_text import plain, scene_text
from rptcam_cl.scene.sensor import Sensor
from rptcam_cl.scene.sequence import ContinuousFocus, FrameSequence, ValueKeyframe
from rptcam_cl.scene.set_keys import set_keys
from rptcam_cl.scene.shape import Box, Cone, Cylinder, Disk, Object, Plane, Rectangle, Sphere
from rptcam_cl.scene.spectrum import SpectralColour
from rptcam_cl.scene.spectrum_forms import LightSpectrum, TabulatedSpectrum
from rptcam_cl.scene.texture import Blend, Checker, Gradient, Grid, ImageTexture, Noise, Reflectance, Texture
from rptcam_cl.scene.transform import Rotation, TransformStep

if TYPE_CHECKING:
    from rptcam_cl.scene.tolerances import Distribution, Merit, Tolerance, Tolerances, grade

__all__ = [
    "ADAPTIVE_SPP",
    "COOLEST",
    "FILM_LAYERS",
    "FLOAT32_MAX",
    "FLOAT32_MIN_NORMAL",
    "GRADES",
    "HOTTEST",
    "LARGEST_RADIANCE",
    "LAYER_NAMES",
    "LEAST_CD_M2",
    "LEAST_ISO",
    "LIGHTS",
    "LONGEST_S",
    "MAX_SPP",
    "METHODS",
    "MOST_CD_M2",
    "MOST_ISO",
    "MOST_STOPS",
    "NOT_FOUND_YET",
    "NO_BALANCE",
    "NO_MOVEMENTS",
    "POLICIES",
    "SHARP_LAYERS",
    "SHORTEST_S",
    "SIDES_MM",
    "TONES",
    "AbsorbingMaterial",
    "Accuracy",
    "AnisotropyMap",
    "Aperture",
    "AsBuilt",
    "AutoFocus",
    "Blend",
    "Board",
    "Box",
    "BumpyMaterial",
    "Camera",
    "CameraKeyframe",
    "Checker",
    "CircularAperture",
    "CoatingLayers",
    "Colour",
    "Conductor",
    "Cone",
    "ConstantEnvironment",
    "ContinuousFocus",
    "CoveringMaterial",
    "Cylinder",
    "Dielectric",
    "DirectionalLight",
    "Dirt",
    "Disk",
    "Distribution",
    "Emissive",
    "Environment",
    "EnvironmentCamera",
    "Exposure",
    "FileReference",
    "Film",
    "FilmFilter",
    "Focus",
    "FoundFocus",
    "FrameSequence",
    "Gradient",
    "GradientEnvironment",
    "Grid",
    "HeartAperture",
    "ImageAperture",
    "ImageEnvironment",
    "ImageTexture",
    "LayerName",
    "LensCamera",
    "LensColour",
    "Light",
    "LightSpectrum",
    "LoadedMesh",
    "Material",
    "Matte",
    "Merit",
    "MeshObject",
    "MetalSpectrum",
    "MetalTable",
    "Mirror",
    "Missing",
    "Mix",
    "Movements",
    "NamedMesh",
    "Noise",
    "NormalMap",
    "Object",
    "ObjectKeyframe",
    "OpticalConstants",
    "OutlineAperture",
    "PictureSettings",
    "PinholeCamera",
    "PlacedObject",
    "Plane",
    "Plastic",
    "PointLight",
    "PolygonAperture",
    "Pose",
    "Principled",
    "ProfileLight",
    "RealLens",
    "RealisticCamera",
    "Rectangle",
    "Reflectance",
    "RenderSettings",
    "Rotation",
    "Scene",
    "SceneObject",
    "Sensor",
    "Shutter",
    "SkyEnvironment",
    "Solid",
    "SpectralColour",
    "SpectrumSettings",
    "Sphere",
    "SpotLight",
    "StarAperture",
    "SunLight",
    "TabulatedSpectrum",
    "Texture",
    "ThickLensCamera",
    "ThinGlass",
    "ThinLensCamera",
    "Tolerance",
    "Tolerances",
    "ToneCurve",
    "Trajectory",
    "TransformStep",
    "Transmission",
    "ValueKeyframe",
    "WhiteBalance",
    "ZonesFile",
    "alpha_pair",
    "apply_overrides",
    "at_opening",
    "at_rest",
    "camera_changes",
    "change_scene",
    "exposure_steps",
    "file_references",
    "grade",
    "has_holes",
    "input_error",
    "listed",
    "load_picture",
    "load_scene",
    "moments",
    "near_name",
    "plain",
    "pose_matrix",
    "quaternion_of",
    "read_zones",
    "scene_json_schema",
    "scene_json_schema_text",
    "scene_text",
    "set_keys",
    "unknown_camera",
    "with_camera",
]

_TOLERANCES = ("Distribution", "Merit", "Tolerance", "Tolerances", "grade")  # few scenes have any


def __getattr__(name: str) -> Any:
    """Import the model of tolerances at its first use, so that every command starts sooner."""
    if name not in _TOLERANCES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found = getattr(import_module("rptcam_cl.scene.tolerances"), name)
    return found
