#!/usr/bin/env python3
"""What --light seen saves, and what it costs in error: one viewer, the same frames under whole and seen.

    tests/bench/seen.py BIN SCENE FRAMES CAMERA... [-- DAEMON OPTIONS]

Per camera one row per mode: level-0 tiles of the interest set, of its contributors, in all; rays, texels solved and CPU ms (solve,
publish) per frame, means over the second half of FRAMES; relMSE of the view after the last frame against the path tracer
(--spp 64) at the same moment, and of seen against whole. Then rays of seen over those of whole, as they are and at equal error,
which takes the whole of relMSE for noise that falls with the rays. BIN: build/release/bin. The daemon's clock is manual: both
modes light the same frames, and only CPU time is told. CAMERA: a name, or as --camera of lightwell-view has it.
"""
import json
import os
import re
import subprocess
import sys
import tempfile
import time

SIZE = "320x180"
SPP = "64"


def run(command):
    return subprocess.run(command, check=True, capture_output=True, text=True)


class Daemon:
    def __init__(self, tools, scene, light, options, folder):
        self.port_file = os.path.join(folder, "port-" + light)
        self.log = open(os.path.join(folder, "log-" + light), "w+")
        self.process = subprocess.Popen(
            [tools + "/lightwelld", scene, "--light", light, "--clock", "manual", "--json", "--listen", "127.0.0.1:0",
             "--port-file", self.port_file] + options,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.log, text=True, bufsize=1)
        while not os.path.exists(self.port_file):
            time.sleep(0.05)
            assert self.process.poll() is None, "the daemon has ended"
        self.address = "127.0.0.1:" + open(self.port_file).read().strip()

    def frame(self):
        self.process.stdin.write("\n")
        return json.loads(self.process.stdout.readline())

    def stop(self):
        self.process.stdin.close()
        self.process.wait()


def camera_option(camera):
    return ["--camera" if ":" in camera else "--camera-name", camera]


def view(tools, address, camera, *options):
    return [tools + "/lightwell-view", address, "--headless", *camera_option(camera), "--size", SIZE, "--samples-per-pixel", "1", "--timeout", "600",
            *options]


def light(tools, scene, mode, camera, frames, options, folder):
    """The picture after the last frame, and the JSON of the second half of the frames."""
    daemon = Daemon(tools, scene, mode, options, folder)
    daemon.frame()
    viewers = subprocess.Popen(
        view(tools, daemon.address, camera, "--wait", "seconds:100000", "--out", os.path.join(folder, "none.exr")),
        stderr=subprocess.DEVNULL)
    said = {}
    while not said.get("tiles_interest") or not said["sessions"]:  # frames before it looks are not counted
        time.sleep(0.5)
        said = daemon.frame() if mode == "seen" else {"tiles_interest": 1, "sessions": 1}
    if mode == "whole":
        time.sleep(5)
    lines = []
    while not lines or lines[-1]["frame"] < frames:
        lines.append(daemon.frame())
    path = os.path.join(folder, mode + ".exr")
    run(view(tools, daemon.address, camera, "--wait", "complete", "--out", path))
    viewers.kill()
    viewers.wait()
    daemon.stop()
    return path, lines[len(lines) // 2:]


def mean(lines, key):
    return sum(line[key] for line in lines) / len(lines)


def rays(lines):
    return sum(mean(lines, key) for key in ("rays_shadow", "rays_bounce", "rays_probe"))


def rel_mse(tools, picture, reference):
    return float(re.search(r"relMSE ([0-9.]+)", run([tools + "/bench_compare", picture, reference]).stdout).group(1))


def main():
    arguments = sys.argv[1:]
    options = []
    if "--" in arguments:
        at = arguments.index("--")
        arguments, options = arguments[:at], arguments[at + 1:]
    tools, scene, frames, cameras = arguments[0], arguments[1], int(arguments[2]), arguments[3:]
    scene_options = [o for i, o in enumerate(options) if o == "--sky" or (i and options[i - 1] == "--sky")]
    still = "--freeze" in options
    print("| camera | light | interest | contributing | of | M rays/frame | texels/frame | solve ms | publish ms | relMSE to reference "
          "| to whole | rays to whole | at equal error |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    for camera in cameras:
        with tempfile.TemporaryDirectory() as folder:
            moment = float(options[options.index("--freeze") + 1]) if still else (frames - 1) / 30
            reference = os.path.join(folder, "reference.exr")
            run([tools + "/lightwell-view", "--path-trace", scene, "--time", str(moment), "--spp", SPP, "--bounces", "2",
                 "--pixel", "centre", *camera_option(camera), "--size", SIZE, "--samples-per-pixel", "1", "--out", reference] + scene_options)
            whole = None
            for mode in "whole", "seen":
                picture, lines = light(tools, scene, mode, camera, frames, options, folder)
                error = rel_mse(tools, picture, reference)
                compared = " | | "
                if whole:
                    share = rays(lines) / whole["rays"]
                    compared = "%.4f | %.2f | %.2f" % (rel_mse(tools, picture, whole["picture"]), share,
                                                       share * error / whole["error"])
                else:
                    whole = {"picture": picture, "rays": rays(lines), "error": error}
                print("| %s | %s | %.0f | %.0f | %d | %.2f | %.0f | %.1f | %.1f | %.4f | %s |" % (
                    camera, mode, mean(lines, "tiles_interest"), mean(lines, "tiles_contributing"), lines[-1]["tiles"],
                    1e-6 * rays(lines), mean(lines, "texels_solved"), mean(lines, "solve_cpu_ms"),
                    mean(lines, "publish_cpu_ms"), error, compared), flush=True)


if __name__ == "__main__":
    main()
