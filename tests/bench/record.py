#!/usr/bin/env python3
"""A recorded run: a lamp is carried past a vase, then the vase is moved, then nothing is; pictures and counters; and the same
place solved again.

    tests/bench/record.py BIN OUT [DAEMON OPTIONS]

builtin:atrium-matt, its animation held, moved by lightwellctl, a command a frame; the daemon's clock is manual. Into OUT: picture_NN.png as
a client sees it, every PICTURES commands or rests, at one exposure, and all of them on one sheet (pictures.png); fresh.png, the last of
them beside what another daemon shows that never knew another state; counters.csv, a row a frame; counters.png (gnuplot). Printed: relMSE
of the last picture against the other daemon's, and that of a second such daemon with another seed. BIN: build/release/bin.
"""
import os
import subprocess
import sys
import tempfile
import time

from plots import plot, sheet, write_csv
from seen import Daemon, rel_mse, view

SCENE = "builtin:atrium-matt"
CAMERA = "-7.6,1.5,7.7:-4.0,0.8,6.0:58"
LAMP_FROM, LAMP_TO, VASE_FROM, VASE_TO = -2.5, -5.0, (-5.05, 5.72), (-4.45, 6.12)
SETTLE, LAMP, VASE, REST = 32, 16, 8, 40  # frames of each part
FRESH = 48  # frames of the new solve
PICTURES = 8
EXPOSURE = "-2"
COUNTERS = ["frame", "changes", "rays_shadow", "rays_bounce", "texels_solved", "tiles_solved", "tiles_interest", "tiles_contributing",
            "tiles_encoded", "bytes_encoded", "solve_cpu_ms", "publish_cpu_ms"]


def commands():
    """What is done before each frame."""
    yield from [None] * SETTLE
    for i in range(LAMP):
        yield lamp_at(i / (LAMP - 1))
    for i in range(VASE):
        yield vase_at((i + 1) / VASE)
    yield from [None] * REST


def between(first, last, share):
    return first + (last - first) * share


def lamp_at(share):
    return "move lantern %.3f 1.2 7.3" % between(LAMP_FROM, LAMP_TO, share)


def vase_at(share):
    return "move amphora %.3f 0.575 %.3f" % tuple(between(a, b, share) for a, b in zip(VASE_FROM, VASE_TO))


def frames_of(tools, daemon, command):
    """The frame that shows a command, behind those that came before it had arrived: one, or on a busy machine more."""
    ctl = subprocess.Popen([tools + "/lightwellctl", daemon.address, *command.split()], stdout=subprocess.DEVNULL)
    said = [{"changes": 0}]
    while not said[-1]["changes"]:
        time.sleep(0.5)
        said.append(daemon.frame())
    assert ctl.wait() == 0
    return said[1:]


class Stage:
    """A daemon with a viewer."""

    def __init__(self, tools, options, folder, name):
        self.tools, self.folder, self.name = tools, folder, name
        os.makedirs(os.path.join(folder, name))
        self.daemon = Daemon(tools, SCENE, "seen", ["--freeze", "0"] + options, os.path.join(folder, name))
        self.daemon.frame()
        self.viewers = subprocess.Popen(view(tools, self.daemon.address, CAMERA, "--wait", "seconds:100000", "--out",
                                              os.path.join(folder, name, "none.exr")), stderr=subprocess.DEVNULL)
        while not self.daemon.frame()["tiles_interest"]:
            time.sleep(0.5)

    def step(self, command):
        return frames_of(self.tools, self.daemon, command) if command else [self.daemon.frame()]

    def show(self, path):
        subprocess.run(view(self.tools, self.daemon.address, CAMERA, "--wait", "complete", "--exposure", EXPOSURE, "--out", path),
                       check=True, stderr=subprocess.DEVNULL)

    def last_picture(self):
        path = os.path.join(self.folder, self.name, "last.exr")
        self.show(path)
        return path

    def stop(self):
        self.viewers.kill()
        self.viewers.wait()
        self.daemon.stop()


def solved_again(tools, options, folder, name, picture=None):
    stage = Stage(tools, options, folder, name)
    stage.step(lamp_at(1))
    stage.step(vase_at(1))
    for _ in range(FRESH):
        stage.step(None)
    last = stage.last_picture()
    if picture:
        stage.show(picture)
    stage.stop()
    return last


def main():
    tools, out, options = sys.argv[1], sys.argv[2], sys.argv[3:]
    os.makedirs(out, exist_ok=True)
    rows, pictures = [], []
    with tempfile.TemporaryDirectory() as folder:
        stage = Stage(tools, options, folder, "moved")
        for number, command in enumerate(commands(), 1):
            rows += [{key: said[key] for key in COUNTERS} for said in stage.step(command)]
            if number % PICTURES == 0:
                pictures.append(os.path.join(out, "picture_%02d.png" % number))
                stage.show(pictures[-1])
        moved = stage.last_picture()
        stage.stop()
        second_png = os.path.join(folder, "second.png")
        second = solved_again(tools, options + ["--seed", "2"], folder, "second", second_png)
        again = solved_again(tools, options + ["--seed", "3"], folder, "again")
        print("relMSE of what moved against a new solve: %.5f; of that with another seed: %.5f" %
              (rel_mse(tools, moved, second), rel_mse(tools, again, second)))
        sheet(os.path.join(out, "fresh.png"), [pictures[-1], second_png], 2)
    sheet(os.path.join(out, "pictures.png"), pictures, 4)
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
