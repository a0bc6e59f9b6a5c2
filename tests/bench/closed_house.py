#!/usr/bin/env python3
"""closed_house.py THICK ANGLE SUN > house.gltf: a closed room on ground that goes on out of doors.

Inside 4 x 3 x 4 m, walls and roof are boxes THICK metres thick, turned by ANGLE radians about y. A lamp of
40 cd inside; outside a sun of SUN W/m^2, or none.
"""
import base64
import json
import math
import struct
import sys

HALF, HIGH, FIELD = 2.0, 3.0, 20.0
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (1, 5, 7, 3), (0, 2, 6, 4))


def box(low, high):
    """Corners, and triangles that look outwards."""
    corners = [tuple((low, high)[i >> (2 - axis) & 1][axis] for axis in range(3)) for i in range(8)]
    return corners, [i for a, b, c, d in FACES for i in (a, b, c, a, c, d)]


def main():
    thick, angle, sun = map(float, sys.argv[1:4])
    inner, outer, f = HALF, HALF + thick, FIELD / 2
    shapes = {
        "ground": ([(-f, 0, f), (f, 0, f), (f, 0, -f), (-f, 0, -f)], [0, 1, 2, 0, 2, 3]),
        "east": box((inner, 0, -inner), (outer, HIGH, inner)),
        "west": box((-outer, 0, -inner), (-inner, HIGH, inner)),
        "north": box((-outer, 0, -outer), (outer, HIGH, -inner)),
        "south": box((-outer, 0, inner), (outer, HIGH, outer)),
        "roof": box((-outer, HIGH, -outer), (outer, HIGH + thick, outer)),
    }
    data, views, accessors, meshes, nodes = b"", [], [], [], []

    def accessor(packed, **fields):
        nonlocal data
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(packed)})
        data += packed + b"\0" * (-len(packed) % 4)
        accessors.append({"bufferView": len(views) - 1, **fields})
        return len(accessors) - 1

    for name, (corners, triangles) in shapes.items():
        position = accessor(b"".join(struct.pack("<3f", *p) for p in corners), componentType=5126,
                            count=len(corners), type="VEC3", min=[min(p[k] for p in corners) for k in range(3)],
                            max=[max(p[k] for p in corners) for k in range(3)])
        index = accessor(struct.pack(f"<{len(triangles)}H", *triangles), componentType=5123,
                         count=len(triangles), type="SCALAR")
        meshes.append({"name": name, "primitives": [
            {"attributes": {"POSITION": position}, "indices": index, "material": 0}]})
        turn = {} if name == "ground" else {"rotation": [0, math.sin(angle / 2), 0, math.cos(angle / 2)]}
        nodes.append({"name": name, "mesh": len(meshes) - 1, **turn})
    lights = [{"name": "lamp", "type": "point", "intensity": 40}]
    nodes.append({"name": "lamp", "translation": [0, 2.5, 0],
                  "extensions": {"KHR_lights_punctual": {"light": 0}}})
    if sun > 0:
        lights.append({"name": "sun", "type": "directional", "intensity": sun})
        nodes.append({"name": "sun", "rotation": [-0.6, 0.2, 0.1, 0.768],
                      "extensions": {"KHR_lights_punctual": {"light": 1}}})
    json.dump({
        "asset": {"version": "2.0"}, "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": lights}},
        "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes, "meshes": meshes,
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.7, 0.7, 0.7, 1], "metallicFactor": 0}}],
        "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data),
                     "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
    }, sys.stdout)


main()
