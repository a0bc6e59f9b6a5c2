// proxy.mjs: the proxies of docs/access.md, as child processes on ports of this machine.
import { execFileSync, spawn } from 'node:child_process';
import { readFileSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:net';
import { join } from 'node:path';

import { LIMIT_MS, within } from './daemon.mjs';
import { root } from './load.mjs';

export const HOST = 'light.example.org';
const TRIES = 5; // a free port may be somebody else's a moment later
const paths = `${process.env.PATH}:/usr/sbin`;

export function hasProgram(name) {
  return !!execFileSync('sh', ['-c', `command -v ${name} || true`], { env: { PATH: paths } }).length;
}

/** The fenced block of the document in this language. */
export function blockOf(language) {
  const text = readFileSync(join(root, 'docs/access.md'), 'utf8');
  const found = [...text.matchAll(new RegExp(`^\`\`\`${language}\\n(.*?)^\`\`\`$`, 'gms'))];
  if (found.length !== 1) throw new Error(`docs/access.md has ${found.length} blocks of ${language}`);
  return found[0][1];
}

/** A text in which each of the replaced ones stands once. */
function replaced(text, pairs) {
  return pairs.reduce((changed, [from, to]) => {
    if (changed.split(from).length !== 2) throw new Error(`"${from}" does not stand once in:\n${text}`);
    return changed.replace(from, () => to);
  }, text);
}

function freePort() {
  return new Promise((resolve, reject) => {
    const server = createServer();
    server.once('error', reject);
    server.listen(0, '127.0.0.1', () => {
      const { port } = server.address();
      server.close(() => resolve(port));
    });
  });
}

function makeCertificate(folder) {
  const make = `req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=${HOST}`;
  const files = ['-keyout', join(folder, 'key.pem'), '-out', join(folder, 'certificate.pem')];
  execFileSync('openssl', [...make.split(' '), '-addext', `subjectAltName=DNS:${HOST}`, ...files], {
    stdio: 'ignore',
  });
}

/** How each proxy is started in a folder, and what it says once it listens. Only the ports, the address and
 * where files lie are other than in the document. */
const proxies = {
  nginx: (folder, port, backend) => {
    makeCertificate(folder);
    const temporary = ['client_body', 'proxy', 'fastcgi', 'uwsgi', 'scgi'];
    const block = replaced(blockOf('nginx'), [
      ['listen 443 ssl', `listen 127.0.0.1:${port} ssl`],
      ['127.0.0.1:7781', backend],
    ]);
    const text = `daemon off; master_process off; pid ${folder}/pid; error_log stderr notice;
      events {} http { access_log off; ${temporary.map((name) => `${name}_temp_path ${folder}/${name};`).join(' ')}
      ${block} }`;
    writeFileSync(join(folder, 'nginx.conf'), text);
    return { args: ['-p', folder, '-e', 'stderr', '-c', join(folder, 'nginx.conf')], ready: /event method/ };
  },
  caddy: (folder, port, backend) => {
    // a certificate that is there instead of one that it gets for a public name
    makeCertificate(folder);
    const options = `{
      admin off
      auto_https disable_redirects
      default_bind 127.0.0.1
      https_port ${port}
      storage file_system ${folder}/storage
    }\n`;
    const text = options + replaced(blockOf('caddy'), [
      [`${HOST} {`, `${HOST} {\n    tls ${folder}/certificate.pem ${folder}/key.pem`],
      ['127.0.0.1:7781', backend],
    ]);
    writeFileSync(join(folder, 'Caddyfile'), text);
    return {
      args: ['run', '--adapter', 'caddyfile', '--config', join(folder, 'Caddyfile')],
      ready: /serving initial configuration/,
    };
  },
};

/** Starts one in front of a daemon; resolves to its port and stop(), once it listens. */
export async function startProxy(name, folder, backend) {
  for (let tries = 1; ; tries++) {
    const port = await freePort();
    const { args, ready } = proxies[name](folder, port, backend);
    const child = spawn(name, args, { env: { PATH: paths, HOME: folder, XDG_DATA_HOME: folder, XDG_CONFIG_HOME: folder } });
    let said = '';
    const ended = new Promise((resolve) => child.once('exit', resolve));
    const limit = setTimeout(() => child.kill('SIGKILL'), LIMIT_MS);
    const stop = async () => {
      clearTimeout(limit);
      child.kill('SIGTERM');
      await within(`the end of ${name}`, ended);
    };
    const listens = new Promise((resolve) => {
      const hear = (data) => {
        said += data;
        if (ready.test(said)) resolve(true);
      };
      child.stdout.on('data', hear);
      child.stderr.on('data', hear);
      child.once('error', (error) => {
        said += error.message;
        resolve(false);
      });
      child.once('exit', () => resolve(false));
    });
    if (await listens) return { port, stop, said: () => said };
    clearTimeout(limit);
    if (tries === TRIES || !/in use/.test(said)) throw new Error(`${name} does not start:\n${said}`);
  }
}
