#!/usr/bin/env python3
"""contact_sheet.py OUT COLUMNS PNG...: one PNG of pictures of one size, row by row, in 256 colours.

Reads 8-bit RGB or RGBA without interlacing, as lightwell-view writes it. Colours are chosen by median cut
(Heckbert 1982)."""
import struct
import sys
import zlib

GAP = 4


def chunks(data):
    at = 8
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        yield kind, data[at + 8:at + 8 + size]
        at += 12 + size


def paeth(a, b, c):
    p = a + b - c
    pa, pb, pc = abs(p - a), abs(p - b), abs(p - c)
    return a if pa <= pb and pa <= pc else b if pb <= pc else c


def read(path):
    """Width, height, and a list of (r, g, b)."""
    packed, data = b"", open(path, "rb").read()
    for kind, body in chunks(data):
        if kind == b"IHDR":
            width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed += body
    if depth != 8 or colour not in (2, 6) or interlaced:
        sys.exit(f"{path}: not 8-bit RGB")
    size = 3 if colour == 2 else 4
    raw, above, pixels = zlib.decompress(packed), bytes(width * size), []
    for y in range(height):
        start = y * (width * size + 1)
        kind, row = raw[start], bytearray(raw[start + 1:start + 1 + width * size])
        for i in range(len(row)):
            left = row[i - size] if i >= size else 0
            corner = above[i - size] if i >= size else 0
            row[i] = (row[i] + (0, left, above[i], (left + above[i]) // 2, paeth(left, above[i], corner))[kind]) & 255
        above = row
        pixels += [tuple(row[x * size:x * size + 3]) for x in range(width)]
    return width, height, pixels


def palette_of(pixels, count):
    """A palette, and the index of each colour."""
    weight = {}
    for p in pixels:
        weight[p] = weight.get(p, 0) + 1
    boxes = [list(weight)]

    def spread(box):
        sides = [max(c[k] for c in box) - min(c[k] for c in box) for k in range(3)]
        return max(sides) * sum(weight[c] for c in box) ** 0.5, sides.index(max(sides))

    scored = [(spread(boxes[0]), boxes[0])]
    while len(scored) < count:
        i = max(range(len(scored)), key=lambda k: scored[k][0][0])
        (score, side), box = scored.pop(i)
        if score == 0:
            scored.append(((score, side), box))
            break
        box.sort(key=lambda c: c[side])
        half, middle = sum(weight[c] for c in box) / 2, 1
        seen = weight[box[0]]
        while middle < len(box) - 1 and seen < half:
            seen += weight[box[middle]]
            middle += 1
        scored += [(spread(part), part) for part in (box[:middle], box[middle:])]
    palette, index = [], {}
    for n, (_, box) in enumerate(scored):
        total = sum(weight[c] for c in box)
        palette.append(tuple(round(sum(c[k] * weight[c] for c in box) / total) for k in range(3)))
        index.update((c, n) for c in box)
    return palette, index


def write(path, width, height, pixels):
    palette, index = palette_of(pixels, 256)
    rows = b"".join(b"\0" + bytes(index[p] for p in pixels[y * width:(y + 1) * width]) for y in range(height))

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    with open(path, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)) +
                  chunk(b"PLTE", b"".join(bytes(c) for c in palette)) +
                  chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b""))


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    columns, pictures = int(sys.argv[2]), [read(path) for path in sys.argv[3:]]
    width, height, _ = pictures[0]
    if any((w, h) != (width, height) for w, h, _ in pictures):
        sys.exit("the pictures differ in size")
    rows = (len(pictures) + columns - 1) // columns
    all_width, all_height = columns * (width + GAP) - GAP, rows * (height + GAP) - GAP
    sheet = [(255, 255, 255)] * (all_width * all_height)
    for i, (_, _, pixels) in enumerate(pictures):
        left, top = i % columns * (width + GAP), i // columns * (height + GAP)
        for y in range(height):
            start = (top + y) * all_width + left
            sheet[start:start + width] = pixels[y * width:(y + 1) * width]
    write(sys.argv[1], all_width, all_height, sheet)


main()
