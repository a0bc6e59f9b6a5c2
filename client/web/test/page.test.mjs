// The page's picture against the CPU's, of the same light from the same camera.
import assert from 'node:assert/strict';
import { existsSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { bin, hasDaemon, startDaemon } from './daemon.mjs';
import { compare, hasBrowser, openBrowser, pixels, reference, until } from './page.mjs';

const WIDTH = 480;
const HEIGHT = 270;
const missing =
  !hasDaemon() || !existsSync(join(bin, 'lightwell-view'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';

const scenes = (process.env.LW_WEB_SCENES ?? 'builtin:cornell').split(' ');
const cameras = { 'builtin:cornell': '0.3,1.2,3.4:0,0.8,0:45' };
const exposures = { 'builtin:cornell': '2' };

for (const given of scenes) {
  const [scene, camera = cameras[given] ?? '', exposure = exposures[given] ?? '0'] = given.split('@');
  test(`picture of ${scene}`, { skip: missing || false }, async () => {
    const daemon = await startDaemon(
      scene,
      '--clock',
      'manual',
      '--light',
      'whole',
      '--freeze',
      '0',
      '--codec',
      'half',
    );
    const browser = await openBrowser();
    try {
      const page = await browser.newPage({ viewport: { width: WIDTH, height: HEIGHT } });
      const thrown = [];
      page.on('pageerror', (error) => thrown.push(error.stack));
      await page.goto(`${daemon.url}?exposure=${exposure}${camera ? `&camera=${camera}` : ''}`);
      daemon.frames(8);
      await until(
        page,
        'all tiles of the view',
        () =>
          lightwell.stats.wanted > 0 &&
          lightwell.stats.missing === 0 &&
          lightwell.stats.frames > 7 &&
          lightwell.stats.settled === lightwell.stats.frames,
      );
      const web = await pixels(page);
      const view = await page.evaluate(() => lightwell.view());
      const cpu = await reference(page, daemon, `${WIDTH}x${HEIGHT}`, [
        '--direct',
        'tiles',
        '--camera',
        camera || view,
        '--exposure',
        exposure,
      ]);
      if (process.env.LW_WEB_PICTURES)
        await page.screenshot({ path: `${process.env.LW_WEB_PICTURES}-web.png` });
      const { difference, flip } = compare(WIDTH, HEIGHT, cpu, web);
      console.log(`${scene}: mean difference ${difference}/255, FLIP ${flip}`);
      assert.ok(difference <= 2, `mean difference ${difference}/255`);
      assert.ok(flip <= 0.03, `FLIP ${flip}`);
      assert.deepEqual(thrown, []);
    } finally {
      await browser.close();
      await daemon.stop();
    }
  });
}
