"""Bakes what the translation has no equal for: inputs of shaders become pictures of their object, made by Cycles."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from typing import Any

import bpy

from .materials import translate
from .reader import BAKED, Reader
from .report import Report
from .shading import BAKED_UV, has_nodes

SIGNS = ("not translated", "normals by", "all go by")  # of sentences about values that a picture can hold
MARGIN = 8  # pixels round each island of the texture coordinates


def wants_baking(material: Any) -> bool:
    """Whether values of a material are left out that a picture of each object can hold."""
    if material is None or not has_nodes(material):
        return False
    report = Report()
    translate(Reader().material_of(material, None, Report()), report)
    return any(sign in sentence for sentence in report.sentences for sign in SIGNS)


def inputs_of(material: Any) -> list[tuple[Any, Any]]:
    """The linked inputs of a material's shaders that are values: nodes outside groups, with the input."""
    shaders = [node for node in material.node_tree.nodes if node.outputs and node.outputs[0].type == "SHADER"]
    return [
        (node, socket) for node in shaders for socket in node.inputs
        if socket.is_linked and (socket.type in ("VALUE", "RGBA") or socket.identifier == "Normal")
    ]  # fmt: skip


def bake(scene: Any, items: list[Any], size: int) -> int:
    """Bake all that some mesh objects need, into pictures of so many pixels across; return how many were made."""
    count = 0
    with _cycles(scene):
        for item in items:
            wanting = list({slot.material for slot in item.material_slots if wants_baking(slot.material)})
            if not wanting:
                continue
            _add_coordinates(item)
            made: dict[str, str] = {}
            for material in wanting:
                for node, socket in inputs_of(material):
                    name = f"{item.name} {material.name} {node.name} {socket.identifier}"[:63]
                    picture = bpy.data.images.get(name)
                    if picture is not None:
                        bpy.data.images.remove(picture)
                    picture = bpy.data.images.new(name, size, size, float_buffer=True, is_data=True)
                    _bake_input(item, material, socket, picture)
                    picture.pack()
                    made[json.dumps((material.name_full, node.name, socket.identifier))] = picture.name_full
            item[BAKED] = json.dumps(made)
            item.update_tag()
            count += len(made)
    return count


@contextlib.contextmanager
def _cycles(scene: Any) -> Iterator[None]:
    """Cycles as the engine, with a sample, and the selection as it was afterwards."""
    layer = bpy.context.view_layer
    engine, active, chosen = scene.render.engine, layer.objects.active, list(bpy.context.selected_objects)
    scene.render.engine = "CYCLES"
    samples, scene.cycles.samples = scene.cycles.samples, 1
    try:
        yield
    finally:
        scene.cycles.samples, scene.render.engine = samples, engine
        for each in layer.objects:
            each.select_set(each in chosen)
        layer.objects.active = active


def _choose(item: Any) -> None:
    for each in bpy.context.view_layer.objects:
        each.select_set(each == item)
    bpy.context.view_layer.objects.active = item


def _add_coordinates(item: Any) -> None:
    """Unfold a mesh without overlaps, unless that was done before."""
    layers = item.data.uv_layers
    if BAKED_UV in layers:
        return
    before = layers.active
    name = before.name if before is not None else None
    layers.active = layers.new(name=BAKED_UV, do_init=False)
    _choose(item)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.reveal()
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.02)
    bpy.ops.object.mode_set(mode="OBJECT")
    if name is not None:
        layers.active = layers[name]


def _bake_input(item: Any, material: Any, socket: Any, picture: Any) -> None:
    """Fill a picture with what an input gets, by a lamp of that light in place of the material's surface."""
    is_normal = socket.identifier == "Normal"
    trees = {slot.material.node_tree for slot in item.material_slots if slot.material and slot.material.node_tree}
    scratch = bpy.data.images.new("scratch", 4, 4)
    added = []
    for tree in trees:  # each material of the object needs a picture to be baked into
        target = tree.nodes.new("ShaderNodeTexImage")
        target.image = picture if tree == material.node_tree else scratch
        tree.nodes.active = target
        added.append((tree, target))
    tree = material.node_tree
    output = tree.get_output_node("CYCLES")
    surface = output.inputs["Surface"].links[0].from_socket
    before = item.data.uv_layers.active
    try:
        if not is_normal:
            lamp = tree.nodes.new("ShaderNodeEmission")
            added.append((tree, lamp))
            tree.links.new(socket.links[0].from_socket, lamp.inputs["Color"])
            tree.links.new(lamp.outputs[0], output.inputs["Surface"])
        _choose(item)
        item.data.uv_layers.active = item.data.uv_layers[BAKED_UV]
        kind = {"type": "NORMAL", "normal_space": "TANGENT"} if is_normal else {"type": "EMIT"}
        bpy.ops.object.bake(**kind, margin=MARGIN, use_clear=True, uv_layer=BAKED_UV)
    finally:
        item.data.uv_layers.active = before
        tree.links.new(surface, output.inputs["Surface"])
        for of, node in added:
            of.nodes.remove(node)
        bpy.data.images.remove(scratch)


def forget(items: list[Any]) -> None:
    """Go by the nodes again."""
    for item in items:
        item.pop(BAKED, None)
        item.update_tag()
