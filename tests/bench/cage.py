#!/usr/bin/env python3
"""What the importer's cage costs: the same import with and without it, one after the other in pairs, as a table.

    tests/bench/cage.py [--pairs 300] [--bin build/release/bin] [--options "--texels-per-metre 8"] SCENE ...

Processor and wall time of the importer's process alone, its start included, as a daemon starts it (as root:
with a folder of nobody's): medians, and the median of the differences within pairs with its interval of 95 %
by bootstrap. bench_cage_free is lightwell-import without lw_cage_enter().
"""
import argparse
import os
import pathlib
import random
import shlex
import statistics
import tempfile
import time

FAILURE = 3
NOBODY = 65534


def run(program, arguments, quiet):
    began = time.monotonic()
    pid = os.posix_spawn(program, [program] + arguments, os.environ,
                         file_actions=[(os.POSIX_SPAWN_DUP2, quiet, 1), (os.POSIX_SPAWN_DUP2, quiet, 2),
                                       (os.POSIX_SPAWN_DUP2, quiet, FAILURE)])
    _, status, usage = os.wait4(pid, 0)
    if status:
        raise SystemExit(f"{program}: status {status}")
    return usage.ru_utime + usage.ru_stime, time.monotonic() - began


def interval(values):
    chance = random.Random(1)
    medians = sorted(statistics.median(chance.choices(values, k=len(values))) for _ in range(1000))
    return medians[25], medians[974]


def main():
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--pairs", type=int, default=300)
    a.add_argument("--bin", type=pathlib.Path, default="build/release/bin")
    a.add_argument("--options", default="")
    a.add_argument("scene", nargs="+")
    a = a.parse_args()
    quiet = os.open("/dev/null", os.O_WRONLY)
    print("| scene | time | without, ms | in the cage, ms | more, ms | of it, % |\n|---|---|---|---|---|---|")
    for scene in a.scene:
        with tempfile.TemporaryDirectory() as folder:
            if os.geteuid() == 0:
                os.chown(folder, NOBODY, NOBODY)  # whose user the importer becomes
            arguments = shlex.split(a.options) + [f"--failure-fd={FAILURE}", "-o", f"{folder}/scene.lwscene", scene]
            programs = [str(a.bin / "bench_cage_free"), str(a.bin / "lightwell-import")]
            taken = ([], [])
            for pair in range(-2, a.pairs):  # two to warm up
                for which in (0, 1) if pair % 2 else (1, 0):
                    seconds = run(programs[which], arguments, quiet)
                    if pair >= 0:
                        taken[which].append(seconds)
        for kind, name in enumerate(("processor", "wall")):
            free, caged = ([1000 * s[kind] for s in t] for t in taken)
            more = [c - f for c, f in zip(caged, free)]
            base, (low, high) = statistics.median(free), interval(more)
            print(f"| {pathlib.Path(scene).name} | {name} | {base:.2f} | {statistics.median(caged):.2f} | "
                  f"{statistics.median(more):.2f} ({low:.2f} to {high:.2f}) | "
                  f"{100 * statistics.median(more) / base:.1f} |", flush=True)


main()
