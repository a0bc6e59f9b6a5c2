// example.mjs: serves the folder of a page that uses lightwell-three: example.html, a scene, node_modules.
import { createReadStream, existsSync } from 'node:fs';
import { createServer } from 'node:http';
import { extname, join } from 'node:path';

const types = { '.html': 'text/html', '.js': 'text/javascript', '.wasm': 'application/wasm' };
const modules = new URL('../node_modules/', import.meta.url).pathname;
const own = '/node_modules/lightwell-three/';

/** packageFolder: lightwell-three as it is built or installed; scene: the file that is /scene.gltf. Below
 * /three-170/ it is the same with node_modules/three-170 as three. */
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
