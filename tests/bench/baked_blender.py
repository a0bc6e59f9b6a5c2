"""Renders a .glb of lightwell-bake with its lightmaps in Blender's Cycles; compares it with ours.

blender --background --factory-startup --python tests/bench/baked_blender.py -- LIT.glb --out FILE.png
    --camera PX,PY,PZ:TX,TY,TZ:FOV [--size WxH] [--spp N] [--reference OURS.exr] [--limit 0.03]

The recipe is that of docs/baking_engines.md, in nodes: the EXR that extras.lightwell names, at the coordinates of the
second UV map, times the base colour and 1/pi (by the convention), as emission. No lamp, no sky, no bounces. Where
extras.lightwell has directions, normal maps bend the light by the formula of their form (docs/baking.md).
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


class Formula:
    """Shader nodes by their formulas: numbers, or sockets of the material's tree."""

    def __init__(self, tree):
        self.nodes, self.links = tree.nodes, tree.links

    def node(self, kind, operation, *inputs):
        node = self.nodes.new(kind)
        if operation:
            node.operation = operation
        for socket, value in zip(node.inputs, inputs):
            if isinstance(value, bpy.types.NodeSocket):
                self.links.new(value, socket)
            else:
                socket.default_value = value
        return node

    def math(self, operation, *inputs):
        return self.node("ShaderNodeMath", operation, *inputs).outputs[0]

    def vector(self, operation, *inputs):
        return self.node("ShaderNodeVectorMath", operation, *inputs).outputs["Vector"]

    def dot(self, a, b):
        return self.node("ShaderNodeVectorMath", "DOT_PRODUCT", a, b).outputs["Value"]

    def scale(self, vector, number):
        node = self.node("ShaderNodeVectorMath", "SCALE", vector)
        socket = node.inputs["Scale"]
        if isinstance(number, bpy.types.NodeSocket):
            self.links.new(number, socket)
        else:
            socket.default_value = number
        return node.outputs["Vector"]

    def parts(self, vector):
        return self.node("ShaderNodeSeparateXYZ", None, vector).outputs

    def join(self, x, y, z):
        return self.node("ShaderNodeCombineXYZ", None, x, y, z).outputs[0]

    def to_gltf(self, vector):
        """A direction of Blender's, where z points up, in the axes of glTF, where y does."""
        x, y, z = self.parts(vector)
        return self.join(x, z, self.math("MULTIPLY", y, -1.0))


def own_factor(f, r, n, m):
    u = f.vector("SUBTRACT", r, f.scale(n, 2 / 3))
    up = f.math("MULTIPLY", f.dot(u, n), 1.2)
    root = f.math("SQRT", f.math("ADD", f.math("MULTIPLY", up, up), f.math("MULTIPLY", f.dot(u, u), 1.8)))
    share = f.math("MINIMUM", f.math("ADD", up, root), 1.0)
    wide = f.math("MULTIPLY", f.math("SUBTRACT", 1.0, share), 0.5)
    weight = f.math("DIVIDE", 1.0, f.math("MAXIMUM", share, 0.02))
    d = f.vector("NORMALIZE", f.vector("ADD", f.scale(u, weight), f.scale(n, 2 / 3)))

    def lobe(normal):
        along = f.dot(d, normal)
        narrow = f.math("MULTIPLY", f.math("SUBTRACT", 1.0, wide), f.math("MAXIMUM", along, 0.0))
        half = f.math("MULTIPLY", f.math("ADD", along, 1.0), 0.5)
        return f.math("ADD", narrow, f.math("MULTIPLY", wide, half))

    plain = lobe(n)
    gain = f.math("DIVIDE", f.math("SUBTRACT", lobe(m), plain), f.math("MAXIMUM", plain, 0.05))
    even = f.math("MULTIPLY", wide, f.dot(n, f.vector("SUBTRACT", m, n)))
    factor = f.math("ADD", 1.0, f.math("ADD", even, f.math("MULTIPLY", share, gain)))
    return f.math("MINIMUM", f.math("MAXIMUM", factor, 0.0), 4.0)


def bent_light(tree, folder, info, light, place, m):
    """The socket of the lightmap's colour, bent by its directions. light: its colour; place: its coordinates."""
    f = Formula(tree)
    m, n = f.to_gltf(m), f.to_gltf(f.node("ShaderNodeNewGeometry", None).outputs["Normal"])
    file = os.path.join(folder, info["directions"])

    def texture(coordinates):
        node = f.node("ShaderNodeTexImage", None, coordinates)
        node.image = bpy.data.images.load(file, check_existing=True)
        node.image.colorspace_settings.name = "Non-Color"
        node.image.alpha_mode = "CHANNEL_PACKED"  # alpha is no opacity
        node.extension = "EXTEND"
        return node.outputs

    if info["directionForm"] == "own":
        return f.scale(light, own_factor(f, texture(place)["Color"], n, m))
    if info["directionForm"] == "dominant":
        texel = texture(place)
        halved = f.math("ADD", f.dot(m, f.vector("SUBTRACT", texel["Color"], (0.5, 0.5, 0.5))), 0.5)
        return f.scale(light, f.math("DIVIDE", halved, f.math("MAXIMUM", texel["Alpha"], 1e-4)))
    x, y, _ = f.parts(place)
    layers = [  # the bottom of a picture is v = 0 here
        texture(f.join(x, f.math("DIVIDE", f.math("ADD", y, 3.0 - layer), 4.0), 0.0))["Color"] for layer in range(4)
    ]
    mx, my, mz = f.parts(m)
    total = (1.0, 1.0, 1.0)
    for layer, part in zip(layers[1:], (my, mz, mx)):
        bent = f.scale(f.vector("SUBTRACT", layer, (0.5, 0.5, 0.5)), f.math("MULTIPLY", part, 8.0))
        total = f.vector("ADD", total, bent)
    return f.scale(f.vector("MULTIPLY", layers[0], total), 1 / FACTOR[info["convention"]])


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
    light = image.outputs["Color"]
    if "directions" in info and principled.inputs["Normal"].is_linked:
        bent = principled.inputs["Normal"].links[0].from_socket
        light = bent_light(tree, folder, info, light, place.outputs[0], bent)
    links.new(light, product.inputs["Color2"])
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
