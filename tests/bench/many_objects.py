#!/usr/bin/env python3
"""Writes a scene of many small objects as a glTF file: a square number of prisms of 28 triangles on a ground,
lit by a sun of 1000 W/m^2.

many_objects.py COUNT OUT.glb
"""
import json
import math
import random
import struct
import sys

SIDES, RADIUS = 7, 0.3  # of a prism of height 1
SPACING = 2.0           # m between objects, about


def make_prism():
    """Positions, normals, indices."""
    position, normal, index = [], [], []
    corner = [(RADIUS * math.cos(2 * math.pi * s / SIDES), -RADIUS * math.sin(2 * math.pi * s / SIDES))
              for s in range(SIDES)]
    for s in range(SIDES):
        (x0, z0), (x1, z1) = corner[s], corner[(s + 1) % SIDES]
        middle = 2 * math.pi * (s + 0.5) / SIDES
        first = len(position)
        position += [(x0, 0, z0), (x1, 0, z1), (x1, 1, z1), (x0, 1, z0)]
        normal += 4 * [(math.cos(middle), 0, -math.sin(middle))]
        index += [first + i for i in (0, 1, 2, 0, 2, 3)]
    for y, up in ((1, 1), (0, -1)):
        first = len(position)
        position += [(0, y, 0)] + [(x, y, z) for x, z in corner]
        normal += (SIDES + 1) * [(0, up, 0)]
        for s in range(SIDES):
            triangle = [first, first + 1 + s, first + 1 + (s + 1) % SIDES]
            index += triangle if up > 0 else triangle[::-1]
    return position, normal, index


def make_ground(half):
    corner = [(-half, 0, -half), (-half, 0, half), (half, 0, half), (half, 0, -half)]
    return corner, 4 * [(0, 1, 0)], [0, 1, 2, 0, 2, 3]


def place(number, row):
    """Node of an object."""
    x, z = ((i - row / 2) * SPACING + random.uniform(-0.6, 0.6) for i in (number % row, number // row))
    return {"mesh": 0, "translation": [round(x, 3), 0, round(z, 3)],
            "scale": 3 * [round(random.uniform(0.5, 2), 2)]}


class Buffer:
    """Bytes of a file, and the accessors into them."""

    def __init__(self):
        self.bytes, self.view, self.accessor = b"", [], []

    def add(self, data, more):
        self.view.append({"buffer": 0, "byteOffset": len(self.bytes), "byteLength": len(data)})
        self.accessor.append({"bufferView": len(self.view) - 1, **more})
        self.bytes += data + b"\0" * (-len(data) % 4)
        return len(self.accessor) - 1

    def add_vectors(self, vector):
        return self.add(b"".join(struct.pack("<3f", *v) for v in vector),
                        {"componentType": 5126, "count": len(vector), "type": "VEC3",
                         "min": [min(column) for column in zip(*vector)],
                         "max": [max(column) for column in zip(*vector)]})

    def add_mesh(self, mesh, material):
        position, normal, index = mesh
        return {"primitives": [{
            "attributes": {"POSITION": self.add_vectors(position), "NORMAL": self.add_vectors(normal)},
            "indices": self.add(struct.pack(f"<{len(index)}H", *index),
                                {"componentType": 5123, "count": len(index), "type": "SCALAR"}),
            "material": material}]}


def matt(colour):
    return {"pbrMetallicRoughness": {"baseColorFactor": colour + [1], "metallicFactor": 0,
                                     "roughnessFactor": 1}}


def main():
    row = math.isqrt(int(sys.argv[1]))
    random.seed(1)
    buffer = Buffer()
    meshes = [buffer.add_mesh(make_prism(), 0), buffer.add_mesh(make_ground(row * SPACING / 2), 1)]
    light = "KHR_lights_punctual"
    nodes = [{"mesh": 1}, {"rotation": [-0.5, 0.2, 0, 0.84], "extensions": {light: {"light": 0}}}]
    nodes += [place(number, row) for number in range(row * row)]
    scene = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}],
             "nodes": nodes, "meshes": meshes, "accessors": buffer.accessor, "bufferViews": buffer.view,
             "buffers": [{"byteLength": len(buffer.bytes)}],
             "materials": [matt([0.5, 0.4, 0.3]), matt([0.3, 0.4, 0.2])],
             "extensionsUsed": [light],
             "extensions": {light: {"lights": [{"type": "directional", "intensity": 1000}]}}}
    text = json.dumps(scene, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    with open(sys.argv[2], "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(buffer.bytes)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(buffer.bytes), b"BIN\0") + buffer.bytes)


main()
