"""Writes small glTF scenes of one kind of surface each, to compare path tracers lobe by lobe.

python3 tests/bench/lobe_scenes.py FOLDER     writes metal.gltf, varnish.gltf, matt.gltf and bumpy.gltf
Each is a grey room, open in front, with a panel that glows under the ceiling, three balls and a back wall. Surfaces:
    metal     balls of gold, roughness 0.1, 0.3 and 0.6, and a wall of 0.5
    varnish   the same roughnesses with a black base: the gloss of a dielectric alone
    matt      no gloss
    bumpy     a dielectric wall with a normal map, roughness 0.4
"""
import base64
import json
import math
import pathlib
import struct
import sys
import zlib

NO_GLOSS = {"metallicFactor": 0, "roughnessFactor": 1}
ROUGHNESS = (0.1, 0.3, 0.6, 0.5)  # three balls, wall


def quad(corner, u, v):
    corners = [corner, [c + a for c, a in zip(corner, u)], [c + a + b for c, a, b in zip(corner, u, v)],
               [c + b for c, b in zip(corner, v)]]
    n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    length = math.sqrt(sum(x * x for x in n))
    return corners, [[x / length for x in n]] * 4, [[0, 0], [1, 0], [1, 1], [0, 1]], [0, 1, 2, 0, 2, 3]


def ball(centre, radius, rings=48, slices=96):
    position, normal, uv, index = [], [], [], []
    for i in range(rings + 1):
        for j in range(slices + 1):
            a, b = math.pi * i / rings, 2 * math.pi * j / slices
            n = [math.sin(a) * math.cos(b), math.cos(a), -math.sin(a) * math.sin(b)]
            position.append([c + radius * x for c, x in zip(centre, n)])
            normal.append(n)
            uv.append([j / slices, i / rings])
    for i in range(rings):
        for j in range(slices):
            p = i * (slices + 1) + j
            q = p + slices + 1
            index += ([p, q, q + 1] if i < rings - 1 else []) + ([p, q + 1, p + 1] if i else [])
    return position, normal, uv, index


def png(side, texel):
    rows = b"".join(b"\0" + b"".join(bytes(texel(x, y)) for x in range(side)) for y in range(side))

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def waves(x, y, side=256):
    """Normal of rounded bumps, 8 each way, up to 30 degrees off."""
    dx = 0.58 * math.cos(16 * math.pi * (x + 0.5) / side) * math.sin(16 * math.pi * (y + 0.5) / side)
    dy = 0.58 * math.sin(16 * math.pi * (x + 0.5) / side) * math.cos(16 * math.pi * (y + 0.5) / side)
    length = math.sqrt(dx * dx + dy * dy + 1)
    return [round(127.5 + 127.5 * c / length) for c in (dx, dy, 1)]


class Document:
    def __init__(self):
        self.data = b""
        self.gltf = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
                     "accessors": [], "bufferViews": [], "buffers": [], "materials": []}

    def accessor(self, values, kind, code):
        flat = [x for v in values for x in (v if isinstance(v, list) else [v])]
        data = struct.pack("<%d%s" % (len(flat), code), *flat)
        self.gltf["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data
        entry = {"bufferView": len(self.gltf["bufferViews"]) - 1, "count": len(values), "type": kind,
                 "componentType": 5126 if code == "f" else 5125}
        if kind == "VEC3":
            entry["min"] = [min(v[c] for v in values) for c in range(3)]
            entry["max"] = [max(v[c] for v in values) for c in range(3)]
        self.gltf["accessors"].append(entry)
        return len(self.gltf["accessors"]) - 1

    def add(self, shape, material, name):
        position, normal, uv, index = shape
        use = {"POSITION": self.accessor(position, "VEC3", "f"), "NORMAL": self.accessor(normal, "VEC3", "f"),
               "TEXCOORD_0": self.accessor(uv, "VEC2", "f")}
        self.gltf["materials"].append(dict(material, name=name))
        primitive = {"attributes": use, "indices": self.accessor(index, "SCALAR", "I"),
                     "material": len(self.gltf["materials"]) - 1}
        self.gltf["meshes"].append({"name": name, "primitives": [primitive]})
        self.gltf["nodes"].append({"name": name, "mesh": len(self.gltf["meshes"]) - 1})
        self.gltf["scenes"][0]["nodes"].append(len(self.gltf["nodes"]) - 1)

    def write(self, path):
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        self.gltf["buffers"] = [{"byteLength": len(self.data), "uri": uri}]
        path.write_text(json.dumps(self.gltf))


def surface(colour, metallic, roughness):
    return {"pbrMetallicRoughness": {"baseColorFactor": colour + [1], "metallicFactor": metallic,
                                     "roughnessFactor": roughness}}


def scene(path, material_of, bumpy=False):
    document = Document()
    grey = {"pbrMetallicRoughness": dict(NO_GLOSS, baseColorFactor=[0.5, 0.5, 0.5, 1])}
    document.add(quad([-3, 0, -2], [0, 0, 4], [6, 0, 0]), grey, "floor")
    document.add(quad([-3, 3, -2], [6, 0, 0], [0, 0, 4]), grey, "ceiling")
    document.add(quad([-3, 0, -2], [0, 3, 0], [0, 0, 4]), grey, "left")
    document.add(quad([3, 0, -2], [0, 0, 4], [0, 3, 0]), grey, "right")
    document.add(quad([-3, 0, 2], [0, 3, 0], [6, 0, 0]), grey, "front")
    wall = material_of(ROUGHNESS[3])
    if bumpy:
        document.gltf["images"] = [{"uri": "data:image/png;base64," + base64.b64encode(png(256, waves)).decode()}]
        document.gltf["textures"] = [{"source": 0}]
        wall["normalTexture"] = {"index": 0}
    document.add(quad([-3, 0, -2], [6, 0, 0], [0, 3, 0]), wall, "wall")
    lamp = dict(grey, emissiveFactor=[1, 1, 1],
                extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 8}})
    document.gltf["extensionsUsed"] = ["KHR_materials_emissive_strength"]
    document.add(quad([-1, 2.95, -0.5], [2, 0, 0], [0, 0, 1]), lamp, "panel")
    for k in range(0 if bumpy else 3):
        document.add(ball([1.8 * (k - 1), 0.75, -0.6], 0.75), material_of(ROUGHNESS[k]), "ball%d" % k)
    document.write(path)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    scene(folder / "metal.gltf", lambda r: surface([1, 0.77, 0.34], 1, r))
    scene(folder / "varnish.gltf", lambda r: surface([0, 0, 0], 0, r))
    scene(folder / "matt.gltf", lambda r: surface([0.6, 0.4, 0.3], 0, 1))
    scene(folder / "bumpy.gltf", lambda r: surface([0.6, 0.4, 0.3], 0, 0.4), bumpy=True)


main()
