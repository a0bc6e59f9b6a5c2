// firefox.mjs: the page in Debian's Firefox, by WebDriver BiDi; drawn by Mesa's software into Xvfb's memory,
// for without a display this Firefox has no WebGL.
import { spawn } from 'node:child_process';
import { existsSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import WebSocket from 'ws';

const program = '/usr/bin/firefox-esr';
const displayProgram = '/usr/bin/Xvfb';
const START_MS = 120000;
const ANSWER_MS = 120000;

export function hasFirefox() {
  return existsSync(program) && existsSync(displayProgram);
}

/** A display of its own choice. */
async function startDisplay() {
  const args = ['-displayfd', '3', '-screen', '0', '1280x1024x24', '-nolisten', 'tcp'];
  const child = spawn(displayProgram, args, { stdio: ['ignore', 'ignore', 'ignore', 'pipe'] });
  const number = await new Promise((resolve, reject) => {
    const limit = setTimeout(() => reject(new Error('Xvfb did not start')), START_MS);
    child.stdio[3].once('data', (data) => {
      clearTimeout(limit);
      resolve(Number(data));
    });
    child.once('error', reject);
    child.once('exit', (code) => reject(new Error(`Xvfb ended with ${code}`)));
  }).finally(() => child.exitCode === null || child.kill('SIGKILL'));
  return { name: `:${number}`, stop: () => child.kill('SIGTERM') };
}

const preferences = {
  'webgl.force-enabled': true,
  'webgl.disable-fail-if-major-performance-caveat': true,
  'browser.shell.checkDefaultBrowser': false,
  'datareporting.policy.dataSubmissionEnabled': false,
  'app.update.enabled': false,
};

/** Resolves to a page: goto, evaluate, waitForFunction and screenshot are as playwright's, as far as tests of
 * ours go; close() ends all. */
export async function openFirefox(width, height) {
  const profile = mkdtempSync(join(tmpdir(), 'lightwell-firefox-'));
  const lines = Object.entries(preferences).map(([key, value]) => `user_pref("${key}", ${value});\n`);
  writeFileSync(join(profile, 'user.js'), lines.join(''));
  const display = await startDisplay();
  const args = ['--no-remote', '--profile', profile, '--remote-debugging-port', '0'];
  const size = ['--width', String(width), '--height', String(height)];
  const env = { ...process.env, LIBGL_ALWAYS_SOFTWARE: '1', HOME: profile, DISPLAY: display.name };
  // a group of its own: it ends with its children
  const child = spawn(program, [...args, ...size], {
    env,
    detached: true,
    stdio: ['ignore', 'pipe', 'pipe'],
  });
  const gone = new Promise((resolve) => child.once('exit', resolve));
  const end = async () => {
    try {
      process.kill(-child.pid, 'SIGKILL');
    } catch {
      // it has ended by itself
    }
    await gone;
    display.stop();
    rmSync(profile, { recursive: true, force: true, maxRetries: 5 });
  };
  try {
    const address = await new Promise((resolve, reject) => {
      let said = '';
      const limit = setTimeout(() => reject(new Error(`firefox did not start: ${said}`)), START_MS);
      const hear = (data) => {
        said += data;
        const found = /WebDriver BiDi listening on (ws:\/\/\S+)/.exec(said);
        if (!found) return;
        clearTimeout(limit);
        resolve(found[1]);
      };
      child.stdout.on('data', hear);
      child.stderr.on('data', hear);
      child.once('exit', (code) => reject(new Error(`firefox ended with ${code}: ${said}`)));
    });
    const socket = new WebSocket(`${address}/session`);
    await new Promise((resolve, reject) => socket.once('open', resolve).once('error', reject));
    const waiting = new Map();
    socket.on('message', (data) => {
      const message = JSON.parse(data);
      waiting.get(message.id)?.(message);
      waiting.delete(message.id);
    });
    let id = 0;
    const ask = (method, params) =>
      new Promise((resolve, reject) => {
        const limit = setTimeout(() => reject(new Error(`firefox: no answer to ${method}`)), ANSWER_MS);
        waiting.set(++id, (message) => {
          clearTimeout(limit);
          if (message.type === 'error') reject(new Error(`firefox: ${method}: ${message.message}`));
          else resolve(message.result);
        });
        socket.send(JSON.stringify({ id, method, params }));
      });
    await ask('session.new', { capabilities: {} });
    const { contexts } = await ask('browsingContext.getTree', {});
    const { context } = contexts[0];
    await ask('browsingContext.setViewport', { context, viewport: { width, height } });
    /** A function, or its text; what it returns is JSON. */
    const evaluate = async (what, given) => {
      const answer = await ask('script.evaluate', {
        expression: `(async () => JSON.stringify(await (${what})(${JSON.stringify(given)})))()`,
        target: { context },
        awaitPromise: true,
      });
      if (answer.type === 'exception') throw new Error(`firefox: ${answer.exceptionDetails.text}`);
      return answer.result.value === undefined ? undefined : JSON.parse(answer.result.value);
    };
    return {
      goto: (url) => ask('browsingContext.navigate', { context, url, wait: 'complete' }),
      evaluate,
      async waitForFunction(what, given, { timeout, polling }) {
        const end = Date.now() + timeout;
        while (!(await evaluate(what, given))) {
          if (Date.now() > end) throw new Error(`not so after ${timeout} ms`);
          await new Promise((go) => setTimeout(go, polling));
        }
      },
      async screenshot() {
        const { data } = await ask('browsingContext.captureScreenshot', { context });
        return Buffer.from(data, 'base64');
      },
      async close() {
        socket.close();
        await end();
      },
    };
  } catch (error) {
    await end();
    throw error;
  }
}
