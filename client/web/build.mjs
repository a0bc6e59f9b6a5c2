// build.mjs OUT: bundles the browser client into a folder: index.html, lightwell.css, lightwell.js,
// worker.js, zstd.wasm; and the npm package lightwell-three into a folder beside it. lightwell_tiles.wasm is
// in OUT already.
import { build } from 'esbuild';
import { copyFileSync, existsSync, mkdirSync, readdirSync, readFileSync, writeFileSync } from 'node:fs';
import ts from 'typescript';

import { namesFor, shorten } from './shorten.mjs';

const out = process.argv[2];
if (!out) {
  console.error('usage: node build.mjs OUT');
  process.exit(64);
}
mkdirSync(out, { recursive: true });
const here = (path) => new URL(path, import.meta.url).pathname;
// zstddec brings its WebAssembly as text, a third more bytes than a file of its own
const zstdApart = {
  name: 'zstd-apart',
  setup({ onLoad }) {
    onLoad({ filter: /zstddec\.mjs$/ }, ({ path }) => {
      const source = readFileSync(path, 'utf8');
      const contents = source
        .replace(/const wasm = "([^"]+)"/, (_, text) => {
          writeFileSync(`${out}/zstd.wasm`, Buffer.from(text, 'base64'));
          return '';
        })
        .replace(
          'fetch(`data:application/wasm;base64,${wasm}`).then((response) => response.arrayBuffer())',
          'ZSTDDecoder.load()',
        );
      if (!contents.includes('init = ZSTDDecoder.load()') || !existsSync(`${out}/zstd.wasm`))
        throw new Error('zstddec is not as build.mjs knows it');
      return { contents, loader: 'js' };
    });
  },
};
// shaders are text that no bundler shortens
const shaderFiles = ['shader_head', 'finish_shaders', 'shaders'].map((name) => here(`src/${name}.ts`));
const exportsOf = async (path) => {
  const { outputFiles } = await build({ entryPoints: [path], bundle: true, format: 'esm', write: false });
  return import(`data:text/javascript;base64,${Buffer.from(outputFiles[0].text).toString('base64')}`);
};
const shortShaders = {
  name: 'short-shaders',
  async setup({ onLoad }) {
    const modules = await Promise.all(shaderFiles.map(exportsOf));
    const isShader = (value) => typeof value === 'string';
    const names = namesFor(modules.flatMap((module) => Object.values(module).filter(isShader)));
    onLoad({ filter: /shader(s|_head)\.ts$/ }, ({ path }) => {
      const short = (value) => JSON.stringify(isShader(value) ? shorten(value, names) : value);
      const values = Object.entries(modules[shaderFiles.indexOf(path)]);
      const lines = values.map(([name, value]) => `export const ${name} = ${short(value)};`);
      return { contents: lines.join('\n') };
    });
  },
};
const bundled = {
  bundle: true,
  minify: true,
  format: 'esm',
  target: ['es2022'],
  legalComments: 'none',
  logLevel: 'warning',
};
await build({
  ...bundled,
  plugins: [zstdApart, shortShaders],
  entryPoints: { lightwell: here('src/main.ts'), worker: here('src/worker.ts') },
  outdir: out,
  define: { FOR_THREE: 'false' },
});
for (const name of ['index.html', 'lightwell.css']) copyFileSync(here(`src/${name}`), `${out}/${name}`);

// for pages with three.js, beside it
const three = `${out}/../lightwell-three`;
mkdirSync(three, { recursive: true });
// lightwell-three/inline: start_inline.ts in the place of start.ts, and what that wants
const inline = {
  name: 'inline',
  setup({ onResolve, onLoad }) {
    onResolve({ filter: /^\.\/start\.ts$/ }, () => ({ path: here('three/start_inline.ts') }));
    onResolve({ filter: /^built:/ }, ({ path }) => ({ path: path.slice(6), namespace: 'built' }));
    onLoad({ filter: /./, namespace: 'built' }, ({ path }) => ({
      contents: readFileSync(`${three}/${path}`),
      loader: path.endsWith('.wasm') ? 'binary' : 'text',
    }));
  },
};
for (const name of ['zstd.wasm', 'lightwell_tiles.wasm']) copyFileSync(`${out}/${name}`, `${three}/${name}`);
for (const [path, plugins] of [
  ['src/worker.ts', [zstdApart]],
  ['three/lightwell.ts', []],
  ['three/inline.ts', [inline]],
])
  await build({
    ...bundled,
    plugins,
    entryPoints: [here(path)],
    outdir: three,
    external: ['three'],
    define: { FOR_THREE: 'true' },
  });
writeFileSync(`${three}/lightwell.d.ts`, declarationsOf('lightwell'));
writeFileSync(`${three}/inline.d.ts`, "export * from './lightwell.js';\n");
for (const name of ['package.json', 'README.md', 'example.html'])
  copyFileSync(here(`three/${name}`), `${three}/${name}`);
copyFileSync(here('../../LICENSE'), `${three}/LICENSE`);
writeFileSync(`${three}/NOTICE`, notice());

/** What a module of three/ declares, without what is private. */
function declarationsOf(name) {
  const fileName = here(`three/${name}.ts`);
  const compilerOptions = { target: 'ES2022', module: 'ESNext', strict: true, isolatedDeclarations: true };
  const { outputText, diagnostics } = ts.transpileDeclaration(readFileSync(fileName, 'utf8'), {
    fileName,
    compilerOptions: { ...compilerOptions, declaration: true },
    reportDiagnostics: true,
  });
  if (diagnostics.length) throw new Error(ts.formatDiagnostics(diagnostics, ts.createCompilerHost({})));
  const text = outputText.replace(
    /^( {4}\/\*\*(?:(?!\*\/)[^])*\*\/\n)?    private (?!constructor)[^\n]*;\n/gm,
    '',
  );
  if (/'\.\.?\//.test(text)) throw new Error(`${name}.d.ts names a module that the package does not have`);
  return text;
}

/** The licences of what is compiled in: zstddec, and zstd in it. */
function notice() {
  const folder = here('node_modules/zstddec/');
  const zstd = /\/\*\*\n\* BSD License\n[^]*?\*\//.exec(readFileSync(`${folder}dist/zstddec.mjs`, 'utf8'));
  if (!zstd) throw new Error('zstddec does not say the licence of zstd where build.mjs knows it');
  const plain = zstd[0].replace(/^\/\*\*\n|\*\/$/g, '').replace(/^\* ?/gm, '');
  const own = readFileSync(
    `${folder}${readdirSync(folder).find((name) => /^LICEN[CS]E/.test(name))}`,
    'utf8',
  );
  const said = 'worker.js, zstd.wasm and inline.js contain zstddec, and zstd.';
  return `${said}\n\nzstddec\n\n${own}\nzstd\n\n${plain}`;
}
