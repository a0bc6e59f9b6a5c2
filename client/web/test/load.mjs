// load.mjs: the client's modules, and its own C, for tests in Node.js. LW_WEB names the folder that was
// built.
import { build } from 'esbuild';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

export const root = new URL('../../../', import.meta.url).pathname;
export const web = process.env.LW_WEB ?? join(root, 'build/release/web');

const given = (names) => ({
  stdin: {
    contents: names.map((name) => `export * from './${name}.ts';`).join('\n'),
    resolveDir: new URL('../src/', import.meta.url).pathname,
    loader: 'ts',
  },
  bundle: true,
  logLevel: 'warning',
});

/** A script that makes all exports of modules of src the fields of a global object. */
export async function bundle(globalName, ...names) {
  const { outputFiles } = await build({ ...given(names), globalName, format: 'iife', write: false });
  return outputFiles[0].text;
}

/** All exports of modules of src. */
export async function load(...names) {
  const folder = mkdtempSync(join(tmpdir(), 'lightwell-web-'));
  const file = join(folder, 'modules.mjs');
  await build({ ...given(names), outfile: file, format: 'esm', platform: 'node' });
  try {
    return await import(file);
  } finally {
    rmSync(folder, { recursive: true });
  }
}

export function wasm() {
  return readFileSync(join(web, 'lightwell_tiles.wasm'));
}

/** What a session needs of a page that has nothing and hears nothing. */
export const quietHost = {
  send() {},
  find: () => Promise.resolve(null),
  keep() {},
  progress() {},
};
