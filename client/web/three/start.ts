// start.ts: the worker and its WebAssembly as files beside this one. Bundlers know these forms of
// `new URL(..., import.meta.url)`: they must stand as they are.
import type { Wasm } from '../src/protocol.ts';

/** assets: a folder that holds the three files; undefined: they are beside this module. */
export function startWorker(assets: string | URL | undefined): { worker: Worker; wasm: Wasm; end(): void } {
  const end = () => {};
  if (assets === undefined) {
    const worker = new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
    const tiles = new URL('./lightwell_tiles.wasm', import.meta.url).href;
    const zstd = new URL('./zstd.wasm', import.meta.url).href;
    return { worker, wasm: { tiles, zstd }, end };
  }
  const folder = new URL(assets, document.baseURI);
  if (!folder.pathname.endsWith('/')) folder.pathname += '/';
  const at = (name: string) => new URL(name, folder).href;
  const worker = new Worker(at('worker.js'), { type: 'module' });
  return { worker, wasm: { tiles: at('lightwell_tiles.wasm'), zstd: at('zstd.wasm') }, end };
}
