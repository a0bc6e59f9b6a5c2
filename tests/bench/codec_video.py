#!/usr/bin/env python3
"""codec_video.py DUMP: what tiles would cost as pictures of a video, or as EXR: rows for the tables of bench_codec.

    bench_codec --frames 64 --dump /tmp/tiles builtin:atrium-matt && codec_video.py /tmp/tiles

The tiles of all levels lie beside one another in one picture of log2(1 + E/y0)/10, ten bits a channel (EXR: half floats of E over white);
what no look-up reads has its tile's mean. H.264 and H.265 by ffmpeg's libx264 and libx265, one thread. Bits are per texel
that a look-up may read; log-PSNR as in bench_codec; Mtexel/s of CPU time, of all texels, without ffmpeg's own reading and writing.
"P": the picture that follows the one before, as a difference. BC6H is 8 bits a texel whatever is in it.
"""
import array
import math
import os
import resource
import struct
import subprocess
import sys
import tempfile

SIDE = 64
SETS = ["1 frame", "16 frames", "at rest", "moving", "a frame on"]
REPEATS = 4
VIDEO = [("libx264", "H.264 ultrafast", ["-preset", "ultrafast"], "yuv420p10le", (12, 24)),
         ("libx264", "H.264 ultrafast, 4:4:4", ["-preset", "ultrafast"], "yuv444p10le", (12, 24)),
         ("libx265", "H.265 ultrafast", ["-preset", "ultrafast", "-x265-params", "log-level=error:pools=none"],
          "yuv420p10le", (12, 24))]


def read_tiles(path):
    sets = [[] for _ in SETS]
    with open(path, "rb") as file:
        while head := file.read(20):
            number, width, height, *_ = struct.unpack("<IIIff", head)
            rgb = array.array("f", file.read(12 * width * height))
            sets[number].append((width, height, rgb, file.read(width * height)))
    return sets


def find_y0(tiles):
    values = array.array("f")
    for width, height, rgb, covered in tiles:
        for i in range(width * height):
            if covered[i]:
                values.extend(rgb[3 * i:3 * i + 3])
    return 0.01 * sorted(values)[int(0.99 * len(values))]


class Picture:
    """All tiles of a set, in planes; `value` holds what is to be coded, 0 to 1 for the most part."""

    def __init__(self, tiles, y0):
        self.columns = math.ceil(math.sqrt(len(tiles)))
        self.width = SIDE * self.columns
        self.height = SIDE * math.ceil(len(tiles) / self.columns)
        self.value = [array.array("f", bytes(4 * self.width * self.height)) for _ in range(3)]
        self.light = [array.array("f", bytes(4 * self.width * self.height)) for _ in range(3)]
        self.covered = []
        self.texels = 0
        for number, (width, height, rgb, covered) in enumerate(tiles):
            first = number // self.columns * SIDE * self.width + number % self.columns * SIDE
            seen = [i for i in range(width * height) if covered[i]]
            self.texels += width * height
            self.covered.extend(first + i // width * self.width + i % width for i in seen)
            for c in range(3):
                mean = sum(rgb[3 * i + c] for i in seen) / len(seen) if seen else 0.0
                gray = 0.1 * math.log2(1 + mean / y0)
                for y in range(SIDE):  # the rest of the cell too
                    row = first + y * self.width
                    for x in range(SIDE):
                        if y < height and x < width and covered[y * width + x]:
                            light = rgb[3 * (y * width + x) + c]
                            self.light[c][row + x] = light
                            self.value[c][row + x] = 0.1 * math.log2(1 + light / y0)
                        else:
                            self.light[c][row + x] = mean
                            self.value[c][row + x] = gray

    def as_ten_bits(self):
        planes = b""
        for c in (1, 2, 0):  # gbrp
            planes += array.array("H", [min(1023, round(1023 * v)) for v in self.value[c]]).tobytes()
        return planes

    def as_floats(self, unit):
        return b"".join(array.array("f", [v / unit for v in self.light[c]]).tobytes() for c in (1, 2, 0))

    def decibel(self, decoded):
        """decoded: three planes of values, R, G, B."""
        scale = 10 / math.log2(101)
        total = 0.0
        for c in range(3):
            value, other = self.value[c], decoded[c]
            total += sum((value[i] - other[i]) ** 2 for i in self.covered)
        return -10 * math.log10(scale * scale * total / (3 * len(self.covered)) + 1e-30)


def run(arguments, data):
    """Bytes that come out, and CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(["ffmpeg", "-hide_banner", "-loglevel", "error", "-threads", "1", *arguments],
                          input=data, stdout=subprocess.PIPE, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.stdout, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def raw(picture, form):
    return ["-f", "rawvideo", "-pix_fmt", form, "-s", "%dx%d" % (picture.width, picture.height), "-r", "30", "-i", "-"]


def planes_of(data, picture, kind, scale):
    count = picture.width * picture.height
    values = array.array(kind, data[-3 * count * array.array(kind).itemsize:])
    g, b, r = (values[i * count:(i + 1) * count] for i in range(3))
    return [[v * scale for v in plane] for plane in (r, g, b)]


def row(light, name, size, picture, decibel, encode_s, decode_s):
    def speed(seconds):
        return "%.0f" % (1e-6 * picture.texels / seconds) if seconds > 1e-4 else "–"
    print("| %s | – | %s | %.2f | %.1f | – | – | %s / %s |" % (light, name, 8 * size / len(picture.covered), decibel,
                                                           speed(encode_s), speed(decode_s)), flush=True)


def measure_video(light, picture, before, codec, name, options, form, crf):
    """before: None for intra; else the picture that this one follows."""
    full = ["-vf", "scale=out_range=full:out_color_matrix=bt709", "-pix_fmt", form, "-color_range", "pc"]
    encoder = ["-c:v", codec, *options, "-crf", str(crf), "-threads", "1", "-f", "h264" if codec == "libx264" else "hevc", "-"]
    one = picture.as_ten_bits()
    copying = run([*raw(picture, "gbrp10le"), *full, "-f", "null", "-"], one * REPEATS)[1]
    if before is None:
        coded, seconds = run([*raw(picture, "gbrp10le"), *full, "-g", "1", *encoder], one * REPEATS)
        size, encode_s = len(coded) / REPEATS, (seconds - copying) / REPEATS
    else:
        first = before.as_ten_bits()
        frames = ["-g", "100", "-bf", "0"]
        alone = run([*raw(picture, "gbrp10le"), *full, *frames, *encoder], first)[0]
        coded = run([*raw(picture, "gbrp10le"), *full, *frames, *encoder], first + one)[0]
        size, encode_s = len(coded) - len(alone), 0
    demuxer = ["-f", "h264" if codec == "libx264" else "hevc", "-i", "-"]
    null = run([*demuxer, "-f", "null", "-"], coded)[1]
    back = ["-vf", "scale=in_range=full:in_color_matrix=bt709", "-pix_fmt", "gbrp10le", "-f", "rawvideo", "-"]
    decoded = run([*demuxer, *back], coded)[0]
    start = run([*demuxer, "-c", "copy", "-f", "null", "-"], coded)[1]
    decode_s = (null - start) / REPEATS if before is None else 0
    row(light, "%s, crf %d%s" % (name, crf, "" if before is None else ", P"), size, picture,
        picture.decibel(planes_of(decoded, picture, "H", 1 / 1023)), encode_s, decode_s)


def measure_exr(light, picture, y0):
    unit = 100 * y0  # white: what shines brighter than a half float can say would overflow
    data = picture.as_floats(unit)
    exr = ["-c:v", "exr", "-format", "half", "-compression", "zip16", "-f", "image2pipe", "-"]
    copying = run([*raw(picture, "gbrpf32le"), "-f", "null", "-"], data * REPEATS)[1]
    coded, seconds = run([*raw(picture, "gbrpf32le"), *exr], data * REPEATS)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "one.exr")
        with open(path, "wb") as file:
            file.write(coded[:len(coded) // REPEATS])
        decoded, decode_s = run(["-i", path, "-pix_fmt", "gbrpf32le", "-f", "rawvideo", "-"], b"")
        start = run(["-i", path, "-c", "copy", "-f", "null", "-"], b"")[1]
    lights = planes_of(decoded, picture, "f", unit)
    values = [[0.1 * math.log2(1 + max(v, 0) / y0) for v in plane] for plane in lights]
    row(light, "EXR, half, ZIP", len(coded) / REPEATS, picture, picture.decibel(values), (seconds - copying) / REPEATS,
        decode_s - start)


def main():
    sets = read_tiles(sys.argv[1])
    y0 = find_y0(sets[2])
    pictures = {number: Picture(tiles, y0) for number, tiles in enumerate(sets) if tiles}
    for number, picture in pictures.items():
        if number == 3:
            continue
        if number != 4:
            measure_exr(SETS[number], picture, y0)
        for codec, name, options, form, qualities in VIDEO:
            for crf in qualities:
                before = pictures[3] if number == 4 else None
                measure_video(SETS[number], picture, before, codec, name, options, form, crf)


if __name__ == "__main__":
    main()
