"""Renders a glTF scene in Blender's Cycles by lightwell's conventions, to check lightwell against another renderer.

blender --background --factory-startup --python tests/bench/cycles.py -- SCENE.glb --out FILE.exr
    [--camera PX,PY,PZ:TX,TY,TZ:FOV] [--size WxH] [--spp N] [--bounces N] [--sky R,G,B] [--sun-angle DEG] [--seed N]
    [--materials full|matt] [--gloss split|principled]

--materials matt: every surface becomes Lambertian with the base colour as albedo. full, the default: surfaces have
the file's roughness, metalness and normal maps, built of
    split       for the metal and the gloss Principled (GGX) of metalness 1, whose Fresnel is that of a smooth
                dielectric of ior 1.3 between its colour and 1, near to Schlick's. By tables over view and roughness it
                is scaled to what glTF's facets (Schlick, height-correlated masking) send back of even light. Diffuse
                has what the gloss leaves of the base, and what facets send back many times.
    principled  Principled (MULTI_GGX) for the metal, and for the gloss on a black base, which is added to Diffuse as
                above. Its Fresnel is that of a smooth dielectric: at 60 degrees 0.089 where Schlick's has 0.070.
Cycles darkens Diffuse where a bumped normal leans (its bump_shadowing_term, after Estevez et al. 2019), and we do not:
its colour is divided by the mean of that factor over directions. Silence about metalness and roughness, and 0 and 1 of them, are matt, as docs/importing.md has it. Backs of single-sided
surfaces are black and do not shine.
Lights take the units of docs/architecture.md: 1 cd = 1 W/sr, 1 lux = 1 W/m^2, emission = radiance. Written for Blender
3.4 (Debian 12). The file holds linear radiance, box-filtered over pixels.
"""
import argparse
import json
import math
import os
import re
import struct
import sys

import bpy
import numpy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import blender_view


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
    parser.add_argument("--materials", choices=["full", "matt"], default="full")
    parser.add_argument("--gloss", choices=["split", "principled"], default="split")
    return parser.parse_args(sys.argv[sys.argv.index("--") + 1:])


def read_json(path):
    with open(path, "rb") as file:
        data = file.read()
    if data[:4] != b"glTF":
        return json.loads(data)
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20:20 + length])


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


SIDE = 32  # entries of a table, each way: cosine (i / (SIDE - 1))^2, roughness j / (SIDE - 1)
F0, F0_MEAN = 0.04, 0.04 + 0.96 / 21  # of a gloss, by Schlick: at normal incidence, and the mean over directions
IOR = 1.3  # of Principled's Fresnel


def smooth_fresnel(cosine, ior):
    """Of a smooth dielectric, from 0 at normal incidence to 1 at grazing, as Principled blends colours by it."""
    inside = numpy.sqrt(1 - (1 - cosine * cosine) / (ior * ior))
    s, p = (cosine - ior * inside) / (cosine + ior * inside), (ior * cosine - inside) / (ior * cosine + inside)
    least = ((ior - 1) / (ior + 1)) ** 2
    return (0.5 * (s * s + p * p) - least) / (1 - least)


def facets_once(cosine, roughness, samples=2048):
    """Of light along a direction what GGX facets send back once, of 1 - c and of c: c is Schlick's (1 - cos)^5 with
    height-correlated masking; then c of Principled, with masking and shadowing apart, as Cycles 3.4 has them."""
    alpha2 = max(roughness * roughness, 1e-3) ** 2
    k = (numpy.arange(samples) + 0.5) / samples
    phi = 2 * math.pi * ((numpy.arange(samples) * 0.6180339887) % 1)
    z = numpy.sqrt((1 - k) / (1 + (alpha2 - 1) * k))
    v = math.sqrt(1 - cosine * cosine)
    with_half = numpy.sqrt(1 - z * z) * numpy.cos(phi) * v + z * cosine
    light = 2 * with_half * z - cosine
    up = (light > 0) & (with_half > 0)
    light, with_half, z = light[up], numpy.minimum(with_half[up], 1), z[up]

    def stretch(c):
        return numpy.sqrt(alpha2 + (1 - alpha2) * c * c)

    jacobian = 4 * with_half / z * light / samples
    shown = 0.5 / (light * stretch(cosine) + cosine * stretch(light)) * jacobian
    apart = 1 / ((light + stretch(light)) * (cosine + stretch(cosine))) * jacobian
    c, d = (1 - with_half) ** 5, smooth_fresnel(with_half, IOR)
    return (shown * (1 - c)).sum(), (shown * c).sum(), (apart * (1 - d)).sum(), (apart * d).sum()


def many_times(f, mean):
    return f * f * mean / (1 - f * (1 - mean))


def kept_of_bump(cosine, samples=4096):
    """Mean of Cycles' bump_shadowing_term over cosine-weighted light about a normal that leans by that cosine, of
    light from above the plain surface."""
    k = (numpy.arange(samples) + 0.5) / samples
    phi = 2 * math.pi * ((numpy.arange(samples) * 0.6180339887) % 1)
    with_normal = numpy.sqrt(k)
    with_plain = with_normal * cosine + numpy.sqrt(1 - k) * numpy.cos(phi) * math.sqrt(1 - cosine * cosine)
    up = with_plain > 0
    g = numpy.minimum(with_plain[up] / (with_normal[up] * cosine), 1)
    return (g + g * g - g * g * g).mean()


def make_tables():
    """Images over (cosine, roughness): once: A, B of glTF's facets, which send back f0 A + B, and what a gloss leaves;
    own: the same two of Principled, and the mean of A + B. lean: kept_of_bump()."""
    once, own = numpy.ones((SIDE, SIDE, 4), "f"), numpy.ones((SIDE, SIDE, 4), "f")
    weight = (numpy.arange(SIDE) / (SIDE - 1)) ** 3  # cosine x d cosine, of cosine = x^2
    for j in range(SIDE):
        shares = [facets_once(max(i / (SIDE - 1), 0.02) ** 2, j / (SIDE - 1)) for i in range(SIDE)]
        a, b, own_a, own_b = numpy.array(shares).T
        e = numpy.minimum(a + b, 1)
        mean = (e * weight).sum() / weight.sum()
        gloss = F0 * a + b + (1 - e) * many_times(F0_MEAN, mean)
        once[j, :, 0], once[j, :, 1], once[j, :, 2] = a, b, 1 - gloss
        own[j, :, 0], own[j, :, 1], own[j, :, 2] = own_a, own_b, mean
    lean = numpy.ones((SIDE, SIDE, 4), "f")
    lean[:, :, 0] = [kept_of_bump(max(i / (SIDE - 1), 0.02)) for i in range(SIDE)]
    images = []
    for name, table in (("once", once), ("own", own), ("lean", lean)):
        image = bpy.data.images.new(name, SIDE, SIDE, float_buffer=True, is_data=True)
        image.pixels.foreach_set(table.ravel())
        image.update()
        image.pack()
        images.append(image)
    return images


class Graph:
    """Makes nodes of a material: sockets or numbers go in, a socket comes out."""

    def __init__(self, tree):
        self.nodes, self.links = tree.nodes, tree.links

    def feed(self, value, socket):
        if isinstance(value, bpy.types.NodeSocket):
            self.links.new(value, socket)
        else:
            socket.default_value = value

    def math(self, operation, *values):
        node = self.nodes.new("ShaderNodeMath")
        node.operation = operation
        for value, socket in zip(values, node.inputs):
            self.feed(value, socket)
        return node.outputs[0]

    def vector(self, operation, *values, output=0):
        node = self.nodes.new("ShaderNodeVectorMath")
        node.operation = operation
        for value, socket in zip(values, node.inputs):
            self.feed(value, socket)
        return node.outputs[output]

    def scale(self, vector, factor):
        node = self.nodes.new("ShaderNodeVectorMath")
        node.operation = "SCALE"
        self.feed(tuple(vector)[:3] if hasattr(vector, "__len__") else vector, node.inputs[0])
        self.feed(factor, node.inputs["Scale"])
        return node.outputs[0]

    def look_up(self, image, at):
        node = self.nodes.new("ShaderNodeTexImage")
        node.image, node.interpolation, node.extension = image, "Linear", "EXTEND"
        self.links.new(at, node.inputs[0])
        split = self.nodes.new("ShaderNodeSeparateRGB")
        self.links.new(node.outputs["Color"], split.inputs[0])
        return split.outputs

    def shader(self, kind, normal, **inputs):
        node = self.nodes.new(kind)
        for name, value in inputs.items():
            self.feed(value, node.inputs[name.replace("_", " ")])
        if normal is not None:
            self.links.new(normal, node.inputs["Normal"])
        return node

    def join(self, kind, first, second, factor=None):
        node = self.nodes.new(kind)
        if factor is not None:
            self.feed(factor, node.inputs[0])
        self.links.new(first, node.inputs[-2])
        self.links.new(second, node.inputs[-1])
        return node.outputs[0]


def make_diffuse(graph, colour, normal, tables):
    if normal is None:
        return graph.shader("ShaderNodeBsdfDiffuse", None, Color=colour)
    geometry = graph.nodes.new("ShaderNodeNewGeometry")
    lean = graph.vector("DOT_PRODUCT", normal, geometry.outputs["Normal"], output="Value")
    at = graph.nodes.new("ShaderNodeCombineXYZ")
    graph.feed(graph.math("MULTIPLY_ADD", lean, (SIDE - 1) / SIDE, 0.5 / SIDE), at.inputs[0])
    at.inputs[1].default_value = 0.5
    kept = graph.look_up(tables[2], at.outputs[0])[0]
    return graph.shader("ShaderNodeBsdfDiffuse", normal, Color=graph.scale(colour, graph.math("DIVIDE", 1.0, kept)))


def make_gloss(graph, principled, kind, tables):
    """The surface of a material with its file's roughness, metalness and normal map."""
    def value(name):
        output, default = source_of(None, principled.inputs[name], None)
        if output is not None:
            return output
        return tuple(default)[:3] if hasattr(default, "__len__") else default

    base, metal, rough = value("Base Color"), value("Metallic"), value("Roughness")
    normal = source_of(None, principled.inputs["Normal"], None)[0]
    geometry = graph.nodes.new("ShaderNodeNewGeometry")
    seen = graph.vector("DOT_PRODUCT", normal or geometry.outputs["Normal"], geometry.outputs["Incoming"],
                        output="Value")
    at = graph.nodes.new("ShaderNodeCombineXYZ")
    side = (SIDE - 1) / SIDE
    cosine = graph.math("SQRT", graph.math("MAXIMUM", seen, 0.0))
    graph.feed(graph.math("MULTIPLY_ADD", cosine, side, 0.5 / SIDE), at.inputs[0])
    graph.feed(graph.math("MULTIPLY_ADD", rough, side, 0.5 / SIDE), at.inputs[1])
    once = graph.look_up(tables[0], at.outputs[0])
    own = graph.look_up(tables[1], at.outputs[0])

    dielectric = graph.math("SUBTRACT", 1.0, metal)
    plain = graph.vector("ADD", (0, 0, 0), base) if not isinstance(base, tuple) else base
    under = graph.scale(plain, graph.math("MULTIPLY", dielectric, once[2]))
    if kind == "principled":
        diffuse = make_diffuse(graph, under, normal, tables)
        of_metal = graph.shader("ShaderNodeBsdfPrincipled", normal, Base_Color=base if not isinstance(base, tuple)
                                else base + (1,), Metallic=1.0, Roughness=rough)
        of_gloss = graph.shader("ShaderNodeBsdfPrincipled", normal, Base_Color=(0, 0, 0, 1), Metallic=0.0,
                                Roughness=rough, Specular=0.5)
        of_metal.distribution = of_gloss.distribution = "MULTI_GGX"
        mirrored = graph.join("ShaderNodeMixShader", of_gloss.outputs[0], of_metal.outputs[0], metal)
        return graph.join("ShaderNodeAddShader", diffuse.outputs[0], mirrored)
    f0 = graph.vector("ADD", graph.scale(plain, metal), graph.scale((F0, F0, F0), dielectric))
    grey = graph.vector("DOT_PRODUCT", f0, (1 / 3, 1 / 3, 1 / 3), output="Value")

    def sent(table):
        return graph.math("MULTIPLY_ADD", grey, table[0], table[1])

    scale = graph.math("DIVIDE", sent(once), sent(own))
    # F of many times: f^2 E / (1 - f (1 - E)), f = 20/21 f0 + 1/21
    mean = graph.vector("ADD", graph.scale(f0, 20 / 21), (1 / 21, 1 / 21, 1 / 21))
    lost = graph.vector("SUBTRACT", (1, 1, 1), graph.scale(mean, graph.math("SUBTRACT", 1.0, own[2])))
    many = graph.vector("DIVIDE", graph.scale(graph.vector("MULTIPLY", mean, mean), own[2]), lost)
    once_lost = graph.math("MAXIMUM", graph.math("SUBTRACT", 1.0, graph.math("ADD", once[0], once[1])), 0.0)
    diffuse = make_diffuse(graph, graph.vector("ADD", under, graph.scale(many, once_lost)), normal, tables)
    glossy = graph.shader("ShaderNodeBsdfPrincipled", normal, Base_Color=f0, Metallic=1.0, Roughness=rough,
                          Specular=((IOR - 1) / (IOR + 1)) ** 2 / 0.08)
    glossy.distribution = "GGX"
    # A mix scales by 1 at most, and the scale may be more: two halves.
    black = graph.shader("ShaderNodeBsdfDiffuse", None, Color=(0, 0, 0, 1))
    half = graph.join("ShaderNodeMixShader", black.outputs[0], glossy.outputs[0],
                      graph.math("MULTIPLY", scale, 0.5))
    mirrored = graph.join("ShaderNodeAddShader", half, half)
    return graph.join("ShaderNodeAddShader", diffuse.outputs[0], mirrored)


def says_gloss(gltf):
    """Names of the materials that are not matt."""
    names = set()
    for material in gltf.get("materials", []):
        pbr, more = material.get("pbrMetallicRoughness", {}), material.get("extensions", {})
        mapped = "metallicRoughnessTexture" in pbr or {"KHR_materials_specular", "KHR_materials_ior"} & more.keys()
        said = mapped or "metallicFactor" in pbr or "roughnessFactor" in pbr
        even = pbr.get("metallicFactor", 1) == 0 and pbr.get("roughnessFactor", 1) == 1
        if said and (mapped or not even):
            names.add(material.get("name", ""))
    return names


def make_surface(material, gloss, tables):
    """Rebuilds what the importer made: reflection and emission of the front, alpha as it is. gloss: None: matt. tables:
    None: no normal maps."""
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

    graph = Graph(tree)
    if gloss is not None:
        reflection = make_gloss(graph, principled, gloss, tables)
    else:
        normal = source_of(nodes, principled.inputs["Normal"], links)[0] if tables else None
        diffuse = make_diffuse(graph, colour[1] if colour[0] is None else colour[0], normal, tables)
        reflection = diffuse.outputs[0]
    shine = nodes.new("ShaderNodeEmission")
    connect(links, *emission, shine.inputs["Color"])
    connect(links, *strength, shine.inputs["Strength"])
    front = nodes.new("ShaderNodeAddShader")
    links.new(reflection, front.inputs[0])
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


def main():
    args = arguments()
    blender_view.open_scene(args.scene)
    full = args.materials == "full"
    gltf = read_json(args.scene)
    glossy = says_gloss(gltf)
    tables = make_tables() if full else None
    for material in bpy.data.materials:
        if material.use_nodes:
            # Blender numbers what the file calls alike: marble, marble.001
            names = {material.name, re.sub(r"\.\d{3}$", "", material.name)}
            gloss = args.gloss if full and names & glossy else None
            make_surface(material, gloss, tables)
    set_lights(gltf, args.sun_angle)
    blender_view.set_camera(args.camera)

    scene = bpy.context.scene
    world = bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = [float(x) for x in args.sky.split(",")] + [1]
    cycles = scene.cycles
    cycles.seed = args.seed
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = args.bounces
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    cycles.caustics_reflective, cycles.caustics_refractive, cycles.blur_glossy = full, False, 0
    scene.render.image_settings.exr_codec = "ZIP"
    blender_view.render(args.out, "OPEN_EXR", args.size, args.spp)


main()
