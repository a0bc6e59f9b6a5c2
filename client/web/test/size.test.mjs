// All that a browser loads stays small, by brotli and by gzip, and is what it loads without them. Finishes cost
// 6 kB: their shaders, their reader, the tables that the GPU makes.
import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';
import { brotliDecompressSync, gunzipSync } from 'node:zlib';

import { web } from './load.mjs';

const names = readdirSync(web).filter((name) => !/\.(br|gz)$/.test(name));
const file = (name) => readFileSync(join(web, name));

for (const [ending, most, decompress] of [
  ['.br', 82000, brotliDecompressSync],
  ['.gz', 90000, gunzipSync],
])
  test(`the client is at most ${most / 1000} kB as ${ending}`, () => {
    assert.ok(names.includes('worker.js'));
    const sizes = names.map((name) => {
      const coded = file(name + ending);
      assert.ok(decompress(coded).equals(file(name)), name);
      return [name, coded.length];
    });
    const all = sizes.reduce((sum, [, size]) => sum + size, 0);
    assert.ok(all <= most, `${all} bytes: ${sizes.map((each) => each.join(' ')).join(', ')}`);
  });
