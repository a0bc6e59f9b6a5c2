// tile_decoder.mjs: a second decoder of tile payloads of codec 4, written from proto/wire_format.md, section 5, whose tables it
// reads, and from nothing else; it is meant to be read, not to be fast.
//
//     node tile_decoder.mjs FOLDER
//
// decodes each FOLDER/*.tile (u32 width, u32 height, f32 scale, payload) and compares it with the f32 texels in the .rgb of
// that name; where there is none, the payload must be refused. NAME.next, of the same form, builds on NAME.tile and is compared
// with NAME.next.rgb. Files whose names begin with direction_ are of layer 2: x, y, z. All others are light. Exit code 1 if
// anything differs.
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
  // most: how many bits may be left
  finish(most) {
    if (this.bytes.length * 8 - this.at > most) throw new Error('bytes are left');
    while (this.at < this.bytes.length * 8) if (this.one()) throw new Error('a bit is left');
  }
}

// The tables of the document: slots of tokens by table, and tables by row and class.
const document = readFileSync(new URL('../../proto/wire_format.md', import.meta.url), 'utf8');
const numbers = (text) => text.trim().split(/ +/).map(Number);
const slots = [...document.matchAll(/^ ?(\d+): ([\d ]+)$/gm)].map((line) => numbers(line[2]));
const tableOf = [...document.matchAll(/^(?:u \+ v <= \d|above|lengths) *: ([\d ]+)$/gm)].map((line) => numbers(line[1]));
const small = (raw) => Array.from({ length: 16 }, (_, base) => [base, base ? raw : 0]);
const levelTokens = [...small(1), [16, 3], [20, 3], [24, 4], [32, 4], [40, 5], [56, 5], [72, 6], [104, 1]];
const lengthTokens = [...small(0), [16, 3], [24, 3], [32, 4], [48, 4]];

function classOf(sum) {
  if (sum < 2) return sum;
  const d = Math.floor(Math.log2(sum));
  return 2 * d + (Math.floor(sum / 2 ** (d - 1)) % 2);
}

class Lanes {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
    this.state = [];
  }
  word() {
    if (this.at + 2 > this.bytes.length) throw new Error('the payload ends early');
    this.at += 2;
    return this.bytes[this.at - 2] + this.bytes[this.at - 1] * 256;
  }
  begin(lane) {
    const low = this.word();
    this.state[lane] = low + this.word() * 65536;
    if (this.state[lane] < 65536) throw new Error('a state is too small');
  }
  token(lane, table) {
    let x = this.state[lane], i = x % 1024, t = 0;
    while (i >= slots[table][t]) i -= slots[table][t++];
    const [base, r] = (table < 16 ? levelTokens : lengthTokens)[t];
    const above = Math.floor(x / 1024), raw = above % 2 ** r;
    x = slots[table][t] * Math.floor(above / 2 ** r) + i;
    this.state[lane] = x < 65536 ? x * 65536 + this.word() : x;
    return { base, raw };
  }
  // The bits that come after, and how many of them need not be used.
  rest() {
    const low = [];
    for (const x of this.state) {
      if (x >= 131072) throw new Error('a state is too large');
      low.push(x % 256, Math.floor(x / 256) % 256);
    }
    const left = this.bytes.subarray(this.at);
    return { bits: new Bits([...low, ...left]), most: left.length ? 7 : low.length * 8 };
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

// Reads the means' levels into c, which the scan tells the places of.
function readMeans(bits, scan, kind, c) {
  const length = bits.rice(4);
  if (length > scan.length) throw new Error('there are too many means');
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
}

const whole = scanOf(8, 8);

// Which table tells level i of a list.
function levelTable(block, i) {
  if (i === block.length - 1) return 15;
  const [u, v] = whole[i + 1];
  let sum = 0;
  for (const [x, y] of [[u + 1, v], [u, v + 1], [u + 1, v + 1], [u + 2, v], [u, v + 2]]) {
    const n = whole.findIndex(([p, q]) => p === x && q === y) - 1;
    if (n >= 0 && n < block.length) sum += Math.min(30, block.size[n]);
  }
  const d = u + v;
  return tableOf[d <= 1 ? 0 : d <= 3 ? 1 : d <= 6 ? 2 : 3][classOf(sum)];
}

// The blocks of a plane, with their lengths.
function readLengths(lanes, width, height) {
  const across = Math.ceil(width / 8), down = Math.ceil(height / 8), blocks = [];
  for (let by = 0; by < down; by++)
    for (let bx = 0; bx < across; bx++) {
      const w = Math.min(8, width - bx * 8), h = Math.min(8, height - by * 8);
      const beside = bx ? blocks.at(-1).length : by ? blocks.at(-across).length : 0;
      const above = by ? blocks.at(-across).length : beside;
      const { base, raw } = lanes.token(0, tableOf[4][classOf(beside + above)]);
      if (base + raw >= w * h) throw new Error('a list is too long');
      blocks.push({ c: zeros(w, h), scan: scanOf(w, h), length: base + raw, size: [] });
    }
  return blocks;
}

// A list for each lane, all at once from the end.
function readGroup(lanes, group) {
  for (let i = group[0].length - 1; i >= 0; i--) {
    const active = group.filter((block) => block.length > i);
    const tokens = active.map((block, lane) => lanes.token(lane, levelTable(block, i)));
    active.forEach((block, lane) => {
      const { base, raw } = tokens[lane], [u, v] = block.scan[i + 1];
      block.size[i] = base + (raw >> 1) + (base === 104 ? lanes.word() : 0);
      if (block.size[i] > 32767) throw new Error('a level is too large');
      block.c[v][u] = raw & 1 ? -block.size[i] : block.size[i];
    });
  }
}

// Of each plane [v][u] of the means, then of each block by rows.
function readLevels(bytes, width, height, kind) {
  const lanes = new Lanes(bytes), across = Math.ceil(width / 8), down = Math.ceil(height / 8);
  lanes.begin(0);
  const planes = [0, 1, 2].map(() => readLengths(lanes, width, height));
  const lists = planes.flat().filter((block) => block.length).sort((a, b) => b.length - a.length); // stable
  const levels = lists.reduce((sum, block) => sum + block.length, 0);
  const count = [16, 8, 4, 2].find((n) => n * 64 <= levels) ?? 1;
  for (let lane = 1; lane < count; lane++) lanes.begin(lane);
  for (let i = 0; i < lists.length; i += count) readGroup(lanes, lists.slice(i, i + count));
  const { bits, most } = lanes.rest();
  const means = planes.map(() => {
    const c = zeros(across, down);
    readMeans(bits, scanOf(across, down), kind, c);
    return c;
  });
  bits.finish(most);
  return planes.map((blocks, p) => [means[p], ...blocks.map((block) => block.c)]);
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

const gainsOf = (payload) => [2, 3, 4].map((i) => (payload[i] << 24) >> 24);

// The three channels of light at a place, from Y, O, P.
function lightOf([y, o, p], scale, gains) {
  return [y - p + o, y + p, y - p - o].map((log, c) => {
    const gain = 2 ** (gains[c] / 512);
    return scale * gain * (2 ** Math.min(Math.max(log, 0), 63) - 1);
  });
}

// base: the levels of the version that this one builds on, or undefined. isDirection: the planes are x, y, z of either sign,
// over scale. Returns texels and levels.
export function decodeTile(payload, scale, width, height, base, isDirection) {
  if (payload.length < 5 || payload[0] !== (base ? 2 : 1) || payload[1] > 72) throw new Error('kind or step');
  if (!(scale > 0) || !(scale <= 2 ** 60)) throw new Error('scale');
  const step = 2 ** (1 - payload[1] / 8), gains = gainsOf(payload);
  if (isDirection && gains.some((gain) => gain !== 0)) throw new Error('gains');
  const levels = readLevels(payload.subarray(5), width, height, payload[0]);
  if (base) levels.forEach((lists, p) => add(lists, base[p]));
  const planes = levels.map((lists) => restorePlane(lists, width, height, step));
  const texels = [];
  for (let y = 0; y < height; y++)
    for (let x = 0; x < width; x++) {
      const values = planes.map((plane) => plane[y][x]);
      texels.push(...(isDirection ? values.map((value) => value * scale) : lightOf(values, scale, gains)));
    }
  return { texels, levels };
}

function decodeFile(path, base, isDirection) {
  const file = readFileSync(path);
  const width = file.readUInt32LE(0), height = file.readUInt32LE(4), scale = file.readFloatLE(8);
  return decodeTile(file.subarray(12), scale, width, height, base, isDirection);
}

// What is wrong with texels, or ''.
function compare(texels, path, scale) {
  const expected = readFileSync(path);
  if (expected.length !== texels.length * 4) return 'the size is wrong';
  for (let i = 0; i < texels.length; i++) {
    const e = expected.readFloatLE(i * 4);
    if (!(Math.abs(texels[i] - e) <= 0.0001 * (Math.abs(e) + scale))) return `value ${i} is ${texels[i]}, not ${e}`;
  }
  return '';
}

// What is wrong with a file, or ''.
function check(folder, name, names) {
  const path = `${folder}/${name}`, isNext = name.endsWith('.next'), isDirection = name.startsWith('direction_');
  const base = isNext ? decodeFile(path.replace('.next', '.tile'), undefined, isDirection).levels : undefined;
  const expected = isNext ? `${name}.rgb` : name.replace('.tile', '.rgb');
  const known = names.includes(expected);
  let decoded;
  try {
    decoded = decodeFile(path, base, isDirection);
  } catch (error) {
    return known ? error.message : '';
  }
  if (!known) return 'it should have been refused';
  return compare(decoded.texels, `${folder}/${expected}`, readFileSync(path).readFloatLE(8));
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
