"""Renders a .glb of lightwell-bake with its lightmaps in Blender's Cycles; compares it with ours.

blender --background --factory-startup --python tests/bench/baked_blender.py -- LIT.glb --out FILE.png
    --camera PX,PY,PZ:TX,TY,TZ:FOV [--size WxH] [--spp N] [--reference OURS.exr] [--limit 0.03]

The recipe is that of docs/baking_engines.md, in nodes: the EXR that extras.lightwell names, at the coordinates of the
second UV map, times the base colour and 1/pi (by the convention), as emission. No lamp, no sky, no bounces.
With --reference it ends with 1 unless the means of all channels are within --limit of those of the
reference, a linear EXR of the same view (lightwell-view --path-trace SCENE --out OURS.exr). Written for
Blender 3.4 (Debian 12).
"""
import argparse
import math
import os
import sys

import bpy
import numpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import blender_view

FACTOR = {"irradiance": 1 / math.pi, "three": 1 / math.pi, "godot": 1.0}  # of base colour times texel


def arguments():
    parser = argparse.ArgumentParser(prog="baked_blender.py")
    parser.add_argument("scene")
    parser.add_argument("--out", required=True)
    parser.add_argument("--camera", required=True)
    parser.add_argument("--size", default="480x270")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--reference")
    parser.add_argument("--limit", type=float, default=0.03)
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1:])


def show_lightmap(material, folder):
    """Replaces what the importer made: base colour times lightmap as emission, of both sides or of one."""
    info = material["lightwell"]
    tree = material.node_tree
    nodes, links = tree.nodes, tree.links
    principled = next(n for n in nodes if n.type == "BSDF_PRINCIPLED")
    output = next(n for n in nodes if n.type == "OUTPUT_MATERIAL")
    base = principled.inputs["Base Color"]
    image = nodes.new("ShaderNodeTexImage")
    image.image = bpy.data.images.load(os.path.join(folder, info["lightmap"]), check_existing=True)
    image.image.colorspace_settings.name = "Non-Color"
    image.extension = "EXTEND"
    place = nodes.new("ShaderNodeUVMap")
    place.uv_map = "UVMap.001"
    links.new(place.outputs[0], image.inputs["Vector"])
    product = nodes.new("ShaderNodeMixRGB")
    product.blend_type = "MULTIPLY"
    product.inputs["Fac"].default_value = 1
    if base.is_linked:
        links.new(base.links[0].from_socket, product.inputs["Color1"])
    else:
        product.inputs["Color1"].default_value = base.default_value
    links.new(image.outputs["Color"], product.inputs["Color2"])
    shine = nodes.new("ShaderNodeEmission")
    shine.inputs["Strength"].default_value = FACTOR[info["convention"]]
    links.new(product.outputs["Color"], shine.inputs["Color"])
    surface = shine.outputs[0]
    if material.use_backface_culling:  # viewers do not draw these backs; Cycles draws them unless a node hides them
        geometry = nodes.new("ShaderNodeNewGeometry")
        clear = nodes.new("ShaderNodeBsdfTransparent")
        sides = nodes.new("ShaderNodeMixShader")
        links.new(geometry.outputs["Backfacing"], sides.inputs[0])
        links.new(surface, sides.inputs[1])
        links.new(clear.outputs[0], sides.inputs[2])
        surface = sides.outputs[0]
    links.new(surface, output.inputs["Surface"])


def means(path):
    """Means of the channels of a picture, in linear light."""
    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Non-Color"
    pixels = numpy.empty(len(image.pixels), dtype=numpy.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(-1, image.channels)[:, :3].astype(float).mean(axis=0)


def main():
    args = arguments()
    blender_view.open_scene(args.scene)
    lit = [m for m in bpy.data.materials if m.use_nodes and "lightwell" in m]
    if not lit:
        sys.exit("baked_blender.py: no material of the file has a lightmap")
    for material in lit:
        show_lightmap(material, os.path.dirname(os.path.abspath(args.scene)))
    for thing in bpy.data.objects:
        if thing.type == "LIGHT":
            thing.hide_render = True
    scene = bpy.context.scene
    scene.world = None
    scene.cycles.max_bounces = 0
    scene.view_settings.view_transform = "Standard"
    blender_view.set_camera(args.camera)
    blender_view.render(args.out, "PNG", args.size, args.spp)
    if args.reference is None:
        return
    linear = os.path.splitext(os.path.abspath(args.out))[0] + ".exr"
    blender_view.render(linear, "OPEN_EXR", args.size, args.spp)
    ratio = means(linear) / means(os.path.abspath(args.reference))
    print("means of", ", ".join("%.4f" % r for r in ratio), "of the reference's")
    if not all(abs(r - 1) <= args.limit for r in ratio):
        sys.exit(1)


main()
