// bundlers.mjs: apps that use lightwell-three as npm packs it, built by bundlers as their users do.
import { build as esbuild } from 'esbuild';
import { execFile, execFileSync } from 'node:child_process';
import { cpSync, createReadStream, existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { statSync, symlinkSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { dirname, extname, join } from 'node:path';
import { promisify } from 'node:util';

import { LIMIT_MS, startDaemon } from './daemon.mjs';
import { web } from './load.mjs';
import { until } from './page.mjs';
import { room } from './room.mjs';
import { withPage } from './shared.mjs';

const here = (path) => new URL(path, import.meta.url).pathname;
const own = here('../node_modules');
const more = here('bundlers/node_modules'); // of test-long
const types = {
  '.html': 'text/html',
  '.js': 'text/javascript',
  '.css': 'text/css',
  '.wasm': 'application/wasm',
};

/** Whether scripts/deps.sh --all has fetched the bundlers of the long tests. */
export function hasMore() {
  return existsSync(more);
}

/** lightwell-three as `npm pack` makes it, unpacked into a folder; returns the names of its files. */
export function pack(folder) {
  const options = ['pack', '--json', '--ignore-scripts', '--offline', '--pack-destination', folder];
  const said = execFileSync('npm', [...options, join(web, '../lightwell-three')], {
    encoding: 'utf8',
    timeout: LIMIT_MS,
    stdio: ['ignore', 'pipe', 'pipe'],
  });
  const [{ filename, files }] = Object.values(JSON.parse(said));
  execFileSync('tar', ['xzf', join(folder, filename), '-C', folder], { timeout: LIMIT_MS });
  return files.map(({ path }) => path);
}

/** A copy of an example with its node_modules. three: which version's folder. inline: the other entry. */
function makeApp(folder, { example, three = 'three', inline = false }) {
  cpSync(here(`../three/examples/${example}`), folder, { recursive: true });
  const modules = join(folder, 'node_modules');
  mkdirSync(modules);
  cpSync(join(dirname(folder), 'package'), join(modules, 'lightwell-three'), { recursive: true });
  for (const name of ['react', 'react-dom', 'scheduler', '@react-three'])
    symlinkSync(join(own, name), join(modules, name));
  symlinkSync(join(own, three), join(modules, 'three'));
  mkdirSync(join(folder, 'public'));
  writeFileSync(join(folder, 'public/scene.gltf'), room());
  if (!inline || example !== 'vite') return;
  const main = readFileSync(join(folder, 'main.js'), 'utf8');
  writeFileSync(join(folder, 'main.js'), main.replace("'lightwell-three'", "'lightwell-three/inline'"));
  rmSync(join(folder, 'vite.config.js')); // it needs no settings
  writeFileSync(join(folder, 'vite.config.js'), "export default { build: { target: 'es2022' } };\n");
}

/** Serves the files of a folder, and nothing else: no page in the place of a file that is not there. */
function serveFolder(folder, policy = () => '') {
  const server = createServer((request, response) => {
    const path = decodeURIComponent(new URL(request.url, 'http://x').pathname);
    const file = join(folder, path.endsWith('/') ? `${path}index.html` : path);
    if (!existsSync(file) || statSync(file).isDirectory()) return response.writeHead(404).end();
    const type = types[extname(file)] ?? 'application/octet-stream';
    response.writeHead(200, { 'content-type': type, 'content-security-policy': policy() });
    createReadStream(file).pipe(response);
  });
  const close = () => {
    server.close();
    server.closeAllConnections();
  };
  return new Promise((resolve) => {
    server.listen(0, '127.0.0.1', () =>
      resolve({ origin: `http://127.0.0.1:${server.address().port}`, close }),
    );
  });
}

/** An import map by which a page has three from a folder of modules, and more. */
function importMap(modules, more = {}) {
  const imports = {
    three: `${modules}/three/build/three.module.js`,
    'three/addons/': `${modules}/three/examples/jsm/`,
    ...more,
  };
  return `<script type="importmap">${JSON.stringify({ imports })}</script>`;
}

const html = '<!doctype html><meta charset="utf-8"><body><script type="module" src="app.js"></script>';

/** A page around app.js, beside the scene. */
function addPage(app, out) {
  writeFileSync(join(out, 'index.html'), html);
  cpSync(join(app, 'public'), out, { recursive: true });
}

async function vite(folder) {
  return import(join(folder, 'vite/dist/node/index.js'));
}

const buildByVite =
  (from) =>
  async (app, { policy, threeApart = false }) => {
    const { build } = await vite(from);
    const rollupOptions = threeApart ? { external: /^three(\/|$)/ } : {};
    await build({ root: app, logLevel: 'error', build: { rollupOptions } });
    const out = join(app, 'dist');
    if (threeApart) {
      const page = readFileSync(join(out, 'index.html'), 'utf8');
      writeFileSync(join(out, 'index.html'), page.replace('<script', `${importMap('./modules')}<script`));
      mkdirSync(join(out, 'modules'));
      symlinkSync(join(own, 'three'), join(out, 'modules/three'));
    }
    return serveFolder(out, policy);
  };

const serveByVite = (from) => async (app) => {
  const { createServer: create } = await vite(from);
  const options = { host: '127.0.0.1', port: 0, hmr: false, fs: { strict: false } };
  const server = await create({ root: app, logLevel: 'error', server: options });
  await server.listen();
  const origin = `http://127.0.0.1:${server.httpServer.address().port}`;
  return { origin, close: () => server.close() };
};

/** How an app is built: returns an origin and what closes it. query: for the page's address. threeApart: the
 * page has three beside it, by an import map. */
export const bundlers = {
  'Vite 6, build': buildByVite(own),
  'Vite 6, dev server': serveByVite(own),
  'Vite 8, build': buildByVite(more),
  'Vite 8, dev server': serveByVite(more),
  'webpack 5': async (app) => {
    const { default: webpack } = await import(join(more, 'webpack/lib/index.js'));
    const options = { path: join(app, 'dist'), filename: 'app.js', publicPath: 'auto' };
    const config = { mode: 'production', context: app, entry: './main.js', output: options };
    const stats = await promisify(webpack)({ ...config, performance: { hints: false } });
    if (stats.hasErrors()) throw new Error(stats.toString('errors-only'));
    addPage(app, join(app, 'dist'));
    return serveFolder(join(app, 'dist'));
  },
  esbuild: async (app, { inline }) => {
    const out = join(app, 'dist');
    const options = { bundle: true, format: 'esm', target: 'es2022', logLevel: 'error' };
    await esbuild({ ...options, entryPoints: [join(app, 'main.js')], outfile: join(out, 'app.js') });
    // it knows no `new URL(...)`: a folder with the three files, which the option `assets` names
    if (!inline)
      for (const name of ['worker.js', 'lightwell_tiles.wasm', 'zstd.wasm'])
        cpSync(join(app, 'node_modules/lightwell-three', name), join(out, 'lightwell', name));
    addPage(app, out);
    return { ...(await serveFolder(out)), query: inline ? '' : '&assets=lightwell' };
  },
  'Next 15, build': async (app) => {
    // one React for the page and for Next
    for (const name of ['react', 'react-dom']) rmSync(join(app, 'node_modules', name));
    for (const name of ['next', 'react', 'react-dom'])
      symlinkSync(join(more, name), join(app, 'node_modules', name));
    mkdirSync(join(app, 'pages'));
    const config = { output: 'export', outputFileTracingRoot: dirname(more) };
    writeFileSync(join(app, 'next.config.mjs'), `export default ${JSON.stringify(config)};`);
    const page = `import { useEffect } from 'react';
      export default function Page() { useEffect(() => void import('../main.js'), []); return null; }`;
    writeFileSync(join(app, 'pages/index.js'), page);
    const env = { ...process.env, NEXT_TELEMETRY_DISABLED: '1', NODE_ENV: 'production' };
    const args = [join(more, 'next/dist/bin/next'), 'build'];
    await promisify(execFile)(process.execPath, args, { cwd: app, env, timeout: LIMIT_MS });
    return serveFolder(join(app, 'out'));
  },
  'no bundler': async (app) => {
    const map = importMap('./node_modules', {
      'lightwell-three': './node_modules/lightwell-three/lightwell.js',
      'lightwell-three/inline': './node_modules/lightwell-three/inline.js',
    });
    const page = readFileSync(join(app, 'index.html'), 'utf8').replace('/main.js', './main.js');
    writeFileSync(join(app, 'index.html'), page.replace('</head>', `${map}</head>`));
    cpSync(join(app, 'public'), app, { recursive: true });
    return serveFolder(app);
  },
};

/** Builds an app and opens it in Chromium; it has to be lit. folder: with the unpacked package. */
export async function open(folder, bundler, options) {
  const app = mkdtempSync(join(folder, 'app-'));
  makeApp(app, options);
  let daemon = null;
  const policy = () =>
    options.csp
      ?.replaceAll('HOST:PORT', new URL(daemon.url).host)
      .concat("; default-src 'none'; style-src 'unsafe-inline'") ?? '';
  const site = await bundlers[bundler](app, { ...options, policy });
  const warned = [];
  const look = async (page) => {
    page.on('console', (message) => message.type() === 'error' && warned.push(message.text()));
    const server = `ws://${new URL(daemon.url).host}/ws`;
    await page.goto(`${site.origin}/?scene=scene.gltf&server=${server}${site.query ?? ''}`);
    const isLit = () => {
      if (globalThis.example?.light?.state !== 'live')
        return document.querySelector('#state')?.textContent || false;
      const { renderer, scene, camera } = example;
      renderer.render(scene, camera);
      const small = document.createElement('canvas');
      Object.assign(small, { width: 32, height: 18 });
      const context = small.getContext('2d');
      context.drawImage(renderer.domElement, 0, 0, 32, 18);
      const { data } = context.getImageData(0, 0, 32, 18);
      // each of its pixels is lit
      return Array.from({ length: 32 * 18 }, (_, i) => data[4 * i] + data[4 * i + 1]).every(
        (sum) => sum > 20,
      );
    };
    const lit = async () => (await page.evaluate(isLit)) === true;
    await until(page, `light (${bundler})`, () => globalThis.example?.light?.state === 'live', {
      limitMs: Number(process.env.LW_LIMIT_MS ?? LIMIT_MS),
    }).catch(async (error) => {
      throw new Error(`${await page.evaluate(() => document.body.innerText)} ${warned}: ${error.message}`);
    });
    if (!(await lit())) throw new Error(`${bundler}: its picture is dark`);
    return page.evaluate(() => ({ frame: example.light.frame }));
  };
  try {
    const lights = ['--client-lights', 'lamps', '--texels-per-metre', '16', '--http-origin', site.origin];
    daemon = await startDaemon(join(app, 'public/scene.gltf'), ...lights);
    return await withPage({ width: 320, height: 180 }, look, { mayWarn: true });
  } finally {
    await daemon?.stop();
    await site.close();
  }
}
