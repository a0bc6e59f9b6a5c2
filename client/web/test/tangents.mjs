// tangents.mjs: tangents of lightwell-import against those of three.js' MikkTSpace, Mikkelsen's code in
// WebAssembly (r170; later versions have a port that differs from it).
//     build/release/bin/bench_tangents -o FOLDER SCENE
//     node client/web/test/tangents.mjs FOLDER/SCENE.corners
// Prints the corners by the angle between both, and the CPU s of three's.
import { readFileSync } from 'node:fs';

import { generateTangents, ready } from '../node_modules/three-170/examples/jsm/libs/mikktspace.module.js';

const STEP_DEGREES = 0.006; // half a step of a tangent's 15 bits, and rounding
const bytes = readFileSync(process.argv[2]);
const found = { near: 0, far: 0, least: Infinity, most: 0, turned: 0, free: 0 };
let seconds = 0;

/** A triangle without an area in the picture, beside none that has one: MikkTSpace leaves it (1, 0, 0). */
function isFree(uv, corner, [x, y, z]) {
  const [a, b, c] = [0, 1, 2].map((k) => 2 * (corner - (corner % 3) + k));
  const [ux, uy, vx, vy] = [uv[b] - uv[a], uv[b + 1] - uv[a + 1], uv[c] - uv[a], uv[c + 1] - uv[a + 1]];
  return Math.fround(ux * vy) === Math.fround(uy * vx) && x === 1 && y === 0 && z === 0;
}

function compare(ours, theirs, free) {
  if (free) return found.free++;
  if (ours[3] !== theirs[3]) return found.turned++;
  const cross = [0, 1, 2].map((k) => {
    const [i, j] = [(k + 1) % 3, (k + 2) % 3];
    return ours[i] * theirs[j] - ours[j] * theirs[i];
  });
  const dot = ours[0] * theirs[0] + ours[1] * theirs[1] + ours[2] * theirs[2];
  const degrees = (Math.atan2(Math.hypot(...cross), dot) * 180) / Math.PI;
  if (degrees <= STEP_DEGREES) return found.near++;
  found.far++;
  found.least = Math.min(found.least, degrees);
  found.most = Math.max(found.most, degrees);
}

await ready;
for (let at = 0; at < bytes.length; ) {
  const count = bytes.readUInt32LE(at);
  const start = bytes.byteOffset + at + 4;
  const rows = new Float32Array(bytes.buffer.slice(start, start + 48 * count)); // 12 of each corner
  const column = (first, size) =>
    Float32Array.from({ length: size * count }, (_, i) => rows[12 * ((i / size) | 0) + first + (i % size)]);
  const uv = column(6, 2);
  const given = [column(0, 3), column(3, 3), uv];
  const begin = process.cpuUsage();
  const theirs = generateTangents(...given);
  const { user, system } = process.cpuUsage(begin);
  seconds += (user + system) / 1e6;
  for (let c = 0; c < count; c++) {
    const wanted = theirs.subarray(4 * c, 4 * c + 4);
    compare(rows.subarray(12 * c + 8, 12 * c + 12), wanted, isFree(uv, c, wanted));
  }
  at += 4 + 48 * count;
}
console.log('| corners | |');
console.log('|---|---|');
console.log(`| within ${STEP_DEGREES}° | ${found.near} |`);
console.log(`| ${found.least.toFixed(3)}° to ${found.most.toFixed(2)}° | ${found.far} |`);
console.log(`| of the other orientation | ${found.turned} |`);
console.log(`| no group: any vector is right | ${found.free} |`);
console.log(`| CPU s of three.js | ${seconds.toFixed(2)} |`);
