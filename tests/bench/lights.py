#!/usr/bin/env python3
"""Direct light of 1 to 10,000 lamps: CPU time to equal error; for docs/lab/lights.md.

    tests/bench/lights.py [--bin DIR] [--frames N] [--reference N] [--plot]

Runs bench_lights for points, spots and squares; writes docs/lab/lights/lights.csv and .png, and prints the table. --plot:
only draws and prints again what is there.
"""
import argparse
import csv
import io
import os
import subprocess
from math import exp, log

from plots import RESULTS, ROOT, plot, read_csv, write_csv

PATH = os.path.join(RESULTS, "lights/lights")
KINDS = ["point", "spot", "area"]
LAMPS = [1, 10, 32, 33, 100, 1000, 10000]
ERRORS = [0.1, 0.01]


def curve(rows, kind, lamps):
    """(CPU us per texel, relMSE), frame by frame."""
    return [(float(r["us_per_texel"]), float(r["relmse"])) for r in rows if r["scene"] == "%s:%d" % (kind, lamps)]


def time_to(points, error):
    """us at which the error is reached, between frames on logarithmic axes; that of the first frame where it has it;
    None where none has."""
    if points[0][1] <= error:
        return points[0][0]
    for (x0, y0), (x1, y1) in zip(points, points[1:]):
        if y1 <= error < y0:
            return exp(log(x0) + (log(x1) - log(x0)) * (log(y0) - log(error)) / (log(y0) - log(max(y1, 1e-9))))
    return None


def show():
    rows = read_csv(PATH + ".csv")
    plot(PATH + ".png", [
        {"title": "direct light, relMSE %g" % error, "x": "lamps", "y": "CPU microseconds per texel", "log": "xy",
         "lines": {kind: [(n, t) for n in LAMPS for t in [time_to(curve(rows, kind, n), error)] if t] for kind in KINDS}}
        for error in ERRORS], 2, (900, 380))
    print("\n| lamps | " + " | ".join("%s: rays, us a frame | us to %g | to %g" % (k, *ERRORS) for k in KINDS) + " |")
    print("|---|" + "---|---|---|" * len(KINDS))
    for lamps in LAMPS:
        cells = []
        for kind in KINDS:
            first = next(r for r in rows if r["scene"] == "%s:%d" % (kind, lamps))
            cells.append("%.1f, %.2f" % (float(first["rays_per_texel"]), float(first["us_per_texel"])))
            times = [time_to(curve(rows, kind, lamps), error) for error in ERRORS]
            cells += ["%.2f" % t if t else "–" for t in times]
        print("| %d | %s |" % (lamps, " | ".join(cells)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=os.path.join(ROOT, "build/release/bin"))
    parser.add_argument("--frames", default="64")
    parser.add_argument("--reference", default="96")
    parser.add_argument("--plot", action="store_true")
    options = parser.parse_args()
    if not options.plot:
        scenes = ["%s:%d" % (kind, lamps) for kind in KINDS for lamps in LAMPS]
        text = subprocess.run([options.bin + "/bench_lights", "--frames", options.frames, "--reference", options.reference, *scenes],
                              check=True, stdout=subprocess.PIPE, text=True).stdout
        write_csv(PATH + ".csv", list(csv.DictReader(io.StringIO(text))))
    show()


main()
