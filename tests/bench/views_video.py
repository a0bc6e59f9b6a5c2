#!/usr/bin/env python3
"""views_video.py [--frames 60] [--size 1280x720] [--bin DIR]: what it would take to compose each user's view in the
server and to send it as video, beside tiles. Prints a table in Markdown: CPU of encoding and of decoding a picture, one thread
each, and how late a picture is by them and by its composition.

A user walks 1.4 m/s through builtin:atrium-matt, whose lamp moves, at 30 frames a second: lightwell-view composes the views, under
the manual clock. ffmpeg encodes them as one encoder a user would, one thread, no picture held back; kbit/s are at 30 pictures a
second. FLIP and the mean difference (255ths): of every tenth decoded picture against the composed one; of tiles: of the same
views from tiles as they are sent, against tiles in half floats. Wants ffmpeg with libx264, libvpx and SVT-AV1.
"""
import argparse
import json
import pathlib
import resource
import subprocess
import tempfile

START, END, FOV = (-7.0, 1.7, 2.2), (8.0, 1.7, 2.2), 65
SPEED_M_S, HZ = 1.4, 30
LOOK_M = 6.0
KEPT = 10  # every tenth picture is compared
ENCODERS = [
    ("H.264, x264 ultrafast", ["libx264", "-preset", "ultrafast", "-tune", "zerolatency", "-threads", "1"], "-crf", (20, 28)),
    ("H.264, x264 veryfast", ["libx264", "-preset", "veryfast", "-tune", "zerolatency", "-threads", "1"], "-crf", (20, 28)),
    ("VP9, libvpx realtime 8", ["libvpx-vp9", "-deadline", "realtime", "-cpu-used", "8", "-lag-in-frames", "0", "-b:v", "0",
                                "-threads", "1"], "-crf", (20, 36)),
    ("AV1, SVT preset 12", ["libsvtav1", "-preset", "12", "-svtav1-params", "pred-struct=1:lp=1"], "-crf", (28, 44)),
]


def camera(frame):
    step = SPEED_M_S * frame / HZ
    at = (START[0] + step, START[1], START[2])
    return "%g,%g,%g:%g,%g,%g:%g" % (*at, at[0] + LOOK_M, 2.2, at[2] - 2.5, FOV)


def serve(args, folder, *more):
    port = folder / "port"
    port.unlink(missing_ok=True)
    daemon = subprocess.Popen([args.bin / "lightwelld", "builtin:atrium-matt", "--clock", "manual", "--light", "whole", "--listen",
                               "127.0.0.1:0", "--http", "none", "--port-file", port, *more],
                              stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    while not port.exists() or not port.read_text():
        if daemon.poll() is not None:
            raise SystemExit(daemon.stderr.read())
        subprocess.run(["sleep", "0.1"], check=True)
    return daemon, port.read_text().strip()


def views(args, folder, name, wanted, *more):
    """Composes the wanted frames of the walk as raw RGB; returns the CPU ms of composing one, in the mean."""
    daemon, port = serve(args, folder, *more)
    compose = []
    try:
        daemon.stdin.write("\n" * 16)  # light to begin with
        for frame in range(args.frames):
            daemon.stdin.write("\n")
            daemon.stdin.flush()
            if frame not in wanted:
                continue
            png = folder / "view.png"
            said = subprocess.run([args.bin / "lightwell-view", "--headless", "127.0.0.1:" + port, "--wait", "complete", "--size",
                                   args.size, "--camera", camera(frame), "--samples-per-pixel", "1", "--exposure", "-5",
                                   "--threads", "1", "--cache", folder / "cache", "--json", "--out", png],
                                  stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True, text=True).stdout
            compose.append(json.loads(said)["compose_ms"])
            subprocess.run(["ffmpeg", "-v", "error", "-y", "-i", png, "-f", "rawvideo", "-pix_fmt", "rgb24",
                            folder / f"{name}{frame:03}.raw"], check=True)
    finally:
        daemon.terminate()
        daemon.wait()
    return sum(compose) / len(compose)


def compare(args, reference, test):
    width, height = args.size.split("x")
    said = subprocess.run([args.bin / "compare_pictures", width, height, reference, test], stdout=subprocess.PIPE, check=True,
                          text=True).stdout
    return [float(x) for x in said.split()]


def mean(rows):
    return [sum(column) / len(column) for column in zip(*rows)]


def cpu(command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stderr=subprocess.DEVNULL)  # SVT-AV1 tells of itself
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def encode(args, folder, options, rate, value):
    """CPU ms a picture of encoding and decoding, kbit/s at 30 Hz, mean difference and FLIP."""
    source = ["ffmpeg", "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "yuv420p", "-s", args.size, "-r", str(HZ), "-i",
              folder / "walk.yuv"]
    idle = cpu(source + ["-f", "null", "-"])
    video = folder / "walk.mkv"
    spent = cpu(source + ["-c:v", *options, rate, str(value), "-g", "9999", video]) - idle
    decoded_in = cpu(["ffmpeg", "-v", "error", "-threads", "1", "-i", video, "-f", "null", "-"]) - cpu(
        ["ffmpeg", "-v", "error", "-threads", "1", "-i", video, "-frames:v", "1", "-f", "null", "-"])
    subprocess.run(["ffmpeg", "-v", "error", "-y", "-i", video, "-f", "rawvideo", "-pix_fmt", "rgb24", folder / "decoded.raw"],
                   check=True)
    width, height = map(int, args.size.split("x"))
    size = 3 * width * height
    errors = []
    with open(folder / "decoded.raw", "rb") as decoded:
        for frame in range(0, args.frames, KEPT):
            decoded.seek(frame * size)
            (folder / "one.raw").write_bytes(decoded.read(size))
            errors.append(compare(args, folder / f"view{frame:03}.raw", folder / "one.raw"))
    return 1e3 * spent / args.frames, 1e3 * decoded_in / (args.frames - 1), video.stat().st_size * 8e-3 * HZ / args.frames, *mean(errors)


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--frames", type=int, default=60)
    p.add_argument("--size", default="1280x720")
    p.add_argument("--bin", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2] / "build/release/bin")
    args = p.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        compose = views(args, folder, "view", range(args.frames))
        kept = range(0, args.frames, KEPT)
        views(args, folder, "half", kept, "--codec", "half")
        tiles = mean([compare(args, folder / f"half{f:03}.raw", folder / f"view{f:03}.raw") for f in kept])
        with open(folder / "all.raw", "wb") as out:
            for frame in range(args.frames):
                out.write((folder / f"view{frame:03}.raw").read_bytes())
        subprocess.run(["ffmpeg", "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", args.size, "-i",
                        folder / "all.raw", "-f", "rawvideo", "-pix_fmt", "yuv420p", folder / "walk.yuv"], check=True)
        print(f"composing a view: {compose:.0f} ms, one thread; tiles as they are sent: difference {tiles[0]:.2f}/255, "
              f"FLIP {tiles[1]:.4f}\n")
        print("| sent as | setting | encoding, CPU ms a picture | decoding | a picture is late by, ms | kbit/s | difference / 255 | "
              "FLIP |")
        print("|---|---|---|---|---|---|---|---|")
        for what, options, rate, values in ENCODERS:
            for value in values:
                ms, decode, kbits, difference, flip = encode(args, folder, options, rate, value)
                print(f"| {what} | {rate} {value} | {ms:.1f} | {decode:.1f} | {compose + ms + decode:.0f} | {kbits:.0f} | "
                      f"{difference:.2f} | {flip:.4f} |", flush=True)


main()
