#!/usr/bin/env python3
"""How bounce rays may share directions: error at equal rays and at equal time, for docs/lab/coherence.md.

    tests/bench/coherence.py [--bin DIR] [--plot] [SCENE...]

Runs bench_coherence scene by scene; writes docs/lab/coherence/SCENE.csv and .png, and prints the tables. --plot: only
draws and prints again what is there. By default Cornell, the atrium, the city of four million triangles, and Sponza where
LW_TEST_SCENES has it.
"""
import argparse
import io
import csv
import os
import subprocess

from plots import RESULTS, ROOT, SPONZA, plot, read_csv, write_csv

FOLDER = os.path.join(RESULTS, "coherence")
DEFAULT = ["builtin:cornell", "builtin:atrium-matt"] + ([SPONZA] if os.path.exists(SPONZA) else []) + ["builtin:city"]
ERRORS = {"relmse": "texels", "relmse_4x4": "means of 4 x 4", "relmse_16x16": "means of 16 x 16"}


def stem(scene):
    return os.path.basename(scene).replace("builtin:", "").replace(":", "_").split(".")[0]


def lines(rows, x, y):
    found = {}
    for row in rows:
        if float(row[y]) > 0:
            found.setdefault(row["way"], []).append((float(row[x]), float(row[y])))
    return found


def at(points, y):
    """x at which a falling curve reaches y, between its points on logarithmic axes; None where it does not."""
    from math import exp, log
    for (x0, y0), (x1, y1) in zip(points, points[1:]):
        if y0 >= y >= y1:
            return exp(log(x0) + (log(x1) - log(x0)) * (log(y0) - log(y)) / (log(y0) - log(y1))) if y0 > y1 else x0
    return None


def show(scene):
    path = os.path.join(FOLDER, stem(scene))
    rows = read_csv(path + ".csv")
    plot(path + ".png", [
        {"title": "%s: %s, equal %s" % (stem(scene), name, what), "x": label, "y": "relMSE", "log": "xy",
         "lines": lines(rows, x, y)}
        for y, name in ERRORS.items() for x, what, label in (("rays", "rays", "rays per texel"),
                                                            ("us_per_texel", "time", "CPU microseconds per texel"))
    ], 2, (1000, 1100))
    print("\n### %s\n\n%s texels.\n" % (stem(scene), rows[0]["texels"]))
    print("| way | Mrays/s | rays as independent: texels | 4 × 4 | 16 × 16 | time as independent: texels | 4 × 4 | 16 × 16 |")
    print("|---|---|---|---|---|---|---|---|")
    last = max(int(row["rays"]) for row in rows)
    for way in dict.fromkeys(row["way"] for row in rows):
        cells = []
        for x in "rays", "us_per_texel":
            for y in ERRORS:
                curves = lines(rows, x, y)
                target = [p[1] for p in curves["independent"]][len(curves["independent"]) // 2]
                mine, theirs = at(curves[way], target), at(curves["independent"], target)
                cells.append("%.2f" % (mine / theirs) if mine and theirs else "–")
        rate = [float(row["mrays_per_s"]) for row in rows if row["way"] == way and int(row["rays"]) == last][0]
        print("| %s | %.2f | %s |" % (way, rate, " | ".join(cells)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=os.path.join(ROOT, "build/release/bin"))
    parser.add_argument("--plot", action="store_true")
    parser.add_argument("--texels", default="30000")
    parser.add_argument("scene", nargs="*", default=DEFAULT)
    options = parser.parse_args()
    for scene in options.scene:
        if not options.plot:
            text = subprocess.run([options.bin + "/bench_coherence", "--texels", options.texels, scene], check=True,
                                  stdout=subprocess.PIPE, text=True).stdout
            write_csv(os.path.join(FOLDER, stem(scene) + ".csv"), list(csv.DictReader(io.StringIO(text))))
        show(scene)


main()
