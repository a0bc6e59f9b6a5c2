"""One view of a glTF file in Blender's Cycles, for the scripts beside: scene, camera, picture. Written for Blender 3.4
(Debian 12)."""
import math
import sys

import bpy
import numpy
from mathutils import Matrix, Vector

numpy.bool = bool  # Blender 3.4's glTF importer wants a name that numpy 1.24 has dropped


def open_scene(path):
    """Replaces all objects by those of a glTF file."""
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    bpy.ops.import_scene.gltf(filepath=path)


def to_blender(text):
    """X,Y,Z of a glTF file, where y points up, as a point in Blender, where z does."""
    x, y, z = (float(part) for part in text.split(","))
    return Vector((x, -z, y))


def set_camera(text):
    """PX,PY,PZ:TX,TY,TZ:FOV: position, target, vertical field of view in degrees. None: the scene's first camera."""
    scene = bpy.context.scene
    if text is None:
        scene.camera = next((o for o in bpy.data.objects if o.type == "CAMERA"), None)
        if scene.camera is None:
            sys.exit("the scene has no camera: give --camera")
        return
    position, target, fov = text.split(":")
    eye, aim = to_blender(position), to_blender(target)
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


def render(path, file_format, size, samples):
    """Writes a picture by Cycles on the CPU: no filter but a box of a pixel. size: WxH. Bounces are the caller's."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples = "CPU", samples
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.transparent_max_bounces = 64
    cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x, scene.render.resolution_y = (int(side) for side in size.split("x"))
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = file_format
    if file_format == "OPEN_EXR":
        scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
