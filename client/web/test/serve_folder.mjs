// serve_folder.mjs: a page, the files of a folder, and three.js from node_modules, by HTTP on loopback.
import { createReadStream, existsSync } from 'node:fs';
import { createServer } from 'node:http';
import { join } from 'node:path';

const modules = new URL('../node_modules/', import.meta.url).pathname;

/** Resolves to the server, which listens. page: the text at /. */
export function serveFolder(folder, page) {
  const server = createServer((request, response) => {
    const path = decodeURIComponent(new URL(request.url, 'http://x').pathname);
    const file = path.startsWith('/node_modules/') ? join(modules, path.slice(14)) : join(folder, path);
    if (path === '/') return response.writeHead(200, { 'content-type': 'text/html' }).end(page);
    if (!existsSync(file)) return response.writeHead(404).end();
    const type = file.endsWith('.js') ? 'text/javascript' : 'application/octet-stream';
    response.writeHead(200, { 'content-type': type });
    createReadStream(file).pipe(response);
  });
  return new Promise((resolve) => server.listen(0, '127.0.0.1', () => resolve(server)));
}
