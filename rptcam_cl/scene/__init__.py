"""Scene files: a validated, frozen model of everything that a picture needs. Knows nothing of OpenCL."""

from rptcam_cl.scene.accuracy import Accuracy
from rptcam_cl.scene.aperture import (
    Aperture,
    CircularAperture,
    HeartAperture,
    ImageAperture,
    OutlineAperture,
    PolygonAperture,
    StarAperture,
)
from rptcam_cl.scene.autofocus import AutoFocus, OnlyAuto, ZonesFile
from rptcam_cl.scene.camera import (
    Camera,
    EnvironmentCamera,
    Focus,
    LensCamera,
    PinholeCamera,
    RealisticCamera,
    ThickLensCamera,
    ThinLensCamera,
)
from rptcam_cl.scene.change import change_scene, with_camera
from rptcam_cl.scene.coverage import NormalMap
from rptcam_cl.scene.dielectric import Dielectric, ThinGlass
from rptcam_cl.scene.environment import (
    ConstantEnvironment,
    Environment,
    GradientEnvironment,
    ImageEnvironment,
    SkyEnvironment,
)
from rptcam_cl.scene.exposure import Exposure
from rptcam_cl.scene.film import Film
from rptcam_cl.scene.film_filter import FilmFilter
from rptcam_cl.scene.light import DirectionalLight, Light, PointLight, ProfileLight, SpotLight, SunLight
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.material import Emissive, Material, Matte, Mirror, Mix, Plastic
from rptcam_cl.scene.mesh_shape import MeshObject, NamedMesh
from rptcam_cl.scene.metal import Conductor, MetalSpectrum, MetalTable, OpticalConstants
from rptcam_cl.scene.motion import CameraKeyframe, Course, ObjectKeyframe
from rptcam_cl.scene.opening import at_opening
from rptcam_cl.scene.picture import Picture, ToneCurve, load_picture
from rptcam_cl.scene.principled import Principled
from rptcam_cl.scene.sampling import RenderSettings
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.scene_object import PlacedObject, SceneObject
from rptcam_cl.scene.schema import scene_json_schema
from rptcam_cl.scene.sensor import Sensor
from rptcam_cl.scene.shape import Box, Cone, Cylinder, Disk, Object, Plane, Rectangle, Sphere
from rptcam_cl.scene.shutter import Shutter
from rptcam_cl.scene.spectrum import SpectralColour
from rptcam_cl.scene.spectrum_forms import LightSpectrum, TabulatedSpectrum
from rptcam_cl.scene.spectrum_mode import SpectrumSettings
from rptcam_cl.scene.texture import Checker, Gradient, Grid, ImageTexture, Noise, Reflectance, Texture
from rptcam_cl.scene.transform import Rotation, TransformStep
from rptcam_cl.scene.transmission import Transmission
from rptcam_cl.scene.white_balance import WhiteBalance

__all__ = [
    "Accuracy",
    "Aperture",
    "AutoFocus",
    "Box",
    "Camera",
    "CameraKeyframe",
    "Checker",
    "CircularAperture",
    "Conductor",
    "Cone",
    "ConstantEnvironment",
    "Course",
    "Cylinder",
    "Dielectric",
    "DirectionalLight",
    "Disk",
    "Emissive",
    "Environment",
    "EnvironmentCamera",
    "Exposure",
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
    "LensCamera",
    "Light",
    "LightSpectrum",
    "Material",
    "Matte",
    "MeshObject",
    "MetalSpectrum",
    "MetalTable",
    "Mirror",
    "Mix",
    "NamedMesh",
    "Noise",
    "NormalMap",
    "Object",
    "ObjectKeyframe",
    "OnlyAuto",
    "OpticalConstants",
    "OutlineAperture",
    "Picture",
    "PinholeCamera",
    "PlacedObject",
    "Plane",
    "Plastic",
    "PointLight",
    "PolygonAperture",
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
    "TransformStep",
    "Transmission",
    "WhiteBalance",
    "ZonesFile",
    "at_opening",
    "change_scene",
    "load_picture",
    "load_scene",
    "scene_json_schema",
    "with_camera",
]
