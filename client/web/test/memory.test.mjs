// A page that is open for long, light moving: its memory does not grow. LW_WEB_MINUTES: how long; default 10.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import test from 'node:test';

import { hasDaemon, startDaemon } from './daemon.mjs';
import { hasBrowser, openBrowser, until } from './page.mjs';

const MINUTES = Math.max(2, Number(process.env.LW_WEB_MINUTES ?? 10));
const SAMPLE_S = 5;
const GROWTH_MAX = 0.05;
const missing = !hasDaemon()
  ? 'there is no lightwelld in build/release/bin'
  : !hasBrowser() && 'there is no chromium';

const residentBytes = (pid) =>
  1024 * Number(/VmRSS:\s*(\d+)/.exec(readFileSync(`/proc/${pid}/status`, 'utf8'))?.[1] ?? 0);
const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
const megabytes = (bytes) => (bytes / 1e6).toFixed(1);

test(`memory over ${MINUTES} minutes`, { skip: missing || false }, async () => {
  const daemon = await startDaemon('builtin:atrium-matt', '--frame-rate', '5');
  const browser = await openBrowser('--js-flags=--expose-gc');
  try {
    const page = await browser.newPage({ viewport: { width: 240, height: 135 } });
    const thrown = [];
    page.on('pageerror', (error) => thrown.push(error.stack));
    await page.goto(`${daemon.url}?direct=tiles`); // so that a software GPU keeps up
    await until(page, 'light', () => lightwell.stats.first && lightwell.stats.pictures > 1);
    const whole = await browser.newBrowserCDPSession();
    const { processInfo } = await whole.send('SystemInfo.getProcessInfo');
    // of the renderers the one with the page is the largest
    const renderer = processInfo.filter(({ type }) => type === 'renderer').map(({ id }) => id);
    const [pid] = renderer.sort((a, b) => residentBytes(b) - residentBytes(a));
    const frames = await page.evaluate(() => lightwell.stats.frames);
    const minutes = [];
    for (let minute = 0; minute < MINUTES; minute++) {
      const samples = { renderer: [], heap: [], decoder: [] };
      const end = Date.now() + 60000;
      while (Date.now() < end) {
        await page.waitForTimeout(1000 * SAMPLE_S);
        const [heap, decoder] = await page.evaluate(() => {
          gc();
          return [performance.memory.usedJSHeapSize, lightwell.stats.decoderBytes];
        });
        samples.renderer.push(residentBytes(pid));
        samples.heap.push(heap);
        samples.decoder.push(decoder);
      }
      minutes.push(Object.fromEntries(Object.entries(samples).map(([name, values]) => [name, mean(values)])));
      const told = Object.entries(minutes.at(-1)).map(([name, bytes]) => `${name} ${megabytes(bytes)} MB`);
      console.log(`minute ${minute + 1}: ${told.join(', ')}`);
    }
    const after = await page.evaluate(() => lightwell.stats);
    console.log(`${after.frames - frames} frames of light, ${after.tiles} tiles, ${after.pictures} pictures`);
    assert.ok(after.frames - frames > MINUTES, 'the light did not move');
    const all = (minute) => minute.renderer + minute.heap + minute.decoder;
    const growth = all(minutes.at(-1)) / all(minutes[0]) - 1;
    console.log(`growth from the first minute to the last: ${(100 * growth).toFixed(1)} %`);
    assert.ok(growth <= GROWTH_MAX, `${(100 * growth).toFixed(1)} %`);
    assert.deepEqual(thrown, []);
  } finally {
    await browser.close();
    await daemon.stop();
  }
});
