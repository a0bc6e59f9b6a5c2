// page.mjs: the page in Debian's Chromium, drawn by SwiftShader. Its headless shell comes first: the same
// engine without a browser's windows, which opens a page for a fifth of the CPU time. LW_CHROMIUM names
// another program.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

import { bin, LIMIT_MS } from './daemon.mjs';

// by require(): import parses all of it once more, to find what it exports
const { chromium } = createRequire(import.meta.url)('playwright-core');
const SHELL = '/usr/bin/chromium-headless-shell';
const program = [process.env.LW_CHROMIUM ?? SHELL, '/usr/bin/chromium', '/usr/bin/chromium-browser'].find(
  existsSync,
);
/** It draws windows without the GPU, and reads each canvas back. */
export const readsCanvas = program === SHELL;

export function hasBrowser() {
  return !!program;
}

export async function openBrowser(...more) {
  const graphics = ['--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'];
  const browser = await chromium.launch({
    executablePath: program,
    args: [...graphics, '--no-sandbox', ...more],
  });
  const open = browser.newContext.bind(browser); // newPage() calls it, too
  browser.newContext = async (...given) => {
    const context = await open(...given);
    watchShaders(context);
    return context;
  };
  return browser;
}

/** What the page, WebGLRenderer and WebGPURenderer say of a shader that does not compile. */
const BROKEN =
  /does not take our shaders|THREE\.WebGLProgram: Shader Error|pipeline creation failed|THREE\.TSL:/;
const broken = new WeakMap();

function watchShaders(context) {
  const logs = []; // the browser's own, of WebGPU
  const promise = new Promise((_, reject) => {
    context.on('console', (message) => {
      const text = message.text();
      if (message.type() === 'warning' && /WGSL/.test(text)) logs.push(text);
      if (message.type() === 'error' && BROKEN.test(text))
        reject(new Error(`a shader is broken: ${[text, ...logs].join('\n')}`));
    });
  });
  promise.catch(() => {});
  broken.set(context, promise);
}

/** Rejects with the log of the first shader of the context's pages that does not compile. */
export function brokenShader(context) {
  return broken.get(context) ?? new Promise(() => {});
}

/** In the page: from now on it takes light, but draws with lightwell.finish() alone, and looks once in two
 * seconds what light it lacks: without a GPU pictures cost more than all else. */
export function drawNothing() {
  const look = lightwell.look.bind(lightwell);
  let lookedMs = 0;
  lightwell.draw = () => (lightwell.dirty = false);
  lightwell.look = (now) => now > lookedMs + 2000 && look((lookedMs = now));
}

/** Waits until a function of the page, of what is given, is true. A shader that does not compile ends it. */
export async function until(page, what, expression, { given = null, limitMs = LIMIT_MS } = {}) {
  const waited = page.waitForFunction(expression, given, { timeout: limitMs, polling: 100 });
  await Promise.race([waited, brokenShader(page.context())]).catch(async (error) => {
    waited.catch(() => {}); // the page's end ends it
    const state = await page.evaluate(() =>
      JSON.stringify(
        globalThis.lightwell ? { ...lightwell.stats, uploadMs: 0, message: lightwell.message() } : 'no page',
      ),
    );
    throw new Error(`waited for ${what}: ${state}: ${error.message}`);
  });
}

/** The page as axe-core judges it: nothing serious. Returns what it finds, in lines. */
export async function checkAccessibility(page, what) {
  const source = readFileSync(new URL('../node_modules/axe-core/axe.min.js', import.meta.url), 'utf8');
  await page.evaluate(`typeof axe === 'undefined' && (0, eval)(${JSON.stringify(source)}), 0`);
  const { violations, passes } = await page.evaluate(() => axe.run());
  const lines = violations.map(
    ({ id, impact, nodes, help }) => `${impact}: ${id}: ${help}: ${nodes.map((node) => node.html).join(' ')}`,
  );
  console.log(`axe, ${what}: ${passes.length} rules hold; ${lines.length ? lines.join('; ') : 'no violation'}`);
  const serious = lines.filter((line) => /^(serious|critical)/.test(line));
  assert.deepEqual(serious, [], what);
  return lines;
}

/** None of the page's boxes covers another, or leaves the window. */
export async function checkLayout(page, what) {
  const boxes = await page.evaluate(() =>
    ['legend', 'token', 'lamps', 'message', 'wait', 'help', 'tools'].flatMap((id) => {
      const { left, top, right, bottom } = document.getElementById(id).getBoundingClientRect();
      return right > left && bottom > top ? [{ id, left, top, right, bottom }] : [];
    }),
  );
  const { width, height } = page.viewportSize();
  for (const [i, a] of boxes.entries()) {
    const inside = a.left >= 0 && a.top >= 0 && a.right <= width && a.bottom <= height;
    assert.ok(inside, `${what}: ${JSON.stringify(a)} in ${width} x ${height}`);
    for (const b of boxes.slice(i + 1)) {
      const apart = a.right <= b.left || b.right <= a.left || a.bottom <= b.top || b.bottom <= a.top;
      assert.ok(apart, `${what}: ${JSON.stringify(a)} covers ${JSON.stringify(b)}`);
    }
  }
  return boxes.map(({ id }) => id);
}

/** A window of that size whose canvas has a quarter of its width and height: for what is around the canvas,
 * since SwiftShader's pictures cost by their size. */
export async function resizeAround(page, size) {
  const { width, height } = size;
  const style = pictureName('page', '') ? '' : `width: ${width / 4}px; height: ${height / 4}px`;
  await page.evaluate((text) => (document.querySelector('canvas').style.cssText = text), style);
  await page.setViewportSize(size);
}

/** A picture as 3 bytes a pixel, row 0 on top. url: data of a PNG; none: what the page shows now. */
export async function pixelsOf(page, url) {
  const base64 = await page.evaluate(async (source) => {
    if (!source) lightwell.finish();
    const from = source ?? document.querySelector('canvas').toDataURL();
    const bytes = Uint8Array.from(atob(from.slice(from.indexOf(',') + 1)), (char) => char.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes]));
    const canvas = new OffscreenCanvas(image.width, image.height);
    const context = canvas.getContext('2d');
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, image.width, image.height);
    let text = '';
    for (let i = 0; i < data.length; i += 4) text += String.fromCharCode(data[i], data[i + 1], data[i + 2]);
    return btoa(text);
  }, url);
  return Buffer.from(base64, 'base64');
}

export function pixels(page) {
  return pixelsOf(page, null);
}

/** Where a picture is left for people to look at: PREFIX-SCENE-WHAT.png with LW_WEB_PICTURES; '': nowhere. */
export function pictureName(scene, what) {
  const prefix = process.env.LW_WEB_PICTURES;
  return prefix ? `${prefix}-${scene.replace(/^builtin:|.*\//, '').replace(/\..*/, '')}-${what}.png` : '';
}

/** Leaves the page's picture in a file; '': nowhere. */
export async function savePicture(page, name) {
  if (!name) return;
  const shown = await page.evaluate(() => {
    lightwell.finish();
    return document.querySelector('canvas').toDataURL();
  });
  writeFileSync(name, Buffer.from(shown.slice(shown.indexOf(',') + 1), 'base64'));
}

/** The CPU's picture of the same light. keepAs: a file. */
export async function reference(page, daemon, size, options, keepAs = '') {
  const folder = mkdtempSync(join(tmpdir(), 'lightwell-web-'));
  const png = join(folder, 'view.png');
  const args = [`127.0.0.1:${daemon.port}`, '--headless', '--wait', 'complete', '--size', size,
    '--mirrors', 'off', '--out', png];
  try {
    execFileSync(join(bin, 'lightwell-view'), [...args, ...options], { stdio: 'pipe', timeout: LIMIT_MS });
    if (keepAs) writeFileSync(keepAs, readFileSync(png));
    return await pixelsOf(page, `data:image/png;base64,${readFileSync(png).toString('base64')}`);
  } finally {
    rmSync(folder, { recursive: true });
  }
}

/** Of each picture's time tiles get 3 ms, of the page's own clock: it moves by 1 ms at each look at it, and a
 * long batch comes. taker: an expression, who takes tiles; take: takes those of one picture. */
export async function checkUploads(page, taker, take) {
  const taken = await page.evaluate(
    ([taker, take]) => {
      const owner = (0, eval)(taker);
      const { width, height } = (owner.map ?? owner.renderer.map).place(0);
      const [count, size] = [64, width * height];
      const batch = {
        id: new Uint32Array(count),
        noiseLevel: new Uint8Array(count),
        directions: [],
        texels: new Uint32Array(count * size),
      };
      const first = { batch, at: 0, texel: 0 };
      owner.queue = [first];
      const steps = [];
      let ms = performance.now();
      performance.now = () => ++ms;
      for (let before = 0; owner.queue.length; before = first.at) {
        (0, eval)(take);
        steps.push(first.at - before);
      }
      delete performance.now;
      return steps;
    },
    [taker, take],
  );
  assert.equal(
    taken.reduce((sum, count) => sum + count, 0),
    64,
  );
  assert.ok(Math.max(...taken) <= 4 && Math.min(...taken) > 0, `tiles of each picture: ${taken}`);
}

/** The mean difference of channels in 255ths, and the mean of FLIP. */
export function compare(width, height, a, b) {
  const folder = mkdtempSync(join(tmpdir(), 'lightwell-web-'));
  try {
    writeFileSync(join(folder, 'a'), a);
    writeFileSync(join(folder, 'b'), b);
    const args = [String(width), String(height), join(folder, 'a'), join(folder, 'b')];
    const said = execFileSync(join(bin, 'compare_pictures'), args, { encoding: 'utf8' });
    const [difference, flip] = said.split(' ').map(Number);
    return { difference, flip };
  } finally {
    rmSync(folder, { recursive: true });
  }
}
