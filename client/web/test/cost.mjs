// cost.mjs: what a picture of the page costs where the CPU draws it, by the scene: CPU time of Chromium's
// process that draws (SwiftShader), all light in tiles.
//     node client/web/test/cost.mjs 480x270 builtin:atrium-matt builtin:atrium
// SCENE=FOLDER has the page of another build, which is in that folder.
// Prints CPU ms a sample of the picture, and each scene's over the first's: the median of five rounds, in
// each of which every scene is drawn once. Linux alone: it reads /proc.
import { readdirSync, readFileSync } from 'node:fs';

import { LIMIT_MS } from './daemon.mjs';
import { drawNothing, openBrowser, until } from './page.mjs';
import { scenePath, startStill } from './pictures.mjs';

const ROUNDS = 5;
const TICK_MS = 10; // of /proc
const [size, ...scenes] = process.argv.slice(2);
if (!scenes.length) {
  console.error('usage: node cost.mjs WIDTHxHEIGHT SCENE...');
  process.exit(64);
}
const [width, height] = size.split('x').map(Number);

const read = (pid, file) => {
  try {
    return readFileSync(`/proc/${pid}/${file}`, 'utf8');
  } catch {
    return ''; // it has ended
  }
};
const stat = (pid) => read(pid, 'stat').replace(/^.*\) /, '').split(' '); // from the third field on
const isOurs = (pid) => pid > 1 && (pid === process.pid || isOurs(Number(stat(pid)[1])));
const drawing = () =>
  readdirSync('/proc')
    .filter((pid) => /^\d+$/.test(pid) && read(pid, 'cmdline').includes('--type=gpu-process'))
    .find((pid) => isOurs(Number(pid)));
const cpuMs = (pid) => TICK_MS * (Number(stat(pid)[11]) + Number(stat(pid)[12]));

/** In the page: a picture with all of its samples; their number. */
function drawOne() {
  lightwell.dirty = true;
  lightwell.finish();
  document.querySelector('canvas').toDataURL(); // it is done, not only asked for
  return lightwell.samples;
}

async function openLit(browser, daemon) {
  const page = await browser.newPage({ viewport: { width, height } });
  page.setDefaultTimeout(LIMIT_MS);
  await page.goto(`${daemon.url}?direct=tiles&exposure=-4`);
  await until(page, 'the scene', () => lightwell.stats.sceneMs > 0);
  await page.evaluate(drawNothing);
  daemon.frames(1);
  const isLit = (finishes) => lightwell.stats.first && lightwell.stats.finishes >= finishes;
  await until(page, 'its light', isLit, { given: /finishes of/.test(daemon.said()) ? 1 : 0 });
  return page;
}

const daemons = [];
const browser = await openBrowser();
try {
  const pages = [];
  for (const scene of scenes) {
    const [name, folder] = scene.split('=');
    daemons.push(await startStill(scenePath(name), ...(folder ? ['--web-root', folder] : [])));
    pages.push(await openLit(browser, daemons.at(-1)));
  }
  const pid = drawing();
  const costs = scenes.map(() => []);
  for (let round = 0; round < ROUNDS; round++)
    for (const [i, page] of pages.entries()) {
      await page.bringToFront();
      const before = cpuMs(pid);
      const samples = await page.evaluate(drawOne);
      costs[i].push((cpuMs(pid) - before) / samples);
    }
  const median = (values) => [...values].sort((a, b) => a - b)[values.length >> 1];
  console.log(`| scene, ${size} | CPU ms | over the first |`);
  console.log('|---|---|---|');
  for (const [i, scene] of scenes.entries()) {
    const over = median(costs[i].map((ms, round) => ms / costs[0][round]));
    console.log(`| ${scene} | ${median(costs[i]).toFixed(0)} | ${over.toFixed(2)} |`);
  }
} finally {
  await browser.close();
  for (const daemon of daemons) await daemon.stop();
}
