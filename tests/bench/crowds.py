#!/usr/bin/env python3
"""Processor seconds of importing meshes whose triangles crowd in one place, as a table.

    tests/bench/crowds.py [--count 100000] [--import build/release/bin/lightwell-import] [--limit 120]
"""
import argparse
import json
import math
import pathlib
import random
import resource
import struct
import subprocess
import tempfile


def fan(n):
    return [(0, 0, 0)] + [(10 * math.cos(2 * math.pi * k / n), 0, 10 * math.sin(2 * math.pi * k / n))
                          for k in range(n)], [x for k in range(n) for x in (0, 1 + (k + 1) % n, 1 + k)]


def coincident(n):
    return [(0, 0, 0), (1, 0, 0), (0, 0, 1)], [0, 2, 1] * n


def book(n):
    return [(0, 0, 0), (0, 1, 0)] + [(math.cos(2 * math.pi * k / n), 0.5, math.sin(2 * math.pi * k / n))
                                     for k in range(n)], [x for k in range(n) for x in (0, 1, 2 + k)]


def strip(n):
    return [(k * 0.001, 0, (k & 1) * 10) for k in range(n + 2)], [
        x for k in range(n) for x in ((k, k + 1, k + 2) if k & 1 else (k + 1, k, k + 2))]


def soup(n):
    r = random.Random(1)
    return [tuple(r.uniform(-1, 1) for _ in range(3)) for _ in range(3 * n)], list(range(3 * n))


def write(path, position, index):
    p = b"".join(struct.pack("<3f", *v) for v in position)
    b = p + struct.pack(f"<{len(index)}I", *index)
    j = json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(b)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(p)},
                        {"buffer": 0, "byteOffset": len(p), "byteLength": len(b) - len(p)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": len(position), "type": "VEC3"},
                      {"bufferView": 1, "componentType": 5125, "count": len(index), "type": "SCALAR"}]}).encode()
    j += b" " * (-len(j) % 4)
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 28 + len(j) + len(b)) +
                     struct.pack("<II", len(j), 0x4E4F534A) + j + struct.pack("<II", len(b), 0x4E4942) + b)


def main():
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--count", type=int, default=100000)
    a.add_argument("--limit", type=float, default=120)
    a.add_argument("--import", dest="program", default="build/release/bin/lightwell-import")
    a = a.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for shape in (fan, coincident, book, strip, soup):
            path = pathlib.Path(folder) / f"{shape.__name__}.glb"
            write(path, *shape(a.count))
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            try:
                subprocess.run([a.program, path, "-o", path.with_suffix(".lwscene"), "--threads", "1"], timeout=a.limit,
                               stderr=subprocess.DEVNULL, check=True)
                end = ""
            except subprocess.TimeoutExpired:
                end = ", stopped"
            now = resource.getrusage(resource.RUSAGE_CHILDREN)
            print(f"| {shape.__name__} | {a.count:,} | {now.ru_utime - before.ru_utime:.1f}{end} |", flush=True)


main()
