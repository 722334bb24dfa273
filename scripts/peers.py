#!/usr/bin/env python3
"""Renders a GLB with the renderers that are installed, Cycles (`pip install bpy`) and Mitsuba (`pip install mitsuba`), and prints what it
took as JSON: one object per renderer and number of samples. The section `peers` of the report runs it; nothing else needs it.

    python3 scripts/peers.py SCENE.glb --size 256x192 --samples 16,64 --bounces 6 --out FOLDER

Each picture is a linear EXR in FOLDER under all lights of the file: no denoiser, no clamp, no adaptive sampling, a pixel-wide box filter,
a black world. Times are seconds of this process for rendering and writing the picture, loading the file not counted; Cycles builds its
hierarchy within the call that renders, so that it is counted, while Mitsuba has built its own when it has loaded. Mitsuba reads no glTF: it gets
triangles, base colors and emission, all surfaces diffuse, so that its pictures fit scenes that are; punctual lamps are left out.
"""

import argparse
import json
import math
import os
import resource
import struct
import subprocess
import sys
import tempfile
import time

RENDERERS = ("cycles", "mitsuba")
COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def cpu_secs():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def timed(work):
    """Seconds of the CPU and by the clock that `work` takes."""
    cpu, wall = cpu_secs(), time.monotonic()
    work()
    return {"cpu_secs": cpu_secs() - cpu, "secs": time.monotonic() - wall}


def shine_forward(material):
    """Lets one-sided emitters shine from their front alone, as glTF means it; Cycles lets them shine from both."""
    if not (material.use_nodes and material.use_backface_culling):
        return
    nodes, links = material.node_tree.nodes, material.node_tree.links
    for shader in [node for node in nodes if node.type == "BSDF_PRINCIPLED"]:
        strength = shader.inputs["Emission Strength"]
        front = nodes.new("ShaderNodeMath")
        front.operation = "MULTIPLY_ADD"
        front.inputs[1].default_value = -strength.default_value
        front.inputs[2].default_value = strength.default_value
        links.new(nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], front.inputs[0])
        links.new(front.outputs[0], strength)


def cycles(args, samples, path):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=args.scene)
    scene = bpy.context.scene
    for material in bpy.data.materials:
        shine_forward(material)
    scene.camera = next(thing for thing in scene.objects if thing.type == "CAMERA")
    # The file has the vertical angle of view; Blender's sensor is as wide as its longer side.
    scene.camera.data.sensor_fit = "VERTICAL"
    scene.camera.data.angle_y = glb(args.scene)[1][1]
    scene.world = None
    render, settings = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = args.size
    render.resolution_percentage = 100
    render.filepath = path
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    settings.samples = samples
    settings.seed = args.seed
    settings.use_adaptive_sampling = settings.use_denoising = False
    settings.sample_clamp_direct = settings.sample_clamp_indirect = 0.0
    settings.pixel_filter_type = "BOX"
    settings.max_bounces = args.bounces
    settings.diffuse_bounces = settings.glossy_bounces = settings.transmission_bounces = args.bounces
    took = timed(lambda: bpy.ops.render.render(write_still=True))
    return {"version": bpy.app.version_string, **took}


def glb(path):
    """The meshes of a GLB (vertices, triangles, base color, radiance), the camera's matrix and its vertical angle of view."""
    import numpy

    with open(path, "rb") as file:
        data = file.read()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def accessor(index):
        entry = document["accessors"][index]
        view = document["bufferViews"][entry["bufferView"]]
        kind, width = numpy.dtype(COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]]
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        stride = view.get("byteStride", width * kind.itemsize)
        shape = (entry["count"], width)
        return numpy.ndarray(shape, kind, binary, start, (stride, kind.itemsize)).copy()

    def matrix(node):
        if "matrix" in node:
            return numpy.array(node["matrix"], float).reshape(4, 4).T
        x, y, z, w = node.get("rotation", (0, 0, 0, 1))
        turn = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        whole = numpy.eye(4)
        whole[:3, :3] = numpy.array(turn) * node.get("scale", (1, 1, 1))
        whole[:3, 3] = node.get("translation", (0, 0, 0))
        return whole

    meshes, cameras = [], []

    def visit(index, parent):
        node = document["nodes"][index]
        world = parent @ matrix(node)
        if "camera" in node:
            cameras.append((world, document["cameras"][node["camera"]]["perspective"]["yfov"]))
        for part in document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else ():
            points = accessor(part["attributes"]["POSITION"])
            corners = accessor(part["indices"]) if "indices" in part else numpy.arange(len(points))
            material = document["materials"][part["material"]] if "material" in part else {}
            strength = material.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1)
            meshes.append((
                points @ world[:3, :3].T + world[:3, 3],
                corners.reshape(-1, 3),
                material.get("pbrMetallicRoughness", {}).get("baseColorFactor", (1, 1, 1, 1))[:3],
                [strength * x for x in material.get("emissiveFactor", (0, 0, 0))],
            ))
        for child in node.get("children", ()):
            visit(child, world)

    for root in document["scenes"][document.get("scene", 0)]["nodes"]:
        visit(root, numpy.eye(4))
    return meshes, *cameras[:1]


def ply(path, points, triangles):
    import numpy

    faces = numpy.empty(len(triangles), [("n", "u1"), ("corners", "<i4", 3)])
    faces["n"], faces["corners"] = 3, triangles
    head = "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face {}\nproperty list uchar int vertex_indices\nend_header\n"
    with open(path, "wb") as file:
        file.write(head.format(len(points), len(triangles)).encode())
        file.write(points.astype("<f4").tobytes())
        file.write(faces.tobytes())


def mitsuba(args, samples, path):
    import mitsuba as mi

    mi.set_variant({"llvm": "llvm_ad_rgb", "scalar": "scalar_rgb"}[args.variant])
    meshes, (world, yfov) = glb(args.scene)
    width, height = args.size
    to_world = mi.ScalarTransform4f(world) @ mi.ScalarTransform4f().rotate([0, 1, 0], 180)
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": args.bounces + 2, "rr_depth": 3},
        "sensor": {
            "type": "perspective",
            "fov": math.degrees(yfov),
            "fov_axis": "y",
            "to_world": to_world,
            "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
            "sampler": {"type": "multijitter", "sample_count": samples},
        },
    }
    with tempfile.TemporaryDirectory() as folder:
        for number, (points, triangles, color, radiance) in enumerate(meshes):
            name = os.path.join(folder, f"{number}.ply")
            ply(name, points, triangles)
            diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(color)}}
            shape = {"type": "ply", "filename": name, "face_normals": True, "bsdf": {"type": "twosided", "bsdf": diffuse}}
            if max(radiance) > 0:
                shape["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": radiance}}
            scene[f"mesh{number}"] = shape
        loaded = mi.load_dict(scene)

    def render(seed):
        mi.util.write_bitmap(path, mi.render(loaded, spp=samples, seed=seed))

    if args.variant == "llvm":
        # Kernels are compiled by the first picture, which is not counted.
        render(args.seed + 1000)
    took = timed(lambda: render(args.seed))
    return {"version": f"{mi.__version__} ({args.variant})", **took}


def rendered(args, renderer, samples):
    """What one renderer took in a process of its own, or `None` where it is not installed."""
    module = {"cycles": "bpy", "mitsuba": "mitsuba"}[renderer]
    if subprocess.run([sys.executable, "-c", f"import {module}"], capture_output=True).returncode:
        return None
    # Mitsuba's vectorized variant compiles with a library that may be missing or not know the processor: it ends the process then.
    variants = ("llvm", "scalar") if args.variant == "fastest" and renderer == "mitsuba" else (args.variant,)
    for variant in variants:
        call = [sys.executable, __file__, *sys.argv[1:], "--only", renderer, "--samples", str(samples), "--variant", variant]
        told = subprocess.run(call, capture_output=True, text=True)
        if not told.returncode:
            return json.loads(told.stdout.strip().splitlines()[-1])
    sys.exit(f"{renderer}: {told.stderr.strip()}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--size", default="256x192", type=lambda text: tuple(map(int, text.split("x"))))
    parser.add_argument("--samples", default="16,64")
    parser.add_argument("--bounces", default=6, type=int)
    parser.add_argument("--seed", default=1, type=int)
    parser.add_argument("--out", default=".")
    parser.add_argument("--variant", default="fastest", choices=("fastest", "scalar", "llvm"), help="of Mitsuba")
    parser.add_argument("--only", choices=RENDERERS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    samples = [int(number) for number in args.samples.split(",")]
    if args.only:
        path = os.path.abspath(os.path.join(args.out, f"{args.only}-{samples[0]}.exr"))
        took = {"cycles": cycles, "mitsuba": mitsuba}[args.only](args, samples[0], path)
        print(json.dumps({"renderer": args.only, "samples": samples[0], "picture": path, **took}))
        return
    rows = (rendered(args, renderer, number) for renderer in RENDERERS for number in samples)
    print(json.dumps([row for row in rows if row]))


if __name__ == "__main__":
    main()
