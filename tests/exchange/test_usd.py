"""Stages of USD as scenes of ours."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import scipy.special
from numpy.typing import NDArray

import rptcam_cl
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.conversion import PolygonMesh
from rptcam_cl.exchange.usd import convert_stage
from rptcam_cl.scene.load import load_scene
from tests.support.cases import slow

pytest.importorskip("pxr")

HEAD = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
    startTimeCode = 1
    endTimeCode = 25
    timeCodesPerSecond = 24
)
"""
# each statement begins a line, which the texts below spare
TYPES = r"def|over|uniform|double3?|float[234]?|color3f|point3f|texCoord2f|token|asset|int|bool|rel"
STATEMENT = re.compile(rf"(?<!uniform) +(?=({TYPES})[\[ ])| +(?=}})")
BALL = 'def Sphere "ball" { double radius = 2 }\n'


def convert(folder: Path, text: str, **options: Any) -> tuple[Any, Any]:
    (folder / "in.usda").write_text(HEAD + STATEMENT.sub("\n", text))
    done = convert_stage(folder / "in.usda", folder / "out.yaml", **options)
    done.write(folder / "out.yaml")
    return done, load_scene(folder / "out.yaml")


def middle_of(scene: Any, index: int = 0) -> Any:
    item = scene.objects[index]
    low, high = scene.solids()[index].bounds()
    places = item.places(scene.folders, 0.0)
    return places[:, :3, :3] @ ((low + high) / 2) + places[:, :3, 3]


def test_transforms_are_those_of_the_hierarchy(tmp_path: Path) -> None:
    text = """def Xform "a" { double3 xformOp:translate = (1, 2, 3)  float xformOp:rotateZ = 90
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]
        def Cube "b" { double size = 2  double3 xformOp:translate = (5, 0, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"] } }"""
    _, scene = convert(tmp_path, text)
    np.testing.assert_allclose(middle_of(scene), [[1, 7, 3]], atol=1e-9)
    assert scene.metres_per_unit == 0.01


def test_time_samples_are_read_at_a_moment(tmp_path: Path) -> None:
    text = """def Sphere "b" { double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 25: (12, 0, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"] }"""
    for time_s, x in ((None, 0.0), (0.5, 6.0), (1.0, 12.0)):
        _, scene = convert(tmp_path, text, time_s=time_s)
        np.testing.assert_allclose(middle_of(scene), [[x, 0, 0]], atol=1e-9)


SHUTTER = """def Camera "c" { double shutter:open = 0 double shutter:close = 12
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 100), 25: (24, 0, 100) }
    uniform token[] xformOpOrder = ["xformOp:translate"] }
    """


def test_what_moves_while_the_shutter_is_open_has_keyframes(tmp_path: Path) -> None:
    text = """def Cube "b" { double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 25: (12, 0, 6) }
        float xformOp:rotateY.timeSamples = { 1: 0, 25: 80 } float3 xformOp:scale = (1, 2, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY", "xformOp:scale"] }
        def Sphere "still" { }"""
    done, scene = convert(tmp_path, SHUTTER + text)
    assert (scene.shutter.open_s, scene.shutter.time_s) == pytest.approx((1 / 24, 12 / 24))
    box, still = scene.objects
    assert still.motion == () and list(done.report)[-1:] == [line for line in done.report if "lights" in line]
    for share in (0, 0.5, 1):  # of the shutter: half of the way in 24 codes
        way, angle = share / 2, np.radians(share * 40)
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        expected = np.eye(4)
        expected[:3, :3], expected[:3, 3] = turn @ np.diag([1, 2, 1]), [12 * way, 0, 6 * way]
        np.testing.assert_allclose(box.placed_at(1 / 24 + share / 2), expected, atol=1e-6)
        np.testing.assert_allclose(scene.camera.pose_at(1 / 24 + share / 2)[0], [24 * way, 0, 100], atol=1e-6)


def test_what_stretches_while_the_shutter_is_open_stays(tmp_path: Path) -> None:
    text = """def Cube "b" { float3 xformOp:scale.timeSamples = { 1: (1, 1, 1), 25: (2, 2, 2) }
        uniform token[] xformOpOrder = ["xformOp:scale"] }"""
    done, scene = convert(tmp_path, SHUTTER + text)
    assert scene.objects[0].motion == ()
    assert any("/b: approximated: what stretches while the shutter is open stays" in line for line in done.report)


def test_point_instancers_become_tables(tmp_path: Path) -> None:
    text = """def PointInstancer "many" { double3 xformOp:translate = (0, 0, 10)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        int[] protoIndices = [0, 1, 0] point3f[] positions = [(1, 0, 0), (2, 0, 0), (3, 0, 0)]
        rel prototypes = [</many/p/ball>, </many/p/box>]
        def Scope "p" { def Sphere "ball" { } def Cube "box" { } } }"""
    done, scene = convert(tmp_path, text)
    assert [item["shape"] for item in done.scene["objects"]] == ["sphere", "box"]
    np.testing.assert_allclose(middle_of(scene, 0), [[1, 0, 10], [3, 0, 10]])
    np.testing.assert_allclose(middle_of(scene, 1), [[2, 0, 10]])


def test_what_is_hidden_or_a_guide_is_left_out(tmp_path: Path) -> None:
    text = 'def Sphere "h" { token visibility = "invisible" } def Sphere "g" { uniform token purpose = "guide" }'
    done, _ = convert(tmp_path, BALL + text)
    assert len(done.scene["objects"]) == 1
    with pytest.raises(InputError, match="0 objects"):
        convert(tmp_path, text)


MESH = """def Mesh "m" { int[] faceVertexCounts = [4, 4] int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5, 2]
    uniform token subdivisionScheme = "none" point3f[] points = [(0,0,0),(1,0,0),(1,1,0),(0,1,0),(2,0,0),(2,1,0)]
    texCoord2f[] primvars:st = [(0,0),(1,0),(1,1),(0,1),(0,0),(1,0),(1,1),(0,1)] (interpolation = "faceVarying")
    rel material:binding = </red> %s
    def GeomSubset "right" { uniform token elementType = "face" uniform token familyName = "materialBind"
        int[] indices = [1] rel material:binding = </blue> } }
def Material "red" { token outputs:surface.connect = </red/s.outputs:surface>
    def Shader "s" { uniform token info:id = "UsdPreviewSurface" color3f inputs:diffuseColor = (1, 0, 0)
        float inputs:roughness = 0.3 float inputs:metallic = 1 float inputs:ior = 1.4 token outputs:surface } }
def Material "blue" { token outputs:surface.connect = </blue/s.outputs:surface>
    def Shader "s" { uniform token info:id = "UsdPreviewSurface" color3f inputs:diffuseColor = (0, 0, 1)
        float inputs:opacity = 0.5 token outputs:surface } }
"""


@pytest.mark.parametrize("hand", ["rightHanded", "leftHanded"])
def test_meshes_have_the_materials_of_their_faces(tmp_path: Path, hand: str) -> None:
    done, scene = convert(tmp_path, MESH % f'uniform token orientation = "{hand}"')
    names = [item["material"] for item in done.scene["objects"]]
    assert names == ["blue", "red"]
    assert done.scene["materials"]["red"]["base_color"] == [1, 0, 0]
    assert scene.materials["red"].index == pytest.approx(1.4)
    assert scene.materials["blue"].opacity == 0.5
    for index, low in ((0, 1.0), (1, 0.0)):
        (part,) = scene.load_mesh(scene.objects[index]).contents.parts
        points = (part.mesh.positions + part.mesh.origin)[part.mesh.faces]
        assert points[..., 0].min() == low
        normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])[:, 2]
        assert (normal > 0).all() if hand == "rightHanded" else (normal < 0).all()
        np.testing.assert_allclose(part.mesh.uvs[part.mesh.faces][..., 0], points[..., 0] - low, atol=1e-6)


SHEET = """def Mesh "m" { int[] faceVertexCounts = [4, 4] int[] faceVertexIndices = [0, 1, 3, 2, 2, 3, 5, 4]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0, 2, 0), (1, 2, 0)]
    uniform token subdivisionScheme = "none" uniform token orientation = "%s"
    color3f[] primvars:displayColor = %s ( interpolation = "%s" ) }
    def Camera "c" { token projection = "orthographic" float horizontalAperture = 10 float verticalAperture = 20
        double3 xformOp:translate = (0.5, 1, 5) uniform token[] xformOpOrder = ["xformOp:translate"] }"""


@pytest.mark.parametrize("hand", ["rightHanded", "leftHanded"])
@pytest.mark.parametrize("interpolation", ["uniform", "vertex", "varying", "faceVarying"])
def test_meshes_show_their_own_display_colours(tmp_path: Path, interpolation: str, hand: str) -> None:
    points = np.array([[x, y] for y in (0, 1, 2) for x in (0, 1)])
    corners = points[[0, 1, 3, 2, 2, 3, 5, 4]]

    def shade(at: NDArray[Any]) -> NDArray[Any]:
        return np.stack([at[..., 0], at[..., 1] / 2, 0.5 + 0 * at[..., 0]], axis=-1)

    written = {"uniform": [(1, 0, 0), (0, 0.5, 1)], "faceVarying": shade(corners)}.get(interpolation, shade(points))
    values = str([tuple(float(each) for each in row) for row in written])
    done, scene = convert(tmp_path, SHEET % (hand, values, interpolation))
    assert list(done.report) == [line for line in done.report if "light" in line]
    film = np.asarray(rptcam_cl.render(scene, size=(20, 40), spp=64))
    x, y = np.meshgrid(*((np.arange(count) + 0.5) / 20 for count in (20, 40)))
    seen = shade(np.stack([x, y], axis=-1)) if interpolation != "uniform" else np.where(
        y[..., None] < 1, written[0], written[1])  # fmt: skip
    away = np.abs(y - 1) > 0.1  # from the edge that both faces have
    np.testing.assert_allclose(film[::-1][away], seen[away], atol=0.02)


def cube() -> PolygonMesh:
    points = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1.0)])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return PolygonMesh(points, np.full(6, 4), np.array(faces).ravel())


def test_a_subdivided_cube_has_the_points_of_catmull_and_clark() -> None:
    once = cube().subdivided()
    assert (len(once.counts), len(once.points)) == (24, 26)
    # (Q + 2 R) / 3 at a corner of valence 3, from (1, 1, 1): Q and R are 1/3 and 2/3 of it
    np.testing.assert_allclose(once.points[7], [5 / 9] * 3)
    np.testing.assert_allclose(np.abs(once.points[8:20]).max(axis=1), 3 / 4)  # edges
    np.testing.assert_allclose(np.abs(once.points[20:]).max(axis=1), 1)  # faces


TOP = np.array([[1, 5], [5, 7], [7, 3], [3, 1]])  # edges of the face at z = 1


def test_a_crease_that_stays_sharp_is_a_cubic_spline() -> None:
    """Lane and Riesenfeld: each division takes (a + 6 b + c) / 8 and the middles."""
    solid, loop = cube(), cube().points[[1, 5, 7, 3]]
    solid = replace(solid, creases=TOP, sharpness=np.full(4, np.inf))
    for _ in range(3):
        solid = solid.subdivided()
        before, after = np.roll(loop, 1, axis=0), np.roll(loop, -1, axis=0)
        loop = np.stack([(before + 6 * loop + after) / 8, (loop + after) / 2], axis=1).reshape(-1, 3)
        assert np.abs(solid.points[:, None] - loop).max(axis=2).min(axis=0).max() < 1e-12


def test_a_crease_lasts_for_as_many_divisions_as_it_is_sharp() -> None:
    smooth, once = cube().subdivided(), replace(cube(), creases=TOP, sharpness=np.ones(4)).subdivided()
    assert once.creases is not None
    assert len(once.creases) == 0
    half = replace(cube(), creases=TOP, sharpness=np.full(4, 0.5)).subdivided()
    np.testing.assert_allclose(half.points, (smooth.points + once.points) / 2, atol=1e-12)


def test_points_that_stay_sharp_stay() -> None:
    solid = replace(cube(), spikes=np.where(np.arange(8) == 7, np.inf, 0.0)).subdivided().subdivided()
    np.testing.assert_array_equal(solid.points[7], [1, 1, 1])
    assert np.abs(solid.points[3]).max() < 0.9


CAGE = """def Mesh "m" { point3f[] points = [(0,0,0), (1,0,0), (1,1,0), (0,1,0)]
    int[] faceVertexCounts = [4] int[] faceVertexIndices = [0, 1, 2, 3]
    normal3f[] normals = [(0,0,1), (0,0,1), (0,0,1), (0,0,1)] NAMED }"""


@pytest.mark.parametrize(("named", "faces"), [("", 2), ('uniform token subdivisionScheme = "catmullClark"', 512)])
def test_normals_are_no_obstacle_to_a_scheme_that_is_written(tmp_path: Path, named: str, faces: int) -> None:
    _, scene = convert(tmp_path, CAGE.replace("NAMED", named))
    (part,) = scene.load_mesh(scene.objects[0]).contents.parts
    assert len(part.mesh.faces) == faces


def test_meshes_that_are_copied_about_are_written_once(tmp_path: Path) -> None:
    done, scene = convert(tmp_path, CAGE.replace("NAMED", "") + "\n" + CAGE.replace("NAMED", "").replace('"m"', '"n"'))
    assert len({item["file"] for item in done.scene["objects"]}) == 1
    assert len(scene.objects) == 2


def test_layers_that_cannot_be_read_are_reported_and_the_library_prints_nothing(tmp_path: Path, capfd: Any) -> None:
    done, _ = convert(tmp_path, BALL + 'def Xform "x" ( references = @away.usda@ ) { }')
    assert any("away.usda cannot be read" in line for line in done.report)
    assert capfd.readouterr().err == ""


def test_a_subdivided_sheet_stays_a_sheet() -> None:
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))
    corner = (np.arange(3)[:, None] * 5 + np.arange(4)).ravel()
    corners = np.stack([corner, corner + 1, corner + 6, corner + 5], axis=1).ravel()
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    sheet = PolygonMesh(points, np.full(12, 4), corners, uvs=points[corners][:, :2])
    twice = sheet.subdivided().subdivided()
    mesh = twice.triangles()
    np.testing.assert_allclose(mesh.areas().sum(), 12, rtol=0.02)  # corners stay, borders are straight
    inside = (np.abs(mesh.vertices[:, :2] - (2, 1.5)) < (0.99, 0.49)).all(axis=1)
    assert mesh.uvs is not None
    np.testing.assert_allclose(mesh.uvs[inside], mesh.vertices[inside, :2], atol=1e-9)


LAMPS = {
    'def RectLight "l" { float inputs:intensity = 2 float inputs:exposure = 1 float inputs:width = 3 }': 4.0,
    'def RectLight "l" { float inputs:intensity = 6 bool inputs:normalize = 1 float inputs:width = 3 }': 2.0,
    'def DiskLight "l" { float inputs:intensity = 8 bool inputs:normalize = 1 float inputs:radius = 2 }': 2 / math.pi,
    'def SphereLight "l" { float inputs:intensity = 8 bool inputs:normalize = 1 float inputs:radius = 1 }': 2 / math.pi,
}


@pytest.mark.parametrize("text", LAMPS)
def test_lamps_have_their_radiance(tmp_path: Path, text: str) -> None:
    done, _ = convert(tmp_path, BALL + text)
    np.testing.assert_allclose(done.scene["objects"][1]["material"]["radiance"], LAMPS[text])


def _spheroid(across: float, along: float) -> float:
    """The area of an ellipsoid of two equal half axes."""
    if along > across:
        e = math.sqrt(1 - (across / along) ** 2)
        return 2 * math.pi * across**2 * (1 + along / across / e * math.asin(e))
    e = math.sqrt(1 - (along / across) ** 2)
    return 2 * math.pi * across**2 * (1 + (1 / e - e) * math.atanh(e))


STRETCHED = {
    ("SphereLight", (1, 1, 9)): _spheroid(0.5, 4.5),
    ("SphereLight", (20, 1, 20)): _spheroid(10, 0.5),
    ("SphereLight", (0.2, 0.1, 0.1)): _spheroid(0.05, 0.1),
    ("SphereLight", (-3, 3, 3)): 4 * math.pi * 1.5**2,
    ("CylinderLight", (9, 1, 1)): 9 * math.pi,
    ("CylinderLight", (2, 4, 1)): 2 * 4 * 2 * scipy.special.ellipe(1 - 1 / 16),  # around it 4 a E(m), a = 4 / 2
    ("RectLight", (2, 3, 5)): 6.0,
    ("DiskLight", (2, 3, 5)): 1.5 * math.pi,
}


@pytest.mark.parametrize(("lamp", "expected"), STRETCHED.items())
def test_stretched_lamps_have_their_power(tmp_path: Path, lamp: tuple[str, Any], expected: float) -> None:
    kind, scale = lamp
    text = f'def {kind} "l" {{ float inputs:intensity = 8 bool inputs:normalize = 1 float3 xformOp:scale = {scale} '
    text += "float3 xformOp:rotateXYZ = (20, 40, 60) "
    done, _ = convert(tmp_path, BALL + text + 'uniform token[] xformOpOrder = ["xformOp:rotateXYZ", "xformOp:scale"] }')
    np.testing.assert_allclose(8 / np.array(done.scene["objects"][1]["material"]["radiance"]), expected, rtol=1e-5)


def test_flat_lamps_shine_along_minus_z(tmp_path: Path) -> None:
    for kind in ("RectLight", "DiskLight"):
        done, _ = convert(tmp_path, BALL + f'def {kind} "l" {{ }}')
        lamp = done.scene["objects"][1]
        normal = lamp["normal"] if "normal" in lamp else np.cross(lamp["edge_u"], lamp["edge_v"])
        assert normal[2] < 0


def test_a_camera_keeps_its_view_and_its_blur(tmp_path: Path) -> None:
    text = """def Camera "c" { float focalLength = 50 float horizontalAperture = 36 float verticalAperture = 24
        float fStop = 2 float focusDistance = 300 double3 xformOp:translate = (0, 0, 9)
        uniform token[] xformOpOrder = ["xformOp:translate"] }"""
    done, scene = convert(tmp_path, BALL + text)
    camera = scene.camera
    assert camera.kind == "thin_lens"
    assert math.tan(math.radians(camera.fov_degrees) / 2) == pytest.approx(0.36)
    # tenths of a unit, that is millimetres: 50 mm at f/2 has an opening of 12.5 mm radius; 300 units are 3 m
    assert camera.aperture_radius_m == pytest.approx(0.0125)
    assert camera.focus_distance_m == pytest.approx(3.0)
    assert camera.eye == (0, 0, 9)
    assert scene.film.resolution == (960, 640)
    assert not [line for line in done.report if "camera" in line]


def test_the_offset_of_the_film_shifts_the_picture(tmp_path: Path) -> None:
    from pxr import Gf, Usd, UsdGeom

    text = """def Camera "c" { float focalLength = 50 float horizontalAperture = 36 float verticalAperture = 24
        float horizontalApertureOffset = 9 float verticalApertureOffset = -3 double3 xformOp:translate = (0, 0, 100)
        uniform token[] xformOpOrder = ["xformOp:translate"] }"""
    _, scene = convert(tmp_path, BALL + text)
    stage = Usd.Stage.Open(str(tmp_path / "in.usda"))
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/c")).GetCamera().frustum
    seen = (frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()).Transform(Gf.Vec3d(0, 0, 0))
    depth = rptcam_cl.render(scene, size=(180, 120), spp=4, layers=["depth"]).layers["depth"]
    rows, columns = np.nonzero(np.isfinite(depth))
    np.testing.assert_allclose(
        [(columns.mean() + 0.5) / 90 - 1, 1 - (rows.mean() + 0.5) / 60], [seen[0], seen[1]], atol=0.01
    )


def test_textures_come_along_with_their_layout(tmp_path: Path) -> None:
    from PIL import Image

    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "a.png")
    shaders = """def Material "red" {
      def Shader "t" { uniform token info:id = "UsdUVTexture" asset inputs:file = @a.png@ token inputs:wrapS = "mirror"
        float2 inputs:st.connect = </red/p.outputs:result> float3 outputs:rgb float outputs:g float outputs:a }
      def Shader "p" { uniform token info:id = "UsdTransform2d" float2 inputs:scale = (2, 3)
        float inputs:rotation = 30 float2 inputs:translation = (0.5, 0) float2 outputs:result }"""
    text = (MESH % "").replace('def Material "red" {', shaders)
    text = text.replace("inputs:diffuseColor = (1, 0, 0)", "inputs:diffuseColor.connect = </red/t.outputs:rgb>")
    text = text.replace("inputs:roughness = 0.3", "inputs:roughness.connect = </red/t.outputs:g>")
    text = text.replace("inputs:metallic = 1", "inputs:opacity.connect = </red/t.outputs:a>")
    done, scene = convert(tmp_path, text)
    colour = done.scene["materials"]["red"]["base_color"]
    assert {key: colour[key] for key in ("wrap", "scale", "rotation_degrees", "offset")} == {
        "wrap": "mirror", "scale": [2, 3], "rotation_degrees": 30, "offset": [0.5, 0],
    }  # fmt: skip
    assert done.scene["materials"]["red"]["roughness"]["channel"] == "g"
    assert "opacity" not in done.scene["materials"]["red"]  # as a picture without alpha is opaque
    assert scene.materials["red"].base_color.source(scene.folders).is_file()


def test_what_is_left_out_is_named(tmp_path: Path) -> None:
    done, _ = convert(tmp_path, BALL + 'def Capsule "c" { } def BasisCurves "hair" { }')
    described = {item["message"]: item["prims"] for item in done.report.described()}
    assert described["a capsule without its caps"] == ["/c"]
    assert described["curves whose points are not those of their counts"] == ["/hair"]
    assert any(line.startswith("/c: approximated: ") for line in done.report)


def test_what_is_no_stage_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in.usda").write_text("no stage")
    with pytest.raises(InputError, match="is no stage of USD"):
        convert_stage(tmp_path / "in.usda", tmp_path / "out.yaml")


@pytest.mark.parametrize("name", ["a.usda", *map(slow, ("a.pbrt", "a.obj"))])
def test_foreign_scenes_are_rendered_directly(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    texts = {
        "a.usda": HEAD + STATEMENT.sub("\n", BALL),
        "a.pbrt": 'Camera "perspective" WorldBegin LightSource "infinite" Translate 0 0 5 Shape "sphere"',
        "a.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    }
    (tmp_path / name).write_text(texts[name])
    assert main(["render", str(tmp_path / name), "-o", str(tmp_path / "o.png"), "--spp", "1", "--size", "16x12"]) == 0
    assert (tmp_path / "o.png").is_file()
    assert "to keep it: rptcam" in capsys.readouterr().err


def test_basis_curves_become_strands(tmp_path: Path) -> None:
    text = """def BasisCurves "fur" { uniform token type = "cubic" uniform token basis = "bspline"
        int[] curveVertexCounts = [4, 5] point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0),
        (0, 1, 0), (1, 1, 0), (2, 1, 0), (3, 1, 0), (4, 1, 0)] float[] widths = [0.5, 0.25] }"""
    _, scene = convert(tmp_path, text)
    (item,) = scene.objects
    assert (item.counts, item.basis, item.form) == ((4, 5), "bspline", "tube")
    np.testing.assert_allclose(item.rows[[0, -1]], [[0, 0, 0, 0.5], [4, 1, 0, 0.25]])
    np.testing.assert_allclose(item.pieces[0][-1][[0, -1]], [[2, 1, 0], [3, 1, 0]], atol=1e-12)


STILL_MOVING = """def PointInstancer "many" { int[] protoIndices = [0] rel prototypes = [</many/p>]
        point3f[] positions.timeSamples = { 1: [(0, 0, 0)], 25: [(5, 0, 0)] }
        def Scope "p" { def Sphere "ball" { } def DiskLight "spot" { float inputs:radius = 2 } } }
    def DomeLight "sky" { float xformOp:rotateY.timeSamples = { 1: 0, 25: 90 }
        uniform token[] xformOpOrder = ["xformOp:rotateY"] }
    """


def test_instancers_and_skies_that_move_are_reported_and_lamps_that_move_have_keyframes(tmp_path: Path) -> None:
    lamp = """def RectLight "lamp" { double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 25: (12, 0, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"] }"""
    done, scene = convert(tmp_path, SHUTTER + STILL_MOVING + lamp)
    said = "\n".join(done.report)
    assert "/many: approximated: an instancer that moves while the shutter is open stays" in said
    assert "/sky: approximated: a sun or sky that turns" in said
    ball, spot, moving = scene.objects  # lamps of an instancer stand at its places, too
    assert ball.motion == spot.motion == () and spot.instances is not None
    np.testing.assert_allclose(moving.placed_at(13 / 24)[:3, 3], [6, 0, 0], atol=1e-6)


def test_displacement_of_a_preview_surface_moves_the_mesh(tmp_path: Path) -> None:
    rows = np.tile([0, 255], (4, 2)).astype(np.uint8)  # of u; the middle of each texel is its place
    PIL.Image.fromarray(rows).save(tmp_path / "h.png")
    text = """def Mesh "m" { int[] faceVertexCounts = [4] int[] faceVertexIndices = [0, 1, 2, 3]
            rel material:binding = </a> uniform token subdivisionScheme = "none"
            point3f[] points = [(0,0,0),(1,0,0),(1,1,0),(0,1,0)]
            texCoord2f[] primvars:st = [(0,0),(1,0),(1,1),(0,1)] (interpolation = "faceVarying") }
        def Material "a" { token outputs:surface.connect = </a/s.outputs:surface>
            def Shader "s" { uniform token info:id = "UsdPreviewSurface" token outputs:surface
                float inputs:displacement.connect = </a/t.outputs:r> }
            def Shader "t" { uniform token info:id = "UsdUVTexture" asset inputs:file = @h.png@ float outputs:r
                float4 inputs:scale = (0.5, 1, 1, 1) float4 inputs:bias = (0.1, 0, 0, 0) } }"""
    done, scene = convert(tmp_path, text)
    assert any("/m: approximated: displacement, with each edge in 256 parts" in line for line in done.report)
    heights = done.scene["objects"][0]["displacement"]
    assert (heights["height"], heights["middle"], heights["file"]) == (0.5, pytest.approx(-0.2), "out_files/h.png")
    low, high = scene.solids()[0].bounds()
    np.testing.assert_allclose([low[2], high[2]], [0.1, 0.6], atol=2e-3)  # 0.5 h + 0.1


MTLX = """<materialx version="1.38" colorspace="lin_rec709"><nodegraph name="g" fileprefix="t/">
    <image name="i" type="color3"><input name="file" type="filename" value="a.png" colorspace="srgb_texture"/>
      <input name="texcoord" type="vector2" nodename="p"/></image>
    <place2d name="p" type="vector2"><input name="scale" type="vector2" value="0.5, 0.25"/>
      <input name="offset" type="vector2" value="0.1, 0"/></place2d>
    <multiply name="m" type="color3"><input name="in1" type="color3" nodename="i"/>
      <input name="in2" type="color3" value="0.5, 1, 1"/></multiply>
    <output name="o" type="color3" nodename="m"/></nodegraph>
  <standard_surface name="s" type="surfaceshader"><input name="base_color" type="color3" nodegraph="g" output="o"/>
    <input name="base" type="float" value="0.5"/><input name="metalness" type="float" value="0.25"/>
    <input name="thin_film_thickness" type="float" value="400"/>
    <input name="diffuse_roughness" type="float" value="0.5"/></standard_surface>
  <surfacematerial name="A" type="material"><input name="surfaceshader" type="surfaceshader" nodename="s"/>
  </surfacematerial>
  <open_pbr_surface name="o" type="surfaceshader"><input name="transmission_weight" type="float" value="1"/>
    <input name="transmission_color" type="color3" value="0.5, 0.5, 1" colorspace="srgb_texture"/>
  </open_pbr_surface>
  <surfacematerial name="B" type="material"><input name="surfaceshader" type="surfaceshader" nodename="o"/>
  </surfacematerial></materialx>"""


def test_materials_of_materialx_files_are_read_alone_and_in_stages(tmp_path: Path) -> None:
    (tmp_path / "t").mkdir()
    PIL.Image.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "t" / "a.png")
    (tmp_path / "m.mtlx").write_text(MTLX)
    alone = convert_stage(tmp_path / "m.mtlx", tmp_path / "balls.yaml")
    alone.write(tmp_path / "balls.yaml")
    first, second = alone.scene["materials"]["A"], alone.scene["materials"]["B"]
    assert first["base_color"] == {
        "kind": "image", "file": "balls_files/a.png", "color_space": "srgb", "gain": [0.25, 0.5, 0.5],
        "scale": [2, 4], "offset": pytest.approx([-0.1, 0]),
    }  # fmt: skip
    assert (first["metallic"], second["transmission"]) == (0.25, 1.0)
    np.testing.assert_allclose(second["base_color"], [0.2140, 0.2140, 1], atol=1e-4)  # sRGB of 0.5
    assert any("ignored: diffuse_roughness" in line for line in alone.report)
    assert any("ignored: a thin film beside" in line for line in alone.report)  # as the metal has a texture
    text = """def "M" ( references = @m.mtlx@</MaterialX/Materials> ) { }
        def Sphere "b" { rel material:binding = </M/A> }"""
    done, _ = convert(tmp_path, text)
    assert done.scene["materials"]["A"]["base_color"]["gain"] == [0.25, 0.5, 0.5]
    assert not any("cannot be read" in line for line in done.report)
    (tmp_path / "m.mtlx").write_text("<materialx><input></materialx>")
    with pytest.raises(InputError, match=r"m\.mtlx: is no MaterialX file \(mismatched tag"):
        convert_stage(tmp_path / "m.mtlx", tmp_path / "balls.yaml")


def test_a_material_takes_the_primvars_of_the_prim_that_has_it(tmp_path: Path) -> None:
    shader = """def Material "m" { token outputs:surface.connect = </m/s.outputs:surface>
        def Shader "s" { uniform token info:id = "UsdPreviewSurface" token outputs:surface
            color3f inputs:diffuseColor.connect = </m/c.outputs:result>
            float inputs:roughness.connect = </m/r.outputs:result> }
        def Shader "c" { uniform token info:id = "UsdPrimvarReader_float3" token inputs:varname = "displayColor"
            color3f inputs:fallback = (0.5, 0.25, 0) float3 outputs:result }
        def Shader "r" { uniform token info:id = "UsdPrimvarReader_float" token inputs:varname = "worn"
            float outputs:result } }
"""
    red, blue = (f"color3f[] primvars:displayColor = [({colour})]" for colour in ("1, 0, 0", "0, 0, 1"))
    balls = "".join(
        f"""def Sphere "b{k}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{ rel material:binding = </m>
        {said} }}\n"""
        for k, said in enumerate([red + " float primvars:worn = 0.75", blue, red, ""])
    )
    done, scene = convert(tmp_path, shader + balls)
    found = [(item.material.base_color, item.material.roughness) for item in scene.objects]
    assert found == [((1, 0, 0), 0.75), ((0, 0, 1), 0), ((1, 0, 0), 0), ((0.5, 0.25, 0), 0)]
    assert len({item["material"] for item in done.scene["objects"]}) == 4
    assert any("roughness as 0, which a primvar that is not there has (and 2 more)" in line for line in done.report)


def test_a_material_that_shows_the_colours_of_a_mesh_leaves_them_to_it(tmp_path: Path) -> None:
    shader = """def Material "s" { token outputs:surface.connect = </s/p.outputs:surface>
        def Shader "p" { uniform token info:id = "UsdPreviewSurface" token outputs:surface
            color3f inputs:diffuseColor.connect = </s/c.outputs:result> }
        def Shader "c" { uniform token info:id = "UsdPrimvarReader_float3" token inputs:varname = "displayColor"
            float3 outputs:result } }"""
    sheet = SHEET % ("rightHanded", "[(1, 0, 0), (0, 0, 1)]", "uniform")
    sheet = sheet.replace('"m" {', '"m" (prepend apiSchemas = ["MaterialBindingAPI"]) { rel material:binding = </s>', 1)
    done, _ = convert(tmp_path, sheet + "\n" + shader)
    assert "material" not in done.scene["objects"][0]
    assert any("a material with the colours of a mesh by matte ones" in line for line in done.report)


SQUARES = """def Mesh "m" { int[] faceVertexCounts = [4, 4] int[] faceVertexIndices = [0, 1, 2, 3, 4, 5, 6, 7]
    rel material:binding = </a> uniform token subdivisionScheme = "none"
    point3f[] points = [(0,0,0),(1,0,0),(1,1,0),(0,1,0),(0,0,1),(2,0,1),(2,2,1),(0,2,1)]
    texCoord2f[] primvars:st = [(0,0),(1,0),(1,1),(0,1),(0,0),(1,0),(1,1),(0,1)] (interpolation = "vertex")
    texCoord2f[] primvars:half = [(0,0),(.5,0),(.5,.5),(0,.5),(0,0),(.5,0),(.5,.5),(0,.5)] (interpolation = "vertex")
    MORE }
def Material "a" { token outputs:surface.connect = </a/s.outputs:surface>
    def Shader "s" { uniform token info:id = "UsdPreviewSurface" token outputs:surface
        color3f inputs:diffuseColor.connect = </a/t.outputs:rgb> float inputs:opacity.connect = </a/t.outputs:a> }
    def Shader "t" { uniform token info:id = "UsdUVTexture" asset inputs:file = @a.png@ float3 outputs:rgb
        float outputs:a float2 inputs:st.connect = </a/r.outputs:result> OWN }
    def Shader "r" { uniform token info:id = "UsdPrimvarReader_float2" token inputs:varname = "half"
        float2 outputs:result } }
"""


def convert_squares(folder: Path, more: str = "", own: str = "") -> tuple[Any, Any]:
    PIL.Image.new("RGBA", (4, 4), (255, 0, 0, 128)).save(folder / "a.png")
    return convert(folder, SQUARES.replace("MORE", more).replace("OWN", own))


def test_pictures_are_placed_by_the_coordinates_that_their_material_reads(tmp_path: Path) -> None:
    _, scene = convert_squares(tmp_path)
    (part,) = scene.load_mesh(scene.objects[0]).contents.parts
    assert part.mesh.uvs is not None and part.mesh.uvs.max() == 0.5


@pytest.mark.parametrize("scheme", ["none", "catmullClark"])
def test_faces_that_are_holes_are_left_out(tmp_path: Path, scheme: str) -> None:
    text = SQUARES.replace("MORE", "int[] holeIndices = [1]").replace('"none"', f'"{scheme}"')
    _, scene = convert(tmp_path, text.replace("rel material:binding = </a>", "").replace("OWN", ""))
    _, high = scene.solids()[0].bounds()
    assert high[2] < 0.5  # the second square lies at a height of 1


def test_polygons_that_are_not_convex_keep_their_outline(tmp_path: Path) -> None:
    text = """def Mesh "m" { int[] faceVertexCounts = [6, 3] int[] faceVertexIndices = [0, 1, 2, 3, 4, 5, 0, 6, 7]
        uniform token subdivisionScheme = "none"
        point3f[] points = [(2,0,0),(2,1,0),(1,1,0),(1,2,0),(0,2,0),(0,0,0),(3,0,0),(3,-1,0)] }"""
    _, scene = convert(tmp_path, text)
    (part,) = scene.load_mesh(scene.objects[0]).contents.parts
    corners = part.mesh.positions[part.mesh.faces].astype(float)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    np.testing.assert_allclose(np.sort(np.sign(crosses)), [-1, 1, 1, 1, 1])
    np.testing.assert_allclose(np.abs(crosses).sum() / 2, 3 + 0.5)  # an L, and a triangle that faces the other way


def test_wraps_and_scales_that_have_no_counterpart_are_named(tmp_path: Path) -> None:
    own = """token inputs:wrapS = "repeat" token inputs:wrapT = "black" float4 inputs:scale = (1, 1, 1, 0.5)"""
    done, _ = convert_squares(tmp_path, own=own)
    assert done.scene["materials"]["a"]["opacity"]["gain"] == [0.5, 0.5, 0.5]
    assert "gain" not in done.scene["materials"]["a"]["base_color"]
    said = [item["message"] for item in done.report.described()]
    assert "wrapS and wrapT that differ as clamp" in said
    assert "black beyond a picture as its edge" in said


@pytest.mark.parametrize(("stage", "axis", "up"), [("Z", "", 2), ("Y", "", 1), ("Y", "Z", 2), ("Z", "Y", 1)])
def test_the_pole_of_a_dome_goes_by_its_axis(tmp_path: Path, stage: str, axis: str, up: int) -> None:
    PIL.Image.new("RGB", (4, 2)).save(tmp_path / "a.png")
    own = f'uniform token poleAxis = "{axis}"' if axis else ""
    text = BALL + f'def DomeLight_1 "d" {{ asset inputs:texture:file = @a.png@ {own} }}'
    (tmp_path / "in.usda").write_text(HEAD.replace('"Y"', f'"{stage}"') + STATEMENT.sub("\n", text))
    done = convert_stage(tmp_path / "in.usda", tmp_path / "out.yaml")
    assert done.scene["environment"]["up"] == np.eye(3)[up].tolist()


OF_LAMPS = {
    "float inputs:shaping:focus = 2": "the focus of a lamp",
    "asset inputs:shaping:ies:file = @a.ies@": "the IES profile of a lamp",
    "float inputs:diffuse = 0.5": "a lamp's factors on gloss and on the rest",
    "rel collection:lightLink:excludes = </ball>": "links of a lamp to what it lights",
}


@pytest.mark.parametrize("own", OF_LAMPS)
def test_what_a_lamp_says_in_vain_is_named(tmp_path: Path, own: str) -> None:
    done, _ = convert(tmp_path, BALL + f'def DiskLight "l" {{ {own} }}')
    assert [item["message"] for item in done.report.described() if item["effect"] == "ignored"] == [OF_LAMPS[own]]


def test_a_sky_of_another_format_is_named(tmp_path: Path) -> None:
    PIL.Image.new("RGB", (4, 4)).save(tmp_path / "a.png")
    own = 'asset inputs:texture:file = @a.png@ token inputs:texture:format = "angular"'
    done, _ = convert(tmp_path, BALL + f'def DomeLight "l" {{ {own} }}')
    assert any("a picture of a sky (angular) as one in longitude and latitude" in line for line in done.report)


def test_a_lamp_without_a_size_shines_as_a_small_one(tmp_path: Path) -> None:
    """A ball of radius r [m] and radiance L has the intensity pi r^2 L far away, here of 0.01 units of 10 mm."""
    text = 'def SphereLight "l" { float inputs:intensity = 8 bool inputs:normalize = 1 float inputs:radius = RADIUS }'
    small, _ = convert(tmp_path, BALL + text.replace("RADIUS", "0.01"))
    point, _ = convert(tmp_path, BALL + text.replace("RADIUS", "0"))
    radiance = np.array(small.scene["objects"][1]["material"]["radiance"])
    np.testing.assert_allclose(point.scene["lights"][0]["intensity"], math.pi * 1e-4**2 * radiance, rtol=1e-6)


VIEWS = """def Camera "first" { }
    def Camera "second" { float exposure = 1.5 float exposure:iso = 200 double3 xformOp:translate = (0, 0, 50)
        uniform token[] xformOpOrder = ["xformOp:translate"] }
    def Scope "Render" { def RenderSettings "s" { rel camera = </second> } }
"""


def test_the_camera_is_that_of_the_render_settings_with_its_exposure(tmp_path: Path) -> None:
    done, scene = convert(tmp_path, BALL + VIEWS)
    assert scene.camera.eye == (0, 0, 0)
    assert any("/second: ignored: all cameras but /first" in line for line in done.report)
    chosen = HEAD.replace("metersPerUnit", 'renderSettingsPrimPath = "/Render/s"\n    metersPerUnit')
    (tmp_path / "in.usda").write_text(chosen + STATEMENT.sub("\n", BALL + VIEWS))
    done = convert_stage(tmp_path / "in.usda", tmp_path / "out.yaml")
    assert done.scene["camera"]["eye"] == [0, 0, 50]
    assert done.scene["picture"]["ev"] == pytest.approx(2.5)


def test_a_colour_of_a_prim_may_be_transparent_and_what_glows_is_a_light(tmp_path: Path) -> None:
    ball = BALL.replace("double radius", "float[] primvars:displayOpacity = [0.25] double radius")
    glowing = """def Sphere "b" { rel material:binding = </g> }
        def Material "g" { token outputs:surface.connect = </g/s.outputs:surface>
            def Shader "s" { uniform token info:id = "UsdPreviewSurface" token outputs:surface
                color3f inputs:emissiveColor = (2, 2, 2) } }"""
    done, _ = convert(tmp_path, ball + glowing)
    assert done.scene["materials"]["color"]["opacity"] == 0.25
    assert "environment" not in done.scene


@pytest.mark.parametrize(
    ("policy", "pixel", "sides"),
    [
        ("", 1, (48, 24)), ("expandAperture", 0.5, (36, 36)), ("cropAperture", 1, (36, 18)),
        ("adjustApertureWidth", 0.5, (24, 24)), ("adjustApertureHeight", 1, (36, 18)),
        ("adjustPixelAspectRatio", 1, (36, 24)),
    ],
)  # fmt: skip
def test_render_settings_have_their_resolution_and_fit_the_film_to_it(
    tmp_path: Path, policy: str, pixel: float, sides: tuple[float, float]
) -> None:
    own = f'token aspectRatioConformPolicy = "{policy}"' if policy else ""
    text = f"""def Camera "c" {{ float focalLength = 50 float horizontalAperture = 36 float verticalAperture = 24 }}
        def RenderSettings "s" {{ uniform int2 resolution = (200, 100) uniform float pixelAspectRatio = {pixel}
            uniform {own} rel camera = </c> }}"""
    text = text.replace("uniform  rel", "rel")
    chosen = HEAD.replace("metersPerUnit", 'renderSettingsPrimPath = "/s"\n    metersPerUnit')
    (tmp_path / "in.usda").write_text(chosen + STATEMENT.sub("\n", BALL + text))
    scene = convert_stage(tmp_path / "in.usda", tmp_path / "out.yaml").scene
    assert scene["film"]["resolution"] == [200, 100]
    size = scene["film"].get("size_mm", (sides[0], sides[0] / 2))  # of square pixels the width alone
    np.testing.assert_allclose(size, sides, rtol=1e-6)
    assert ("size_mm" in scene["film"]) is (sides[0] != 2 * sides[1])
    assert math.tan(math.radians(scene["camera"]["fov_degrees"]) / 2) == pytest.approx(sides[0] / 100)
