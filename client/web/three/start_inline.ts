// start_inline.ts: in the place of start.ts in lightwell-three/inline: the worker and its WebAssembly as
// parts of this file, for pages from another place than the package, and bundlers that know no files.
// build.mjs gives the three modules.
import tiles from 'built:lightwell_tiles.wasm';
import source from 'built:worker.js';
import zstd from 'built:zstd.wasm';

import type { Wasm } from '../src/protocol.ts';

export function startWorker(_assets: string | URL | undefined): { worker: Worker; wasm: Wasm; end(): void } {
  const url = URL.createObjectURL(new Blob([source as string], { type: 'text/javascript' }));
  const worker = new Worker(url, { type: 'module' });
  const bytesOf = (bytes: Uint8Array) => bytes.slice().buffer as ArrayBuffer;
  const wasm = { tiles: bytesOf(tiles as Uint8Array), zstd: bytesOf(zstd as Uint8Array) };
  return { worker, wasm, end: () => URL.revokeObjectURL(url) };
}
