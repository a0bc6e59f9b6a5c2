#!/usr/bin/env python3
"""A recorded run: a lamp is carried past a vase, then the vase is moved, then nothing is; pictures and counters.

    tests/bench/record.py BIN OUT [DAEMON OPTIONS]

builtin:atrium, its animation held, moved by lightwellctl, a command a frame; the daemon's clock is manual. Into OUT: picture_NN.png as
a client sees it, every PICTURES commands or rests, at one exposure; counters.csv, a row a frame; counters.png (gnuplot).
BIN: build/release/bin.
"""
import os
import subprocess
import sys
import tempfile
import time

from plots import plot, write_csv
from seen import Daemon, view

SCENE = "builtin:atrium"
CAMERA = "-7.6,1.5,7.7:-4.0,0.8,6.0:58"
SETTLE, LAMP, VASE, REST = 6, 12, 6, 16  # frames of each part
PICTURES = 4
EXPOSURE = "-2"
COUNTERS = ["frame", "changes", "rays_shadow", "rays_bounce", "texels_solved", "tiles_solved", "tiles_wanted", "tiles_feeding",
            "tiles_encoded", "bytes_encoded", "solve_cpu_ms", "publish_cpu_ms"]


def commands():
    """What is done before each frame."""
    yield from [None] * SETTLE
    for i in range(LAMP):
        yield "move lantern %.3f 1.2 7.3" % (-2.5 - 2.5 * i / (LAMP - 1))
    for i in range(VASE):
        yield "move amphora %.3f 0.575 %.3f" % (-5.05 + 0.6 * (i + 1) / VASE, 5.72 + 0.4 * (i + 1) / VASE)
    yield from [None] * REST


def frames_of(tools, daemon, command):
    """The frame that shows a command, behind those that came before it had arrived: one, or on a busy machine more."""
    ctl = subprocess.Popen([tools + "/lightwellctl", daemon.address, *command.split()], stdout=subprocess.DEVNULL)
    said = [{"changes": 0}]
    while not said[-1]["changes"]:
        time.sleep(0.5)
        said.append(daemon.frame())
    assert ctl.wait() == 0
    return said[1:]


def main():
    tools, out = sys.argv[1:3]
    os.makedirs(out, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        daemon = Daemon(tools, SCENE, "seen", ["--freeze", "0"] + sys.argv[3:], folder)
        daemon.frame()
        audience = subprocess.Popen(view(tools, daemon.address, CAMERA, "--wait", "seconds:100000", "--out",
                                         os.path.join(folder, "none.exr")), stderr=subprocess.DEVNULL)
        while not daemon.frame()["tiles_wanted"]:
            time.sleep(0.5)
        for number, command in enumerate(commands(), 1):
            for said in frames_of(tools, daemon, command) if command else [daemon.frame()]:
                rows.append({key: said[key] for key in COUNTERS})
            if number % PICTURES == 0:
                subprocess.run(view(tools, daemon.address, CAMERA, "--wait", "complete", "--exposure", EXPOSURE, "--out",
                                    os.path.join(out, "picture_%02d.png" % number)), check=True, stderr=subprocess.DEVNULL)
        audience.kill()
        audience.wait()
        daemon.stop()
    write_csv(os.path.join(out, "counters.csv"), rows)

    def line(*keys, scale=1):
        return [(i, scale * sum(row[key] for key in keys)) for i, row in enumerate(rows, 1)]

    plot(os.path.join(out, "counters.png"),
         [{"title": "rays a frame", "x": "frame", "y": "millions",
           "lines": {"all": line("rays_shadow", "rays_bounce", scale=1e-6), "shadow": line("rays_shadow", scale=1e-6)}},
          {"title": "tiles a frame", "x": "frame", "y": "tiles",
           "lines": {"solved": line("tiles_solved"), "encoded": line("tiles_encoded")}},
          {"title": "bytes a frame", "x": "frame", "y": "kB",
           "lines": {"encoded": line("bytes_encoded", scale=1e-3)}},
          {"title": "CPU time a frame", "x": "frame", "y": "ms",
           "lines": {"solve": line("solve_cpu_ms"), "publish": line("publish_cpu_ms")}}], 2)


main()
