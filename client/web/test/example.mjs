// example.mjs: serves the folder of a page that uses lightwell-three: example.html, a scene, node_modules;
// waits for that page's light.
import { createReadStream, existsSync } from 'node:fs';
import { createServer } from 'node:http';
import { dirname, extname, join } from 'node:path';

import { until } from './page.mjs';

const types = { '.html': 'text/html', '.js': 'text/javascript', '.wasm': 'application/wasm' };
const modules = new URL('../node_modules/', import.meta.url).pathname;
const own = '/node_modules/lightwell-three/';

/** packageFolder: lightwell-three as it is built or installed; scene: the file that is /scene.gltf, with the
 * files beside it. Below /three-170/ it is the same with node_modules/three-170 as three. */
export function serveExample(packageFolder, scene) {
  const server = createServer((request, response) => {
    const asked = decodeURIComponent(new URL(request.url, 'http://x').pathname);
    const [, three = 'three'] = /^\/(three-\d+)\//.exec(asked) ?? [];
    const path = asked.replace(/^\/three-\d+/, '').replace('/node_modules/three/', `/node_modules/${three}/`);
    let file = join(packageFolder, path);
    if (path === '/scene.gltf') file = scene;
    else if (path === '/test.html') file = new URL('three_page.html', import.meta.url).pathname;
    else if (path.startsWith(own)) file = join(packageFolder, path.slice(own.length));
    else if (path.startsWith('/node_modules/')) file = join(modules, path.slice('/node_modules/'.length));
    if (!existsSync(file)) file = join(dirname(scene), path);
    if (!existsSync(file)) return response.writeHead(404).end();
    response.writeHead(200, { 'content-type': types[extname(file)] ?? 'application/json' });
    createReadStream(file).pipe(response);
  });
  return new Promise((resolve) => {
    server.listen(0, '127.0.0.1', () =>
      resolve({ origin: `http://127.0.0.1:${server.address().port}`, server }),
    );
  });
}

/** In the page: its picture by way of a render target, for a canvas of WebGPU by SwiftShader stays white.
 * There three neither maps tones nor encodes sRGB. */
export async function readTarget() {
  const { DataUtils, HalfFloatType, RenderTarget } = await import('three');
  const { scene, camera, renderer } = example;
  const { width, height } = renderer.domElement;
  const target = new RenderTarget(width, height, { type: HalfFloatType, samples: 4 });
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  const linear = await renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height);
  renderer.setRenderTarget(null);
  target.dispose();
  const encode = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
  const stride = linear.length / height;
  const image = new ImageData(width, height);
  for (let at = 0; at < image.data.length; at++) {
    const [row, inRow] = [Math.floor(at / (4 * width)), at % (4 * width)];
    const value = Math.min(
      renderer.toneMappingExposure * DataUtils.fromHalfFloat(linear[row * stride + inRow]),
      1,
    );
    image.data[at] = at % 4 === 3 ? 255 : Math.round(255 * encode(value));
  }
  const canvas = document.createElement('canvas');
  Object.assign(canvas, { width, height });
  canvas.getContext('2d').putImageData(image, 0, 0);
  return canvas.toDataURL();
}

/** In the page, before all else: it draws when told to, and what its worker says is noted. */
export function hookExample() {
  const waiting = [];
  globalThis.requestAnimationFrame = (draw) => waiting.push(draw);
  globalThis.drawOne = () => {
    const draws = waiting.splice(0);
    for (const draw of draws) draw(performance.now());
    return draws.length > 0;
  };
  const heard = { scene: false, settled: 0, timeS: 0, frame: 0, tiles: new Set() };
  globalThis.heard = heard;
  const hear = ({ data }) => {
    if (data.kind === 'scene') heard.scene = true;
    if (data.kind === 'tiles') for (const id of data.batch.id) heard.tiles.add(id);
    if (data.kind === 'settled') heard.settled = heard.frame;
    if (data.kind !== 'frame') return;
    heard.frame = Number(data.frame.frame);
    heard.timeS = data.frame.timeS;
  };
  globalThis.Worker = class extends Worker {
    constructor(...given) {
      super(...given);
      this.addEventListener('message', hear);
    }
  };
}

/** The page with all light of `frames` frames. */
export async function untilExampleIsLit(page, daemon, frames) {
  await until(page, 'all tiles of the view', () => {
    if (!globalThis.example) return drawOne() && false;
    const { light, camera, renderer } = example;
    light.update(camera, renderer.domElement.height);
    return light.listInterest(camera, renderer.domElement.height).every((id) => heard.tiles.has(id));
  });
  const last = daemon.frames(frames);
  const settled = (frame) => {
    const { light, camera, renderer } = example;
    light.update(camera, renderer.domElement.height);
    return heard.settled >= frame && !light.queue.length;
  };
  await until(page, 'the last tiles', settled, { given: last });
}
