// The services of docker/compose.relays.yaml without Docker: the same programs and options as processes of this machine,
// and the dashboard's figures asked of a Prometheus that watches them.
//     node compose.mjs SOURCE BIN      ports, folders and the scene are others: a machine has each port once, and the atrium
//                                      takes its time
//     node compose.mjs SOURCE BIN IN   as they are. IN has a program for each service, which runs a command where its
//                                      container would (docker/test_relays.sh), and one for this machine, `host`
import assert from 'node:assert/strict';
import { execFile, spawn, execFileSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { get } from 'node:http';
import { connect, createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { promisify } from 'node:util';

const [source, bin, inside] = process.argv.slice(2);
const LIMIT_MS = 240_000;
const paths = `${bin}:${process.env.PATH}:/usr/sbin`;
const has = (program) => !!execFileSync('sh', ['-c', `command -v ${program} || true`], { env: { PATH: paths } }).length;
for (const program of ['nats-server', 'prometheus'])
  if (!inside && !has(program)) {
    console.log(`skipped: there is no ${program}`);
    process.exit(0);
  }

/** Services by name, each with its program, options and published ports: what this file needs of YAML. */
function readServices(text) {
  const services = {};
  let service = null;
  for (const line of text.slice(text.indexOf('\nservices:\n')).split('\n').slice(2)) {
    if (/^\S/.test(line)) break;
    const name = /^ {2}([a-z0-9-]+):$/.exec(line);
    if (name) services[name[1]] = service = { entrypoint: [], command: [], ports: [], folders: [] };
    const list = /^ {4}(entrypoint|command): (\[.*\])$/.exec(line);
    if (list) service[list[1]] = JSON.parse(list[2]);
    const port = /^ {6}- "127\.0\.0\.1:(\d+):(\d+)"$/.exec(line);
    if (port) service.ports.push(port.slice(1).map(Number));
    const folder = /^ {6}- (\.\.\/[^:]+):/.exec(line);
    if (folder) service.folders.push(folder[1]);
  }
  return services;
}

const file = (name) => readFileSync(join(source, name), 'utf8');
const services = readServices(file('docker/compose.relays.yaml'));
assert.deepEqual(Object.keys(services), [
  ...['nats', 'daemon', 'relay-1', 'relay-2', 'relay-3'],
  ...['prometheus', 'grafana'],
]);
const relays = ['relay-1', 'relay-2', 'relay-3'];
const watched = ['daemon', ...relays];

// what is named is there: ports, folders, where Grafana finds its dashboard
const published = Object.values(services).flatMap(({ ports }) => ports.map(([outside]) => outside));
assert.equal(new Set(published).size, published.length, 'each port is published once');
for (const name of relays) {
  const { command } = services[name];
  const own = services[name].ports.map(([outside]) => outside);
  const others = command[command.indexOf('--servers') + 1].matchAll(/127\.0\.0\.1:(\d+)/g);
  for (const [, port] of others)
    assert.ok(published.includes(Number(port)) && !own.includes(Number(port)), `${name}: ${port}`);
}
for (const { folders } of Object.values(services))
  for (const folder of folders) assert.ok(existsSync(join(source, 'docker', folder)), folder);
const provider = file('packaging/grafana/provisioning/dashboards/lightwell.yaml');
const dashboards = /path: (\S+)/.exec(provider)[1];
assert.ok(file('docker/compose.relays.yaml').includes(`- ../packaging/grafana/dashboards:${dashboards}:ro`));

const folder = mkdtempSync(join(tmpdir(), 'lightwell-compose-'));
const running = [];
const processes = {};
const forwarders = [];

/** Program and arguments that run a service's command. */
const within = (name, command) => (inside ? [join(inside, name), ...command] : command);

/** Starts a service's command; resolves to what `ready`, regular expressions, find in what it says. */
function start(name, command, ready) {
  const [program, ...args] = within(name, command);
  const child = spawn(program, args, { env: { ...process.env, PATH: paths, OMP_WAIT_POLICY: 'passive' } });
  running.push(child);
  processes[name] = child;
  let said = '';
  return new Promise((resolve, reject) => {
    const hear = (data) => {
      said += data;
      const found = ready.map((each) => each.exec(said));
      if (found.every((each) => each)) resolve(found.map(([, port]) => Number(port)));
    };
    child.stdout.on('data', hear);
    child.stderr.on('data', hear);
    child.once('error', reject);
    child.once('exit', (code) => reject(new Error(`${program} ${args.join(' ')} ended with ${code}:\n${said}`)));
  });
}

const at = {}; // ports of services here, by their address in the compose file

function here(argument) {
  if (inside) return argument;
  if (/^0\.0\.0\.0:/.test(argument)) return '127.0.0.1:0';
  const folders = { '/data': 'data', '/var/lib/lightwell/keep': 'keep', 'builtin:atrium': null };
  if (folders[argument] === null) return 'builtin:cornell';
  if (folders[argument]) return join(folder, folders[argument]);
  return argument.replace(/\b(nats|daemon|relay-\d):\d+/g, (address) => `127.0.0.1:${at[address]}`);
}

const lineOf = (name) => [...services[name].entrypoint, ...services[name].command.map(here)];

/** Asks a service, or this machine. */
function ask(name, port, path) {
  const named = name ? { headers: { host: `${name}:7782` } } : {};
  const host = inside && name ? name : '127.0.0.1';
  return new Promise((resolve, reject) => {
    get({ host, port, path, ...(inside ? {} : named), agent: false }, (response) => {
      let body = '';
      response.setEncoding('utf8').on('data', (data) => (body += data));
      response.on('end', () => resolve({ status: response.statusCode, body }));
    }).once('error', reject);
  });
}

/** Tries again until it is so: servers are asked, which say nothing by themselves. */
let awaited = 'services';
async function until(what, isSo) {
  awaited = what;
  for (let answer; ; await new Promise((go) => setTimeout(go, 100))) if ((answer = await isSo())) return answer;
}

const metricsOf = (text) => new Set([...text.matchAll(/^([a-z_]+)[ {]/gm)].map(([, name]) => name));

/** What Docker does with a published port. */
async function publish(name, [outside, port]) {
  const server = createServer((client) => {
    const service = connect(port, name);
    client.pipe(service).pipe(client);
    client.on('error', () => service.destroy());
    service.on('error', () => client.destroy());
  });
  forwarders.push(server);
  await new Promise((done) => server.listen(outside, '127.0.0.1', done));
}

/** From outside, as docker/README.md says: programs and pages by published ports. */
async function lookIn() {
  for (const name of [...relays, 'prometheus']) for (const port of services[name].ports) await publish(name, port);
  for (const port of [7790, 7791, 7792]) {
    const options = [`127.0.0.1:${port}`, '--users', '3', '--seconds', '2', '--json'];
    const [program, ...args] = within('host', ['lightwell-load', ...options]);
    const { stdout } = await promisify(execFile)(program, args);
    assert.ok(JSON.parse(stdout).tiles >= 0 && JSON.parse(stdout).users_at_end === 3);
  }
  for (const port of [7793, 7794]) {
    const { status, body } = await ask(null, port, '/');
    assert.ok(status === 200 && body.includes('<html'), `the page at ${port}`);
  }
}

async function run() {
  const options = inside ? [] : ['--addr', '127.0.0.1', '--port', '-1'];
  [at['nats:4222']] = await start('nats', [...lineOf('nats'), ...options], [/client connections on [\d.]+:(\d+)/]);
  const metrics = {};
  for (const name of watched) {
    const ready = [/serving .* at [\d.]+:(\d+)/, /monitoring: http:\/\/[\d.]+:(\d+)\/metrics/];
    [at[`${name}:7780`], metrics[name]] = await start(name, lineOf(name), ready);
  }

  // each is found under its service's name, and has light
  for (const name of watched)
    await until(`light of ${name}`, async () => (await ask(name, metrics[name], '/readyz')).status === 200);
  const texts = await Promise.all(watched.map((name) => ask(name, metrics[name], '/metrics')));

  // the tree at the daemon: two relays that take light from NATS, and the third below the first
  const nameOf = (relay) => (inside ? `${relay}:7780` : `127.0.0.1:${at[`${relay}:7780`]}`);
  const tree = inside ? ['lightwellctl'] : [join(bin, 'lightwellctl'), `127.0.0.1:${at['daemon:7780']}`];
  await until('the tree', async () => {
    const [program, ...args] = within('daemon', [...tree, 'tree']);
    const { stdout } = await promisify(execFile)(program, args);
    const [first, second, third] = ['  relay-1', '  relay-2', '    relay-3'].map((line) =>
      stdout.indexOf(`\n${line.replace(/relay.*/, nameOf)} `),
    );
    return first >= 0 && second >= 0 && third > first;
  });
  texts.push(await ask('relay-1', metrics['relay-1'], '/metrics'));

  // each metric of the dashboard is one that some server has
  const dashboard = JSON.parse(file('packaging/grafana/dashboards/lightwell.json'));
  const queries = dashboard.panels.flatMap(({ targets = [] }) => targets.map(({ expr }) => expr));
  const known = new Set(texts.flatMap(({ body }) => [...metricsOf(body)]));
  const used = new Set(queries.flatMap((query) => query.match(/\b(lightwell|process)_[a-z_]+/g)));
  assert.ok(queries.length > 10 && used.size > 10);
  assert.deepEqual([...used].filter((name) => !known.has(name)), [], 'metrics that no server has');
  // so is each of the rules, but what --crossover-report adds
  const rules = file('packaging/prometheus/lightwell.rules.yml');
  const named = new Set(rules.match(/\b(lightwell|process)_[a-z_]+(?=[{\[)\s])/g));
  const absent = [...named].filter((name) => !known.has(name));
  assert.ok(named.size > 10);
  assert.deepEqual(absent, ['lightwell_renderer_frame_cpu_seconds'], 'metrics of rules that no server has');
  const datasource = /uid: (\S+)/.exec(file('packaging/grafana/provisioning/datasources/lightwell.yaml'))[1];
  for (const panel of dashboard.panels) if (panel.datasource) assert.equal(panel.datasource.uid, datasource);

  // Prometheus finds all of them, and each query has an answer
  const config = file('packaging/prometheus/prometheus.relays.yml');
  const targets = config.match(/"[a-z0-9-]+:7782"/g).map((target) => target.slice(1, -6));
  assert.deepEqual(targets, watched);
  const changed = config
    .replace(/"([a-z0-9-]+):7782"/g, (_, name) => `"127.0.0.1:${metrics[name]}"`)
    .replace('lightwell.rules.yml', join(source, 'packaging/prometheus/lightwell.rules.yml'))
    .replace(/interval: 15s/g, 'interval: 1s');
  writeFileSync(join(folder, 'prometheus.yml'), changed);
  const prometheus = lineOf('prometheus').map((argument) =>
    argument
      .replace('/bin/prometheus', 'prometheus')
      .replace('/etc/prometheus/prometheus.relays.yml', join(folder, 'prometheus.yml'))
      .replace('path=/prometheus', `path=${join(folder, 'prometheus')}`)
      .replace('0.0.0.0:9090', '127.0.0.1:0'),
  );
  const command = inside ? lineOf('prometheus') : prometheus;
  const [port] = await start('prometheus', command, [/msg="Listening on" address=\S*:([1-9]\d*)/]);
  const query = async (text) => {
    const { status, body } = await ask('prometheus', port, `/api/v1/query?query=${encodeURIComponent(text)}`);
    if (status === 503) return []; // it is starting
    const answer = JSON.parse(body);
    assert.equal(answer.status, 'success', `${text}: ${body}`);
    return answer.data.result;
  };
  await until('all servers', async () => (await query('sum(up)'))[0]?.value[1] === `${watched.length}`);
  const { groups } = JSON.parse((await ask('prometheus', port, '/api/v1/rules')).body).data;
  const alerts = groups.flatMap((group) => group.rules).filter(({ type }) => type === 'alerting');
  assert.equal(alerts.length, rules.match(/- alert:/g).length);
  for (const { name, health } of alerts) assert.notEqual(health, 'err', name);
  for (const text of queries) await until(text, async () => (await query(text)).length > 0);
  if (inside) await lookIn();

  // the first relay dies: the third one goes to the daemon itself
  const above = `lightwell_upstream_connected{address="${here('daemon:7780')}"} 1`;
  processes['relay-1'].kill('SIGKILL');
  await until(above, async () => (await ask('relay-3', metrics['relay-3'], '/metrics')).body.includes(above));
}

const limit = setTimeout(() => {
  console.error(`it has not ended within ${LIMIT_MS / 1000} s: it waited for ${awaited}`);
  for (const child of running) child.kill('SIGKILL');
  process.exit(1);
}, LIMIT_MS);
try {
  await run();
} finally {
  for (const child of running.reverse()) {
    if (child.exitCode !== null || child.signalCode) continue;
    const ended = new Promise((done) => child.once('exit', done));
    child.kill('SIGTERM');
    await ended;
  }
  for (const server of forwarders) server.close();
  clearTimeout(limit);
  rmSync(folder, { recursive: true });
}
console.log('all services ran, and each figure of the dashboard is there');
