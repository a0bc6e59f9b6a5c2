"""What the drivers of this folder share: CSV files under docs/lab, and gnuplot."""
import csv
import os
import subprocess

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
RESULTS = os.path.join(ROOT, "docs/lab")
SCENES = os.environ.get("LW_TEST_SCENES", os.path.join(ROOT, "../shared/scenes"))
SPONZA = os.path.join(SCENES, "sponza/Sponza_lit.gltf")


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
