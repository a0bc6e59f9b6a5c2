"""Renders a glTF scene in Blender's Cycles by lightwell's conventions, to check lightwell against another renderer.

blender --background --factory-startup --python tests/bench/cycles.py -- SCENE.glb --out FILE.exr
    [--camera PX,PY,PZ:TX,TY,TZ:FOV] [--size WxH] [--spp N] [--bounces N] [--sky R,G,B] [--sun-angle DEG] [--seed N]

Every surface becomes Lambertian with the base colour as albedo; backs of single-sided ones are black and do not shine.
Lights take the units of docs/architecture.md: 1 cd = 1 W/sr, 1 lux = 1 W/m^2, emission = radiance. Written for Blender
3.4 (Debian 12). The file holds linear radiance, box-filtered over pixels.
"""
import argparse
import json
import math
import struct
import sys

import bpy
import numpy
from mathutils import Matrix, Vector

numpy.bool = bool  # Blender 3.4's glTF importer wants a name that numpy 1.24 has dropped


def arguments():
    parser = argparse.ArgumentParser(prog="cycles.py")
    parser.add_argument("scene")
    parser.add_argument("--out", required=True)
    parser.add_argument("--camera")
    parser.add_argument("--size", default="960x540")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--bounces", type=int, default=2)
    parser.add_argument("--sky", default="0,0,0")
    parser.add_argument("--sun-angle", type=float, default=0.53)
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1:])


def read_json(path):
    with open(path, "rb") as file:
        data = file.read()
    if data[:4] != b"glTF":
        return json.loads(data)
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20:20 + length])


def to_blender(v):
    return Vector((v[0], -v[2], v[1]))


def source_of(nodes, socket, links):
    """What feeds a socket: (output socket or None, default value)."""
    if socket is None:
        return None, None
    if socket.is_linked:
        return socket.links[0].from_socket, socket.default_value
    return None, socket.default_value


def connect(links, output, value, socket):
    if output is not None:
        links.new(output, socket)
    else:
        socket.default_value = value


def make_lambertian(material):
    """Rebuilds what the importer made: diffuse reflection and emission of the front, alpha as it is."""
    tree = material.node_tree
    nodes, links = tree.nodes, tree.links
    principled = next((n for n in nodes if n.type == "BSDF_PRINCIPLED"), None)
    output = next(n for n in nodes if n.type == "OUTPUT_MATERIAL")
    if principled is None:
        return
    colour = source_of(nodes, principled.inputs["Base Color"], links)
    alpha = source_of(nodes, principled.inputs["Alpha"], links)
    emission = source_of(nodes, principled.inputs["Emission"], links)
    strength = source_of(nodes, principled.inputs["Emission Strength"], links)

    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    connect(links, *colour, diffuse.inputs["Color"])
    shine = nodes.new("ShaderNodeEmission")
    connect(links, *emission, shine.inputs["Color"])
    connect(links, *strength, shine.inputs["Strength"])
    front = nodes.new("ShaderNodeAddShader")
    links.new(diffuse.outputs[0], front.inputs[0])
    links.new(shine.outputs[0], front.inputs[1])
    surface = front.outputs[0]
    if material.use_backface_culling:
        geometry = nodes.new("ShaderNodeNewGeometry")
        black = nodes.new("ShaderNodeBsdfDiffuse")
        black.inputs["Color"].default_value = (0, 0, 0, 1)
        sides = nodes.new("ShaderNodeMixShader")
        links.new(geometry.outputs["Backfacing"], sides.inputs[0])
        links.new(surface, sides.inputs[1])
        links.new(black.outputs[0], sides.inputs[2])
        surface = sides.outputs[0]
    if alpha[0] is not None or alpha[1] < 1:
        clear = nodes.new("ShaderNodeBsdfTransparent")
        mix = nodes.new("ShaderNodeMixShader")
        connect(links, *alpha, mix.inputs[0])
        links.new(clear.outputs[0], mix.inputs[1])
        links.new(surface, mix.inputs[2])
        surface = mix.outputs[0]
    links.new(surface, output.inputs["Surface"])


def set_lights(gltf, sun_angle_deg):
    """Blender's point and spot lights of P watts send P / (4 pi) W/sr; a sun's strength is W/m^2."""
    lights = gltf.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])
    by_object = {}
    for node in gltf.get("nodes", []):
        use = node.get("extensions", {}).get("KHR_lights_punctual")
        if use is not None:
            by_object.setdefault(node.get("name", ""), lights[use["light"]])
    for thing in bpy.data.objects:
        if thing.type != "LIGHT":
            continue
        spec = by_object.get(thing.name) or (by_object.get(thing.parent.name) if thing.parent else None)
        if spec is None:
            print("cycles.py: no light of the file is called", thing.name, file=sys.stderr)
            continue
        intensity = spec.get("intensity", 1.0)
        thing.data.color = spec.get("color", [1, 1, 1])
        if spec["type"] == "directional":
            thing.data.energy = intensity
            thing.data.angle = math.radians(sun_angle_deg)
        else:
            thing.data.energy = intensity * 4 * math.pi
            thing.data.shadow_soft_size = 0


def set_camera(text, width, height):
    scene = bpy.context.scene
    if text is None:
        camera = next((o for o in bpy.data.objects if o.type == "CAMERA"), None)
        if camera is None:
            sys.exit("cycles.py: the scene has no camera: give --camera")
        scene.camera = camera
        return
    position, target, fov = text.split(":")
    eye = to_blender([float(x) for x in position.split(",")])
    aim = to_blender([float(x) for x in target.split(",")])
    data = bpy.data.cameras.new("view")
    data.sensor_fit = "VERTICAL"
    data.angle = math.radians(float(fov))
    data.clip_start, data.clip_end = 1e-4, 1e6
    camera = bpy.data.objects.new("view", data)
    bpy.context.collection.objects.link(camera)
    backward = (eye - aim).normalized()
    right = Vector((0, 0, 1)).cross(backward).normalized()
    up = backward.cross(right)
    camera.matrix_world = Matrix.Translation(eye) @ Matrix((right, up, backward)).transposed().to_4x4()
    scene.camera = camera


def main():
    args = arguments()
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    bpy.ops.import_scene.gltf(filepath=args.scene)
    for material in bpy.data.materials:
        if material.use_nodes:
            make_lambertian(material)
    set_lights(read_json(args.scene), args.sun_angle)
    width, height = (int(x) for x in args.size.split("x"))
    set_camera(args.camera, width, height)

    scene = bpy.context.scene
    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = [float(x) for x in args.sky.split(",")] + [1]
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", args.spp, args.seed
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = args.bounces
    cycles.transparent_max_bounces = 64
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.exr_codec = "ZIP"
    scene.render.filepath = args.out
    bpy.ops.render.render(write_still=True)


main()
