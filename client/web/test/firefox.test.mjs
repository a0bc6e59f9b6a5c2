// The page in Firefox, whose WebGL2 has no reversed depth: its picture against the CPU's.
import assert from 'node:assert/strict';
import { existsSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { bin, hasDaemon, startDaemon } from './daemon.mjs';
import { hasFirefox, openFirefox } from './firefox.mjs';
import { compare, pictureName, pixels, reference, savePicture, until } from './page.mjs';

const WIDTH = 480;
const HEIGHT = 270;
const missing =
  !hasDaemon() || !existsSync(join(bin, 'lightwell-view'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasFirefox() && 'there is no firefox-esr with Xvfb';

for (const [direct, limits] of [
  ['tiles', { difference: 2, flip: 0.03 }],
  ['auto', { difference: 4, flip: 0.06 }],
])
  test(`firefox: direct light, ${direct}`, { skip: missing || false }, async () => {
    const light = ['--clock', 'manual', '--light', 'whole', '--freeze', '0', '--codec', 'half'];
    const daemon = await startDaemon('builtin:cornell', ...light);
    const page = await openFirefox(WIDTH, HEIGHT).catch(async (error) => {
      await daemon.stop();
      throw error;
    });
    try {
      const camera = '0.3,1.2,3.4:0,0.8,0:45';
      const more = `&direct=${direct === 'tiles' ? 'tiles' : 'pixels'}`;
      await page.goto(`${daemon.url}?exposure=2&camera=${camera}${more}`);
      const errors = await page.evaluate(() => {
        globalThis.errors = [];
        addEventListener('error', (event) => errors.push(event.message));
        return lightwell.message().includes('WebGL2') ? [lightwell.message()] : [];
      });
      assert.deepEqual(errors, []);
      // light in the form that the page takes begins with the frame after it has joined
      await until(page, 'the scene', () => lightwell.stats.sceneMs > 0);
      daemon.frames(8);
      await until(
        page,
        'all tiles of the view',
        () =>
          lightwell.stats.surveys > 11 &&
          lightwell.stats.missing === 0 &&
          lightwell.stats.frame >= 8 &&
          lightwell.stats.settled === lightwell.stats.frames,
      );
      const web = await pixels(page);
      const options = ['--direct', direct, '--camera', camera, '--exposure', '2', '--renderer', 'cpu'];
      const cpu = await reference(page, daemon, `${WIDTH}x${HEIGHT}`, options);
      await savePicture(page, pictureName('builtin:cornell', `${direct}-firefox`));
      const { difference, flip } = compare(WIDTH, HEIGHT, cpu, web);
      console.log(`firefox, ${direct}: mean difference ${difference}/255, FLIP ${flip}`);
      assert.ok(difference <= limits.difference, `mean difference ${difference}/255`);
      assert.ok(flip <= limits.flip, `FLIP ${flip}`);
      assert.equal(await page.evaluate(() => lightwell.lightsDrawn().lights > 0), direct !== 'tiles');
      assert.deepEqual(await page.evaluate(() => errors), []);
    } finally {
      await page.close();
      await daemon.stop();
    }
  });
