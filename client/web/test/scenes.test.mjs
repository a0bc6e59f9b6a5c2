// The page's pictures of larger scenes: LW_WEB_SCENES, apart by blanks, each SCENE@CAMERA@STOPS.
import { existsSync } from 'node:fs';
import { join } from 'node:path';
import test from 'node:test';

import { bin, hasDaemon } from './daemon.mjs';
import { hasBrowser } from './page.mjs';
import { comparePictures, scenePath, startStill } from './pictures.mjs';

const LIMIT_MS = 1500000;
const sponza = 'sponza/Sponza_lit.gltf@-8,1.8,-0.3:5,4,-0.3:75@-6';
const scenes = (process.env.LW_WEB_SCENES ?? `builtin:atrium-matt@@-4 ${sponza}`).split(' ');
const missing =
  !hasDaemon() || !existsSync(join(bin, 'lightwell-view'))
    ? 'there is no lightwelld in build/release/bin'
    : !hasBrowser() && 'there is no chromium';

for (const given of scenes) {
  const path = scenePath(given);
  const skip = missing || (!path.startsWith('builtin:') && !existsSync(path) && `there is no scene ${path}`);
  const [, camera = '', exposure = '0'] = given.split('@');
  for (const direct of ['tiles', 'auto'])
    test(`picture of ${given}, direct light: ${direct}`, { skip: skip || false }, async () => {
      const daemon = await startStill(path);
      try {
        await comparePictures(daemon, path, { direct, exposure, cameras: [camera] }, LIMIT_MS);
      } finally {
        await daemon.stop();
      }
    });
}
