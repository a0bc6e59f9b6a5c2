"""Writes rooms as people build them in Blender: boxes that touch, with the exporter's double-sided materials.

blender --background --factory-startup --python tests/bench/blender_rooms.py -- loft|kitchen OUT.glb

loft: a window wall of four boxes with bars, a curtain, a shelf of books, a sofa, a table, a standing lamp.
kitchen: bevelled cabinets side by side, a window with a frame, open shelves, a table with chairs, two lamps.
Both have a sun. Written for Blender 3.4 (Debian 12).
"""
import math
import random
import sys

import bpy
from mathutils import Vector


def material(name, colour, roughness=1.0, metallic=0.0, emission=None, strength=0):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    node = made.node_tree.nodes["Principled BSDF"]
    node.inputs["Base Color"].default_value = (*colour, 1)
    node.inputs["Roughness"].default_value = roughness
    node.inputs["Metallic"].default_value = metallic
    if emission:
        node.inputs["Emission"].default_value = (*emission, 1)
        node.inputs["Emission Strength"].default_value = strength
    return made


def finish(name, used, smooth=False, by_angle=False):
    made = bpy.context.object
    if smooth:
        bpy.ops.object.shade_smooth()
        made.data.use_auto_smooth = by_angle
    made.data.materials.clear()
    made.data.materials.append(used)
    made.name = made.data.name = name
    return made


def box(low, high, used, name="box", bevel=0.0):
    size = [b - a for a, b in zip(low, high)]
    bpy.ops.mesh.primitive_cube_add(size=1, location=[(a + b) / 2 for a, b in zip(low, high)])
    bpy.context.object.scale = size
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    if bevel:
        modifier = bpy.context.object.modifiers.new("bevel", "BEVEL")
        modifier.width, modifier.segments = bevel, 3
        bpy.ops.object.modifier_apply(modifier="bevel")
    finish(name, used, smooth=bevel > 0, by_angle=True)


def rod(at, radius, height, used, name="rod", sides=24):
    bpy.ops.mesh.primitive_cylinder_add(radius=radius, depth=height, location=at, vertices=sides)
    finish(name, used, smooth=True, by_angle=True)


def ball(at, radius, used, name="ball", subdivisions=4):
    bpy.ops.mesh.primitive_ico_sphere_add(radius=radius, location=at, subdivisions=subdivisions)
    finish(name, used, smooth=True)


def shade(at, wide, narrow, height, used):
    bpy.ops.mesh.primitive_cone_add(radius1=wide, radius2=narrow, depth=height, location=at, vertices=32,
                                    end_fill_type="NOTHING")
    finish("shade", used, smooth=True)


def sun(direction, strength):
    light = bpy.data.lights.new("sun", "SUN")
    light.energy, light.color = strength, (1, 0.95, 0.85)
    made = bpy.data.objects.new("sun", light)
    made.rotation_euler = Vector(direction).to_track_quat("-Z", "Y").to_euler()
    bpy.context.collection.objects.link(made)


def curtain(used):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=60, y_subdivisions=2, size=1, location=(1.3, 4.85, 1.3),
                                    rotation=(math.pi / 2, 0, 0))
    made = bpy.context.object
    made.scale = (0.9, 2.4, 1)
    bpy.ops.object.transform_apply(scale=True)
    for vertex in made.data.vertices:
        vertex.co.z += 0.05 * math.sin(vertex.co.x * 45)
    finish("curtain", used, smooth=True)


def loft():
    random.seed(7)
    white, wood = material("white", (0.8, 0.8, 0.78)), material("wood", (0.45, 0.28, 0.16))
    red, grey = material("red", (0.6, 0.12, 0.1)), material("grey", (0.4, 0.4, 0.42))
    cloth = material("cloth", (0.7, 0.66, 0.5))
    lamp = material("lamp", (0.9, 0.9, 0.9), emission=(1, 0.8, 0.6), strength=12)
    metal = material("metal", (0.8, 0.8, 0.82), roughness=0.35, metallic=1)
    covers = [material(f"cover{i}", tuple(random.uniform(0.1, most) for most in (0.8, 0.7, 0.6)))
              for i in range(6)]
    box((-0.2, -0.2, -0.2), (6.2, 5.2, 0), wood, "floor")
    box((-0.2, -0.2, 2.8), (6.2, 5.2, 3), white, "ceiling")
    box((-0.2, -0.2, 0), (0, 5.2, 2.8), white, "west")
    box((6, -0.2, 0), (6.2, 5.2, 2.8), white, "east")
    box((0, -0.2, 0), (6, 0, 2.8), red, "south")
    box((0, 5, 0), (1.5, 5.2, 2.8), white, "pier")
    box((4.5, 5, 0), (6, 5.2, 2.8), white, "pier")
    box((1.5, 5, 0), (4.5, 5.2, 0.9), white, "sill")
    box((1.5, 5, 2.3), (4.5, 5.2, 2.8), white, "lintel")
    for i in range(5):
        box((1.48 + 0.75 * i, 5.05, 0.9), (1.52 + 0.75 * i, 5.1, 2.3), grey, "bar")
    curtain(cloth)
    for i in range(6):
        box((0.02, 0.3, 0.1 + 0.4 * i), (0.35, 2.1, 0.12 + 0.4 * i), wood, "board")
    box((0.02, 0.28, 0), (0.35, 0.3, 2.2), wood, "side")
    box((0.02, 2.1, 0), (0.35, 2.12, 2.2), wood, "side")
    for i in range(5):
        y, foot = 0.33, 0.12 + 0.4 * i
        while y < 2:
            width, height = random.uniform(0.02, 0.06), random.uniform(0.2, 0.34)
            if random.random() < 0.8:
                box((0.04, y, foot), (0.04 + random.uniform(0.18, 0.28), y + width - 0.002, foot + height),
                    random.choice(covers), "book")
            y += width
    box((2.2, 0.6, 0.15), (4.4, 1.5, 0.45), grey, "seat", bevel=0.06)
    box((2.2, 0.4, 0.15), (4.4, 0.65, 0.95), grey, "back", bevel=0.06)
    box((2, 0.4, 0.15), (2.25, 1.5, 0.65), grey, "arm", bevel=0.06)
    box((4.35, 0.4, 0.15), (4.6, 1.5, 0.65), grey, "arm", bevel=0.06)
    for x in (2.1, 4.5):
        for y in (0.5, 1.4):
            rod((x, y, 0.075), 0.025, 0.15, wood, "foot", 12)
    rod((3.3, 2.6, 0.42), 0.5, 0.03, wood, "top", 48)
    for k in range(3):
        at = (3.3 + 0.35 * math.cos(2.1 * k), 2.6 + 0.35 * math.sin(2.1 * k), 0.2)
        rod(at, 0.015, 0.41, metal, "leg", 12)
    ball((3.3, 2.6, 0.56), 0.12, red, "vase")
    box((2, 1.8, 0), (4.6, 3.4, 0.015), cloth, "rug")
    rod((5.4, 0.6, 0.75), 0.012, 1.5, metal, "pole", 12)
    rod((5.4, 0.6, 0.01), 0.15, 0.02, metal, "base")
    shade((5.4, 0.6, 1.6), 0.22, 0.12, 0.3, cloth)
    ball((5.4, 0.6, 1.55), 0.05, lamp, "bulb", 3)
    sun((0.25, -0.7, -0.6), 20)


def chair(x, y, used):
    box((x, y, 0.43), (x + 0.42, y + 0.42, 0.46), used, "seat")
    for a in (0, 0.38):
        for b in (0, 0.38):
            box((x + a, y + b, 0), (x + a + 0.04, y + b + 0.04, 0.43), used, "leg")
    back = y if y < 1 else y + 0.38
    box((x, back, 0.46), (x + 0.42, back + 0.04, 0.9), used, "back")


def kitchen():
    random.seed(11)
    white, green = material("white", (0.78, 0.78, 0.76)), material("green", (0.3, 0.45, 0.42))
    stone = material("stone", (0.25, 0.24, 0.23), roughness=0.3)
    steel = material("steel", (0.7, 0.7, 0.72), roughness=0.3, metallic=1)
    tile, wood = material("tile", (0.65, 0.6, 0.5)), material("wood", (0.5, 0.33, 0.2))
    lamp = material("lamp", (1, 1, 1), emission=(1, 0.85, 0.6), strength=40)
    black = material("black", (0.15, 0.15, 0.15))
    box((0, 0, -0.1), (5, 4, 0), tile, "floor")
    box((0, 0, 2.6), (5, 4, 2.7), white, "ceiling")
    box((-0.1, 0, 0), (0, 4, 2.6), white, "west")
    box((5, 0, 0), (5.1, 4, 2.6), white, "east")
    box((0, -0.1, 0), (5, 0, 2.6), white, "south")
    for low, high in (((0, 0), (1.8, 2.6)), ((3.4, 0), (5, 2.6)), ((1.8, 0), (3.4, 1)),
                      ((1.8, 2.1), (3.4, 2.6))):
        box((low[0], 4, low[1]), (high[0], 4.15, high[1]), white, "north")
    for low, high in (((1.8, 1), (1.86, 2.1)), ((3.34, 1), (3.4, 2.1)), ((1.8, 1.52), (3.4, 1.58))):
        box((low[0], 4.05, low[1]), (high[0], 4.1, high[1]), wood, "frame")
    for i in range(6):
        x = 0.05 + 0.6 * i
        box((x, 3.4, 0.1), (x + 0.58, 3.98, 0.86), green, "cabinet", bevel=0.008)
        box((x + 0.1, 3.37, 0.75), (x + 0.48, 3.39, 0.77), steel, "handle")
    box((0, 3.36, 0.86), (3.7, 4, 0.9), stone, "counter")
    box((0, 3.4, 0), (3.65, 4, 0.1), black, "plinth")
    for i in range(3):
        x = 0.05 + 0.55 * i
        box((x, 3.66, 1.5), (x + 0.53, 4, 2.2), green, "upper", bevel=0.008)
        box((4.2, 0.3, 0.5 + 0.5 * i), (4.95, 1.8, 0.53 + 0.5 * i), wood, "shelf")
    for i in range(14):
        rod((random.uniform(4.35, 4.85), random.uniform(0.4, 1.7), 0.62 + 0.5 * random.randrange(3)),
            random.uniform(0.03, 0.07), 0.18, random.choice([white, green, tile, steel]), "jar", 16)
    box((1.2, 1.2, 0.72), (3.2, 2.2, 0.76), wood, "table", bevel=0.01)
    for x in (1.25, 3.1):
        for y in (1.25, 2.1):
            box((x, y, 0), (x + 0.05, y + 0.05, 0.72), wood, "leg")
    for x, y in ((1.5, 0.7), (2.5, 0.7), (1.5, 2.5), (2.5, 2.5)):
        chair(x, y, wood)
    for x in (1.7, 2.7):
        rod((x, 1.7, 2.25), 0.006, 0.7, black, "cord", 8)
        shade((x, 1.7, 1.86), 0.18, 0.05, 0.16, black)
        ball((x, 1.7, 1.84), 0.04, lamp, "bulb", 3)
    sun((0.4, -0.8, -0.5), 15)


def main():
    rooms = {"loft": loft, "kitchen": kitchen}
    given = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else []
    if len(given) != 2 or given[0] not in rooms:
        sys.exit("usage: blender ... -- loft|kitchen OUT.glb")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    rooms[given[0]]()
    bpy.ops.export_scene.gltf(filepath=given[1], export_format="GLB", export_lights=True, export_apply=True)


main()
