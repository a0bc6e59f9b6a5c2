#!/usr/bin/env python3
"""make bench: what each kernel of the solve and of the view costs, and how far it is from bare rays, as one table.

    tests/bench/bench.py [--bin DIR] [--rounds N] [--out FILE] [SCENE...]

Runs bench_solve, bench_compose and bench_renderers, shows their tables, then a row per scene of what is worth following from commit to commit,
and writes all of it to FILE (default bench.json). SCENE: what lightwelld takes; by default Cornell, the atrium, city:2, and
Sponza where LW_TEST_SCENES (default ../shared/scenes) has it.
"""
import argparse
import json
import os
import platform
import subprocess
import sys
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SPONZA = "sponza/Sponza_lit.gltf"
SPONZA_CAMERA = "@-8,1.8,-0.3:5,4,-0.3:75"  # the only one of the scenes that brings no camera
SHOWN = ["direct_over_raw", "scatter_over_raw", "compose_over_raw", "drawn_over_compose", "shadow_rays_a_pixel",
         "speed_up", "serial_percent", "svgf_over_raw", "svgf_quarter_over_raw"]
PATHS = ["--width", "320", "--height", "180", "--reference", "32", "--spp-max", "1"]  # of the crossover's opponents


def git(*words):
    done = subprocess.run(["git", "-C", ROOT, *words], capture_output=True, text=True)
    return done.stdout.strip() if done.returncode == 0 else ""


def key(title):
    """"direct raw Mrays/s" -> "direct_raw_mrays_per_s"."""
    for sign, word in (("%", " percent "), ("/s", " per s "), ("-", " ")):
        title = title.replace(sign, word)
    return "_".join(title.lower().split())


def number(text):
    try:
        return float(text)
    except ValueError:
        return text or None


def rows_of(tool, *arguments):
    """Runs a bench, shows what it prints, returns the rows of its Markdown tables as dictionaries."""
    rows, head = [], None
    process = subprocess.Popen([tool, *arguments], stdout=subprocess.PIPE, text=True)
    for line in process.stdout:
        print(line, end="", flush=True)
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not line.startswith("|"):
            head = None
        elif head is None:
            head = [key(cell) for cell in cells]
        elif not line.startswith("|---"):
            rows.append({name: number(cell) for name, cell in zip(head, cells)})
    if process.wait() != 0:
        sys.exit("bench: %s has failed" % os.path.basename(tool))
    return rows


def default_scenes():
    sponza = os.path.join(os.environ.get("LW_TEST_SCENES", os.path.join(ROOT, "../shared/scenes")), SPONZA)
    return ["builtin:cornell", "builtin:atrium-matt", "builtin:city:2"] + ([sponza] if os.path.exists(sponza) else [])


def processor():
    with open("/proc/cpuinfo") as file:
        names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    return names[0] if names else platform.machine()


def measure(tools, scene, rounds):
    """One scene's figures."""
    out = {"kernels": {}}
    for row in rows_of(tools + "/bench_solve", "--rounds", str(rounds), scene):
        row.pop("scene")
        if "kernel" in row:
            out["kernels"][key(row.pop("kernel"))] = row
        else:
            out.update(row)
    print()
    view = scene + (SPONZA_CAMERA if scene.endswith(SPONZA) else "")
    for row in rows_of(tools + "/bench_compose", "--threads", "1", "--rounds", str(rounds), "--bounces", "0", view):
        row.pop("scene")
        if row["motion"] == "moving":
            out["compose_moving"] = row
        else:
            out["compose"] = row
            out["compose_over_raw"] = row["compose_over_raw"]
            out["drawn_over_compose"] = row["drawn_over_compose"]
            out["shadow_rays_a_pixel"] = row["shadow_rays_a_pixel"]  # over the bare rays, one a pixel
    print()
    out["renderers"] = {row.pop("renderer"): row for row in rows_of(tools + "/bench_renderers", *PATHS, view)}
    out["svgf_over_raw"] = out["renderers"]["svgf"]["over_raw"]
    out["svgf_quarter_over_raw"] = out["renderers"]["svgf-quarter"]["over_raw"]
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=os.path.join(ROOT, "build/release/bin"))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", default="bench.json")
    parser.add_argument("scene", nargs="*", default=default_scenes())
    options = parser.parse_args()
    isa = subprocess.run([options.bin + "/trace_isa_name"], capture_output=True, text=True)
    if isa.returncode != 0:
        sys.exit("bench: " + isa.stderr.strip())
    report = {"commit": git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain") else ""),
              "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), "processors": os.cpu_count(),
              "processor": processor(), "isa": isa.stdout.strip(), "machine": platform.machine(), "rounds": options.rounds, "scenes": {}}
    for scene in options.scene:
        report["scenes"][os.path.basename(scene)] = measure(options.bin, scene, options.rounds)
    with open(options.out, "w") as file:
        json.dump(report, file, indent=1)
        file.write("\n")
    print("\n%s, rays with %s, %d x %s\n" % (report["commit"] or "not a checkout", report["isa"], report["processors"],
                                             report["processor"]))
    print("| scene | %s |\n|---|%s" % (" | ".join(SHOWN), "---|" * len(SHOWN)))
    for scene, figures in report["scenes"].items():
        print("| %s | %s |" % (scene, " | ".join("%.2f" % figures[name] for name in SHOWN)))
    print("\nalso in %s" % options.out)


main()
