#!/usr/bin/env python3
"""staircase.py FILE.gltf: a stairwell of small things, lit by two windows; for density.sh.

A room of 5 x 5 x 4 m with a flight of 15 steps, balusters, a handrail, pictures, skirting boards, two pots and a
table with books: 260 m^2 in 102 objects, 0.9 m large in the mean. A camera looks up the flight.
"""
import base64
import json
import math
import struct
import sys

ROOM = (5.0, 5.0, 4.0)  # m
STEPS, TREAD, RISE = 15, 0.27, 0.17
ALBEDO = {
    "wall": (0.75, 0.72, 0.66), "floor": (0.45, 0.30, 0.18), "wood": (0.35, 0.20, 0.10),
    "step": (0.60, 0.50, 0.40), "frame": (0.15, 0.10, 0.08), "picture": (0.30, 0.45, 0.55),
    "pot": (0.65, 0.30, 0.20), "window": (0, 0, 0),
}
WINDOW_RADIANCE = 20  # W/(m^2 sr)
objects = []  # (name, material, positions, normals, triangles)


def add(name, material, positions, normals, triangles):
    objects.append((name, material, positions, normals, triangles))


def box(name, material, centre, half, inward=False, turn=0.0):
    """Sides along the axes, turned about y by `turn` radians; inward: seen from inside."""
    positions, normals, triangles = [], [], []

    def turned(v):
        return (v[0] * math.cos(turn) + v[2] * math.sin(turn), v[1], v[2] * math.cos(turn) - v[0] * math.sin(turn))

    for axis in range(3):
        for side in (-1, 1):
            first = len(positions)
            out = [0, 0, 0]
            out[axis] = -side if inward else side
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = [0, 0, 0]
                corner[axis] = side * half[axis]
                corner[(axis + 1) % 3] = a * half[(axis + 1) % 3]
                corner[(axis + 2) % 3] = b * half[(axis + 2) % 3]
                positions.append(tuple(c + d for c, d in zip(turned(corner), centre)))
                normals.append(turned(out))
            order = (0, 1, 2, 0, 2, 3) if (side > 0) != inward else (0, 2, 1, 0, 3, 2)
            triangles += [first + i for i in order]
    add(name, material, positions, normals, triangles)


def cylinder(name, material, foot, radius, height, sides=20):
    positions, normals, triangles = [], [], []
    ring = [(math.cos(2 * math.pi * i / sides), math.sin(2 * math.pi * i / sides)) for i in range(sides + 1)]
    for x, z in ring:
        for y in (0, height):
            positions.append((foot[0] + radius * x, foot[1] + y, foot[2] + radius * z))
            normals.append((x, 0, z))
    for i in range(0, 2 * sides, 2):
        triangles += [i, i + 1, i + 3, i, i + 3, i + 2]
    top = len(positions)
    for x, z in [(0, 0)] + ring:
        positions.append((foot[0] + radius * x, foot[1] + height, foot[2] + radius * z))
        normals.append((0, 1, 0))
    for i in range(sides):
        triangles += [top, top + 2 + i, top + 1 + i]
    add(name, material, positions, normals, triangles)


def quad(name, material, centre, u, v, normal):
    positions = [tuple(centre[i] + a * u[i] + b * v[i] for i in range(3)) for a, b in
                 ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    add(name, material, positions, [normal] * 4, [0, 1, 2, 0, 2, 3])


def build():
    width, height, depth = ROOM
    floor = 0.02
    box("room", "wall", (0, height / 2, 0), (width / 2, height / 2, depth / 2), inward=True)
    box("floor", "floor", (0, floor / 2, 0), (width / 2, floor / 2, depth / 2))
    for i in range(STEPS):
        x, under = -1.6 + i * TREAD, floor + RISE * i
        box(f"step {i}", "step", (x, under + RISE / 2, -1.3), (0.15, RISE / 2, 0.55))
        box(f"stringer {i}", "step", (x + 0.02, under / 2, -1.3), (0.115, under / 2, 0.5))
        for k in range(2):
            box(f"baluster {i}.{k}", "wood", (x - 0.07 + 0.135 * k, under + RISE + 0.42, -0.8), (0.018, 0.42, 0.018))
        box(f"handrail {i}", "wood", (x, under + RISE + 0.87, -0.8), (0.15, 0.03, 0.035))
    box("landing", "step", (2.25, floor + RISE * (STEPS - 0.5), -1.3), (0.25, RISE / 2, 0.55))
    for i in range(4):
        x, y = -1.5 + 0.95 * i, 1.6 + 0.55 * i
        box(f"frame {i}", "frame", (x, y, -1.97), (0.28, 0.36, 0.03))
        box(f"picture {i}", "picture", (x, y, -1.935), (0.24, 0.32, 0.006))
    box("skirting along", "frame", (0, 0.08, depth / 2 - 0.015), (width / 2, 0.06, 0.015))
    box("skirting across", "frame", (-width / 2 + 0.015, 0.08, 0), (0.015, 0.06, depth / 2))
    cylinder("pot", "pot", (-2.0, floor, 0.9), 0.2, 0.45)
    cylinder("small pot", "pot", (-1.55, floor, 1.3), 0.13, 0.3)
    turn, table = 0.3, (0.9, 1.1)
    box("table", "wood", (table[0], 0.72, table[1]), (0.6, 0.02, 0.35), turn=turn)
    for i, (a, b) in enumerate(((-0.55, -0.3), (0.55, -0.3), (0.55, 0.3), (-0.55, 0.3))):
        x, z = a * math.cos(turn) + b * math.sin(turn), b * math.cos(turn) - a * math.sin(turn)
        box(f"leg {i}", "wood", (table[0] + x, 0.36, table[1] + z), (0.025, 0.34, 0.025), turn=turn)
    for i in range(5):
        tall = 0.1 + 0.01 * (i % 3)
        box(f"book {i}", "picture" if i % 2 else "pot", (0.7 + 0.06 * i, 0.74 + tall, 1.1), (0.02, tall, 0.07),
            turn=turn)
    quad("window", "window", (-width / 2 + 0.01, 3.2, 0.3), (0, 0, -0.6), (0, 0.8, 0), (1, 0, 0))
    quad("high window", "window", (1.2, 4.0, depth / 2 - 0.01), (-0.5, 0, 0), (0, 0.5, 0), (0, 0, -1))


def unit(v):
    length = math.sqrt(sum(x * x for x in v))
    return [x / length for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def camera_node(eye, target):
    back = unit([e - t for e, t in zip(eye, target)])
    right = unit(cross([0, 1, 0], back))
    return {"camera": 0, "matrix": right + [0] + cross(back, right) + [0] + back + [0] + list(eye) + [1]}


def write(path):
    data = bytearray()
    views, accessors, meshes, nodes, materials = [], [], [], [], []

    def accessor(values, kind, layout, component, **bounds):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": 4 * len(values)})
        data.extend(struct.pack(f"<{len(values)}{layout}", *values))
        count = len(values) // (3 if kind == "VEC3" else 1)
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": count, "type": kind,
                          **bounds})
        return len(accessors) - 1

    names = list(ALBEDO)
    for name in names:
        material = {"name": name, "pbrMetallicRoughness": {
            "baseColorFactor": [*ALBEDO[name], 1], "metallicFactor": 0, "roughnessFactor": 1}}
        if name == "window":
            material["emissiveFactor"] = [1, 0.95, 0.85]
            material["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": WINDOW_RADIANCE}}
        materials.append(material)
    for name, material, positions, normals, triangles in objects:
        bounds = {"min": [min(p[i] for p in positions) for i in range(3)],
                  "max": [max(p[i] for p in positions) for i in range(3)]}
        meshes.append({"name": name, "primitives": [{
            "attributes": {"POSITION": accessor([x for p in positions for x in p], "VEC3", "f", 5126, **bounds),
                           "NORMAL": accessor([x for n in normals for x in n], "VEC3", "f", 5126)},
            "indices": accessor(triangles, "SCALAR", "I", 5125), "material": names.index(material)}]})
        nodes.append({"name": name, "mesh": len(meshes) - 1})
    nodes.append(camera_node((2.2, 1.7, 1.6), (-0.4, 1.5, -1.3)))
    with open(path, "w", encoding="utf-8") as file:
        json.dump({
            "asset": {"version": "2.0"}, "extensionsUsed": ["KHR_materials_emissive_strength"], "scene": 0,
            "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes, "meshes": meshes, "materials": materials,
            "cameras": [{"type": "perspective", "perspective": {"yfov": 1.1, "znear": 0.05}}],
            "accessors": accessors, "bufferViews": views, "buffers": [{
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}]}, file)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    build()
    write(sys.argv[1])
