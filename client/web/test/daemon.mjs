// daemon.mjs: a real lightwelld for tests, on ports of its own choice.
import { spawn } from 'node:child_process';
import { existsSync } from 'node:fs';
import { join } from 'node:path';

import { root } from './load.mjs';

export const bin = process.env.LW_BIN ?? join(root, 'build/release/bin');
/** Ends what hangs, and judges nothing: a test waits for events, on however busy a machine. */
export const LIMIT_MS = 480000;

/** What a promise resolves to, within the limit. */
export async function within(what, promise) {
  let limit;
  const late = new Promise((_, reject) => {
    limit = setTimeout(() => reject(new Error(`waited for ${what}`)), LIMIT_MS);
  });
  return Promise.race([promise, late]).finally(() => clearTimeout(limit));
}

export function hasDaemon() {
  return existsSync(join(bin, 'lightwelld'));
}

/** Starts one; resolves once it listens. frames(n) lights frames under the manual clock, and says the last
 * one's number. stop() ends it; crash() gives it no time to say so. */
export const startDaemon = (...options) => startServer('lightwelld', ...options);

/** The same of a relay; options: the server above first. */
export const startRelay = (...options) => startServer('lightwell-relay', ...options);

function startServer(program, ...options) {
  const addresses = ['--listen', '127.0.0.1:0'];
  if (!options.includes('--http')) addresses.push('--http', '127.0.0.1:0');
  // a start that finds what an earlier one has saved says less of the wait
  if (!options.includes('--cache')) addresses.push('--cache', '');
  const child = spawn(join(bin, program), [...addresses, ...options], {
    env: { ...process.env, OMP_WAIT_POLICY: 'passive' },
  });
  let said = '';
  let frames = 0;
  const end = (signal) =>
    new Promise((ended) => {
      if (child.exitCode !== null || child.signalCode) return ended();
      child.once('exit', ended);
      child.kill(signal);
    });
  return new Promise((resolve, reject) => {
    const limit = setTimeout(() => {
      child.kill('SIGKILL');
      reject(new Error(`${program} did not start:\n${said}`));
    }, LIMIT_MS);
    const hear = (data) => {
      said += data;
      const address = /serving .* at 127\.0\.0\.1:(\d+)/.exec(said);
      const page = /https?:\/\/127\.0\.0\.1:\d+\//.exec(said);
      if (!address || !page) return;
      clearTimeout(limit);
      resolve({
        port: Number(address[1]),
        url: page[0],
        said: () => said,
        frames: (count) => {
          child.stdin.write('\n'.repeat(count));
          return (frames += count);
        },
        stop: () => end('SIGTERM'),
        crash: () => end('SIGKILL'),
      });
    };
    child.stdout.on('data', hear);
    child.stderr.on('data', hear);
    child.once('error', reject);
    child.once('exit', (code) => reject(new Error(`${program} ended with ${code}:\n${said}`)));
  });
}
