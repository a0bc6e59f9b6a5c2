#!/usr/bin/env python3
"""The solvers' errors over CPU time, and pictures of them after equal times; for docs/lab/solvers.md.

    tests/bench/solvers.py [--bin DIR] [--plot] [NAME...]

Runs bench_solvers --early for each scene; writes docs/lab/solvers/NAME.csv, error.png over all that are there, and
cornell.png and sponza.png: a row a solver, a column a time, the truth at the right. --plot: draws error.png again, of what is
there. Names: cornell, atrium, city, and sponza where LW_TEST_SCENES has it; all of them by default.
"""
import argparse
import csv
import io
import os
import subprocess
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
RESULTS = os.path.join(ROOT, "docs/lab")
LW_SCENES = os.environ.get("LW_TEST_SCENES", os.path.join(ROOT, "../shared/scenes"))
SPONZA = os.path.join(LW_SCENES, "sponza/Sponza_lit.gltf")
FOLDER = os.path.join(RESULTS, "solvers")
SCENES = {  # CPU seconds; what bench_solvers is asked for; the scene
    "cornell": ("2", ["--reference", "256", "--pairs", "3e8", "--texels-per-metre", "20"], "builtin:cornell"),
    "atrium": ("16", ["--reference", "192", "--pairs", "1e7", "--texels-per-metre", "2"], "builtin:atrium-matt"),
    "sponza": ("16", ["--reference", "192", "--pairs", "1e7", "--texels-per-metre", "2"], SPONZA + "@-8,1.8,-0.3:8,3,0:75"),
    "city": ("16", ["--reference", "16", "--pairs", "1e7", "--texels", "2048", "--spp", "384", "--texels-per-metre", "0.3"],
             "builtin:city:2"),
}
PICTURED = ["cornell", "sponza"]
# A row each: their numbers among bench_solvers' entrants.
PICTURES = {"cells": 0, "radiosity, directions 64": 9, "vpl, 512 in 8": 12}
MOMENTS = 3
STEP = 1.08  # of CPU time between rows that are kept


def read_csv(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def write_csv(path, rows):
    os.makedirs(os.path.dirname(path), exist_ok=True)
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    print("wrote " + path)


def plot(path, panels, columns, size=(900, 600)):
    """A PNG of panels, row by row: {"title", "x", "y", "log": "x", "y" or "xy", "lines": {name: [(x, y)...]}}."""
    rows = (len(panels) + columns - 1) // columns
    script = ["set terminal pngcairo noenhanced size %d,%d font 'sans,10'" % size, "set output '%s'" % path,
              "set multiplot layout %d,%d" % (rows, columns), "set grid", "set key font ',9' samplen 2"]
    for panel in panels:
        script += ["set title '%s'" % panel["title"], "set xlabel '%s'" % panel["x"], "set ylabel '%s'" % panel["y"],
                   "unset logscale", "set format '%g'"]
        if panel.get("log"):
            script.append("set logscale " + panel["log"])
        names = list(panel["lines"])
        for i, name in enumerate(names):
            script += ["$line%d << EOD" % i] + ["%g %g" % point for point in panel["lines"][name]] + ["EOD"]
        script.append("plot " + ", ".join("$line%d with linespoints pointtype 7 pointsize 0.4 title '%s'" % (i, name)
                                          for i, name in enumerate(names)))
    script.append("unset multiplot")
    subprocess.run(["gnuplot"], input="\n".join(script), text=True, check=True)
    print("wrote " + path)


def sheet(path, pictures, columns, size=(320, 180)):
    """A PNG of PNG pictures of one size, side by side and row by row."""
    rows = (len(pictures) + columns - 1) // columns
    script = ["set terminal pngcairo noenhanced size %d,%d" % (size[0] * columns, size[1] * rows), "set output '%s'" % path,
              "set multiplot layout %d,%d margins 0,1,0,1 spacing 0" % (rows, columns),
              "unset border; unset tics; unset key; unset colorbox",
              "set xrange [0:%d]; set yrange [0:%d]" % size]
    script += ["plot '%s' binary filetype=png origin=(0,0) with rgbimage" % picture for picture in pictures]
    script.append("unset multiplot")
    subprocess.run(["gnuplot"], input="\n".join(script), text=True, check=True)
    print("wrote " + path)


def thin(rows):
    kept = []
    for row in rows:
        last = kept[-1] if kept and kept[-1]["solver"] == row["solver"] else None
        if not last or float(row["cpu_s"]) > STEP * float(last["cpu_s"]):
            kept.append(row)
    return kept


def ask(options, name):
    seconds, settings, scene = SCENES[name]
    with tempfile.TemporaryDirectory() as pictures:
        text = subprocess.run([options.bin + "/bench_solvers", "--threads", "1", "--early", seconds,
                               *(["-o", pictures] if name in PICTURED else []), *settings, scene],
                              check=True, stdout=subprocess.PIPE, text=True).stdout
        rows = text[text.index("scene,solver,"):]
        write_csv(os.path.join(FOLDER, name + ".csv"), thin(list(csv.DictReader(io.StringIO(rows)))))
        if name not in PICTURED:
            return
        sheet(os.path.join(FOLDER, name + ".png"),
              [path for number in PICTURES.values()
               for path in ["%s/%d-%d.png" % (pictures, number, m) for m in range(MOMENTS)] + [pictures + "/truth.png"]], MOMENTS + 1)


def draw():
    panels = []
    for name in SCENES:
        path = os.path.join(FOLDER, name + ".csv")
        rows = read_csv(path) if os.path.exists(path) else []
        lines = {}
        for row in rows:
            lines.setdefault(row["solver"], []).append((float(row["cpu_s"]), float(row["relmse_paths"])))
        if lines:
            panels.append({"title": name, "x": "CPU seconds of frames", "y": "relMSE by paths", "log": "xy", "lines": lines})
    plot(os.path.join(FOLDER, "error.png"), panels, 2, (1200, 900))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=os.path.join(ROOT, "build/release/bin"))
    parser.add_argument("--plot", action="store_true")
    parser.add_argument("name", nargs="*", choices=[*SCENES, []], metavar="NAME")
    options = parser.parse_args()
    for name in [] if options.plot else options.name or [n for n in SCENES if n != "sponza" or os.path.exists(SPONZA)]:
        ask(options, name)
    draw()


main()
