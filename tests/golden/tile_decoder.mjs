// tile_decoder.mjs: a second decoder of tile payloads of codec 3, written from proto/wire_format.md, section 5, and from
// nothing else; it is meant to be read, not to be fast.
//
//     node tile_decoder.mjs FOLDER
//
// decodes each FOLDER/*.tile (u32 width, u32 height, f32 scale, payload) and compares it with the f32 texels in the .rgb of
// that name; where there is none, the payload must be refused. NAME.next, of the same form, builds on NAME.tile and is compared
// with NAME.next.rgb. Exit code 1 if anything differs.
import { readFileSync, readdirSync } from 'node:fs';

class Bits {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }
  one() {
    if (this.at >= this.bytes.length * 8) throw new Error('the payload ends early');
    const bit = (this.bytes[this.at >> 3] >> (this.at & 7)) & 1;
    this.at++;
    return bit;
  }
  number(count) {
    let n = 0;
    for (let i = 0; i < count; i++) n += this.one() * 2 ** i;
    return n;
  }
  rice(k) {
    let ones = 0;
    while (ones < 12 && this.one()) ones++;
    return ones === 12 ? this.number(20) : ones * 2 ** k + this.number(k);
  }
  finish() {
    if (this.bytes.length * 8 - this.at >= 8) throw new Error('bytes are left');
    while (this.at < this.bytes.length * 8) if (this.one()) throw new Error('a bit is left');
  }
}

function kappa(a, b) {
  let digits = 0;
  for (let third = Math.floor((a + b) / 3); third > 0; third = Math.floor(third / 2)) digits++;
  return Math.min(digits, 16);
}

// Pairs [u, v] in the order of the scan.
function scanOf(w, h) {
  const scan = [];
  for (let diagonal = 0; diagonal <= w + h - 2; diagonal++)
    for (let v = 0; v < h; v++) if (diagonal - v >= 0 && diagonal - v < w) scan.push([diagonal - v, v]);
  return scan;
}

const basis = (n, k, x) => Math.sqrt((k ? 2 : 1) / n) * Math.cos((Math.PI * (x + 0.5) * k) / n);

// c[v][u] to value[y][x].
function inverse(c, w, h) {
  const value = [];
  for (let y = 0; y < h; y++) {
    value.push([]);
    for (let x = 0; x < w; x++) {
      let sum = 0;
      for (let v = 0; v < h; v++) for (let u = 0; u < w; u++) sum += basis(w, u, x) * basis(h, v, y) * c[v][u];
      value[y].push(sum);
    }
  }
  return value;
}

const zeros = (w, h) => Array.from({ length: h }, () => new Array(w).fill(0));

// Reads levels into c, which the scan tells the places of; returns how many.
function readLevels(bits, scan, k, kind, c) {
  const length = k ? bits.rice(k) : bits.one() ? 1 + bits.rice(3) : 0;
  if (length > scan.length) throw new Error('a block is too long');
  let a = 0, b = 0, known = true; // that the next level is not 0
  for (let i = length - 1; i >= 0; i--) {
    if (!known && a === 0 && b === 0) {
      const run = bits.rice(kind);
      if (run > i + 1) throw new Error('a run is too long');
      i -= run;
      known = true;
      if (i < 0) break;
    }
    const size = bits.rice(kappa(a, b)) + (known ? 1 : 0);
    const negative = size && bits.one();
    const [u, v] = scan[i];
    c[v][u] = negative ? -size : size;
    [a, b, known] = [size, a, false];
  }
  return length;
}

// The levels of a plane: [v][u] of the means, then of each block by rows.
function readPlane(bits, width, height, kind) {
  const across = Math.ceil(width / 8), down = Math.ceil(height / 8);
  const lists = [zeros(across, down)], length = zeros(across, down);
  readLevels(bits, scanOf(across, down), 4, kind, lists[0]);
  for (let by = 0; by < down; by++) {
    const any = bits.one();
    for (let bx = 0; bx < across; bx++) {
      const w = Math.min(8, width - bx * 8), h = Math.min(8, height - by * 8);
      const left = bx ? length[by][bx - 1] : by ? length[by - 1][bx] : 0;
      const above = by ? length[by - 1][bx] : left;
      const c = zeros(w, h);
      if (any) length[by][bx] = readLevels(bits, scanOf(w, h).slice(1), kappa(left, above), kind, c);
      lists.push(c);
    }
  }
  return lists;
}

function add(lists, base) {
  lists.forEach((c, i) => c.forEach((row, v) => row.forEach((level, u) => {
    row[u] = level + base[i][v][u];
    if (Math.abs(row[u]) > 32767) throw new Error('a sum is too large');
  })));
}

function restorePlane(lists, width, height, step) {
  const across = Math.ceil(width / 8), down = Math.ceil(height / 8);
  const scaled = (c) => c.map((row) => row.map((level) => level * step));
  const means = inverse(scaled(lists[0]), across, down), plane = zeros(width, height);
  for (let by = 0; by < down; by++)
    for (let bx = 0; bx < across; bx++) {
      const w = Math.min(8, width - bx * 8), h = Math.min(8, height - by * 8);
      const c = scaled(lists[1 + by * across + bx]);
      c[0][0] = means[by][bx];
      const value = inverse(c, w, h);
      for (let y = 0; y < h; y++) for (let x = 0; x < w; x++) plane[by * 8 + y][bx * 8 + x] = value[y][x];
    }
  return plane;
}

// base: the levels of the version that this one builds on, or undefined. Returns texels and levels.
export function decodeTile(payload, scale, width, height, base) {
  if (payload.length < 5 || payload[0] !== (base ? 2 : 1) || payload[1] > 72) throw new Error('kind or step');
  if (!(scale > 0) || !(scale <= 2 ** 60)) throw new Error('scale');
  const step = 2 ** (1 - payload[1] / 8);
  const gain = [2, 3, 4].map((i) => 2 ** (((payload[i] << 24) >> 24) / 512));
  const bits = new Bits(payload.subarray(5));
  const levels = [0, 1, 2].map(() => readPlane(bits, width, height, payload[0]));
  bits.finish();
  if (base) levels.forEach((lists, p) => add(lists, base[p]));
  const [Y, O, P] = levels.map((lists) => restorePlane(lists, width, height, step));
  const light = (x, c) => scale * gain[c] * (2 ** Math.min(Math.max(x, 0), 63) - 1);
  const rgb = [];
  for (let y = 0; y < height; y++)
    for (let x = 0; x < width; x++)
      rgb.push(light(Y[y][x] - P[y][x] + O[y][x], 0), light(Y[y][x] + P[y][x], 1),
               light(Y[y][x] - P[y][x] - O[y][x], 2));
  return { rgb, levels };
}

function decodeFile(path, base) {
  const file = readFileSync(path);
  const width = file.readUInt32LE(0), height = file.readUInt32LE(4), scale = file.readFloatLE(8);
  return decodeTile(file.subarray(12), scale, width, height, base);
}

// What is wrong with texels, or ''.
function compare(rgb, path, scale) {
  const expected = readFileSync(path);
  if (expected.length !== rgb.length * 4) return 'the size is wrong';
  for (let i = 0; i < rgb.length; i++) {
    const e = expected.readFloatLE(i * 4);
    if (!(Math.abs(rgb[i] - e) <= 0.0001 * (e + scale))) return `value ${i} is ${rgb[i]}, not ${e}`;
  }
  return '';
}

// What is wrong with a file, or ''.
function check(folder, name, names) {
  const path = `${folder}/${name}`, isNext = name.endsWith('.next');
  const base = isNext ? decodeFile(path.replace('.next', '.tile')).levels : undefined;
  const truth = isNext ? `${name}.rgb` : name.replace('.tile', '.rgb');
  const known = names.includes(truth);
  let decoded;
  try {
    decoded = decodeFile(path, base);
  } catch (error) {
    return known ? error.message : '';
  }
  if (!known) return 'it should have been refused';
  return compare(decoded.rgb, `${folder}/${truth}`, readFileSync(path).readFloatLE(8));
}

const folder = process.argv[2];
const names = readdirSync(folder);
let failed = 0, passed = 0;
for (const name of names.filter((n) => n.endsWith('.tile') || n.endsWith('.next'))) {
  const wrong = check(folder, name, names);
  if (wrong) console.error(`${name}: ${wrong}`);
  wrong ? failed++ : passed++;
}
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed || !passed ? 1 : 0);
