#!/usr/bin/env python3
"""The questions of Vandersanden 2023, asked of a CPU; for docs/lab/thesis_questions.md.

    tests/bench/thesis.py [--bin DIR] [--frames N] [--density D] [--plot] QUESTION [SCENE...]

QUESTION: cells, range, projection, order, samples (bench_thesis), or texels (its frame at several densities). Each writes docs/lab/thesis/QUESTION.csv and .png. --plot: only draws
again. Scenes: by default the atrium, and Sponza where LW_TEST_SCENES has it.
"""
import argparse
import csv
import io
import os
import subprocess

from plots import RESULTS, ROOT, SPONZA, plot, read_csv, write_csv

FOLDER = os.path.join(RESULTS, "thesis")
DENSITIES = ["1", "2", "4", "8"]  # texels per metre


def bench(options, *arguments):
    text = subprocess.run([options.bin + "/bench_thesis", *arguments], check=True, stdout=subprocess.PIPE, text=True).stdout
    return list(csv.DictReader(io.StringIO(text)))


def label(row):
    return os.path.splitext(row["scene"])[0].replace("builtin:", "")


def ask(options):
    rows = []
    for scene in options.scene:
        rows += bench(options, "--question", options.question, "--frames", options.frames, "--texels-per-metre",
                      options.density, scene)
    return rows


def ask_texels(options):
    rows = []
    for scene in options.scene:
        for density in DENSITIES:
            row, = bench(options, "--question", "none", "--frames", options.frames, "--texels-per-metre", density, scene)
            row.update(question="texels", setting=density)
            rows.append(row)
    return rows


def draw(question, rows):
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    panels = []
    for scene in scenes:
        mine = [row for row in rows if row["scene"] == scene]
        numeric = question in ("cells", "range", "texels")
        x = [float(r["texels"] if question == "texels" else r["setting"].replace("inf", "1.2")) if numeric else i
             for i, r in enumerate(mine)]
        name = {"cells": "cells along the longest side", "range": "range / longest side (inf at 1.2)",
                "texels": "texels"}.get(question, ", ".join("%d: %s" % (i, r["setting"]) for i, r in enumerate(mine)))
        panels.append({"title": label(mine[0]), "x": name, "y": "CPU ms per frame",
                       "log": {"cells": "x", "texels": "xy"}.get(question, ""),
                       "lines": {part: sorted((a, float(r[part + "_ms"])) for a, r in zip(x, mine)
                                              if float(r[part + "_ms"]) > 0)
                                 for part in ("frame", "direct", "scatter", "probe")
                                 if any(float(r[part + "_ms"]) > 0 for r in mine)}})
    plot(os.path.join(FOLDER, question + ".png"), panels, len(panels), (450 * len(panels), 380))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=os.path.join(ROOT, "build/release/bin"))
    parser.add_argument("--frames", default="7")
    parser.add_argument("--density", default="2", help="texels per metre (default 2)")
    parser.add_argument("--plot", action="store_true")
    parser.add_argument("question", choices=["cells", "range", "projection", "order", "samples", "texels"])
    parser.add_argument("scene", nargs="*", default=["builtin:atrium-matt"] + ([SPONZA] if os.path.exists(SPONZA) else []))
    options = parser.parse_args()
    path = os.path.join(FOLDER, options.question + ".csv")
    if not options.plot:
        write_csv(path, ask_texels(options) if options.question == "texels" else ask(options))
    rows = read_csv(path)
    draw(options.question, rows)
    print("\n| " + " | ".join(rows[0]) + " |\n|" + "---|" * len(rows[0]))
    for row in rows:
        print("| " + " | ".join(row.values()) + " |")


main()
