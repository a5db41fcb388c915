"""Scene files: a validated, frozen model of everything that a picture needs. Knows nothing of OpenCL."""

from rptcam_cl.scene.autofocus import METHODS, POLICIES, AutoFocus, OnlyAuto, ZonesFile, read_zones
from rptcam_cl.scene.camera import (
    NOT_FOUND_YET,
    Camera,
    EnvironmentCamera,
    Focus,
    LensCamera,
    PinholeCamera,
    Pose,
    RealisticCamera,
    ThickLensCamera,
    ThinLensCamera,
    pose_matrix,
)
from rptcam_cl.scene.change import at_opening, change_scene, with_camera
from rptcam_cl.scene.colours import Colour
from rptcam_cl.scene.dielectric import AbsorbingMaterial, Dielectric, ThinGlass
from rptcam_cl.scene.exposure import LEAST_CD_M2, LEAST_ISO, MOST_CD_M2, MOST_ISO, MOST_STOPS, Exposure
from rptcam_cl.scene.file_reference import FileReference
from rptcam_cl.scene.film import Film, FilmFilter
from rptcam_cl.scene.lens_settings import (
    Accuracy,
    Aperture,
    CircularAperture,
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
from rptcam_cl.scene.load import Missing, load_scene, scene_json_schema, scene_json_schema_text
from rptcam_cl.scene.material import Emissive, Material, Matte, Mirror, Mix, Plastic
from rptcam_cl.scene.material_parts import BumpyMaterial, CoveringMaterial, NormalMap, alpha_pair, has_holes
from rptcam_cl.scene.mesh import MeshObject, NamedMesh
from rptcam_cl.scene.metal import Conductor, MetalSpectrum, MetalTable, OpticalConstants
from rptcam_cl.scene.motion import CameraKeyframe, ObjectKeyframe, Trajectory, moments, quaternion_of
from rptcam_cl.scene.picture import PictureSettings, ToneCurve, load_picture
from rptcam_cl.scene.principled import Principled
from rptcam_cl.scene.problems import input_error
from rptcam_cl.scene.quantities import LARGEST_RADIANCE
from rptcam_cl.scene.render_settings import ADAPTIVE_SPP, FILM_LAYERS, LAYER_NAMES, LayerName, RenderSettings
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.scene_object import PlacedObject, SceneObject
from rptcam_cl.scene.sensor import Sensor
from rptcam_cl.scene.shape import Box, Cone, Cylinder, Disk, Object, Plane, Rectangle, Sphere
from rptcam_cl.scene.shutter import LONGEST_S, SHORTEST_S, Shutter
from rptcam_cl.scene.spectrum import LensColour, SpectralColour, SpectrumSettings
from rptcam_cl.scene.spectrum_forms import LightSpectrum, TabulatedSpectrum
from rptcam_cl.scene.texture import Checker, Gradient, Grid, ImageTexture, Noise, Reflectance, Texture
from rptcam_cl.scene.transform import Rotation, TransformStep
from rptcam_cl.scene.values import FLOAT32_MAX, FLOAT32_MIN_NORMAL, listed, near_name
from rptcam_cl.scene.white_balance import WhiteBalance

__all__ = [
    "ADAPTIVE_SPP",
    "FILM_LAYERS",
    "FLOAT32_MAX",
    "FLOAT32_MIN_NORMAL",
    "LARGEST_RADIANCE",
    "LAYER_NAMES",
    "LEAST_CD_M2",
    "LEAST_ISO",
    "LONGEST_S",
    "METHODS",
    "MOST_CD_M2",
    "MOST_ISO",
    "MOST_STOPS",
    "NOT_FOUND_YET",
    "POLICIES",
    "SHORTEST_S",
    "AbsorbingMaterial",
    "Accuracy",
    "Aperture",
    "AutoFocus",
    "Box",
    "BumpyMaterial",
    "Camera",
    "CameraKeyframe",
    "Checker",
    "CircularAperture",
    "Colour",
    "Conductor",
    "Cone",
    "ConstantEnvironment",
    "CoveringMaterial",
    "Cylinder",
    "Dielectric",
    "DirectionalLight",
    "Disk",
    "Emissive",
    "Environment",
    "EnvironmentCamera",
    "Exposure",
    "FileReference",
    "Film",
    "FilmFilter",
    "Focus",
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
    "Material",
    "Matte",
    "MeshObject",
    "MetalSpectrum",
    "MetalTable",
    "Mirror",
    "Missing",
    "Mix",
    "NamedMesh",
    "Noise",
    "NormalMap",
    "Object",
    "ObjectKeyframe",
    "OnlyAuto",
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
    "ToneCurve",
    "Trajectory",
    "TransformStep",
    "Transmission",
    "WhiteBalance",
    "ZonesFile",
    "alpha_pair",
    "at_opening",
    "change_scene",
    "has_holes",
    "input_error",
    "listed",
    "load_picture",
    "load_scene",
    "moments",
    "near_name",
    "pose_matrix",
    "quaternion_of",
    "read_zones",
    "scene_json_schema",
    "scene_json_schema_text",
    "with_camera",
]
