// What a tree of relays takes for a number of users: cores, lines, money, and how much later light comes.
//     node relay_tree.mjs [USERS...]      a row for each number of users; default 1500 100000 1000000
//     node relay_tree.mjs check           the same arithmetic for the trees that were measured, beside what was measured
// Coefficients are read out of docs/lab/relays.md: what a user costs a network thread from the run at the daemon
// alone, by how much a hop delays from clients of one relay. The check predicts what three relays take to serve,
// and the delay by a relay of a relay.
// Prices: LW_CORE_HOUR and LW_EGRESS_GB, in dollars.
import { readFileSync } from 'node:fs';
import { argv, env, exit } from 'node:process';

const text = readFileSync(new URL('../../docs/lab/relays.md', import.meta.url), 'utf8');
const price = { coreHour: Number(env.LW_CORE_HOUR ?? 0.04), gigabyte: Number(env.LW_EGRESS_GB ?? 0.05) };
const LOOP_MAX = 0.6; // of a core: how much of its network thread a relay is to use
const LINE_MBIT = 2000; // of a relay's machine
const SESSIONS_MAX = 10000;
const FAN_OUT = 50; // relays below a server
const SEED = 1;

/** Rows of the table with this first column, as lists of cells. */
function tableOf(column) {
  const lines = text.split('\n');
  const begin = lines.findIndex((line) => line.startsWith(`| ${column} |`)) + 2;
  const end = lines.findIndex((line, i) => i > begin && !line.startsWith('|'));
  return lines.slice(begin, end).map((line) => line.split('|').slice(1, -1).map((cell) => cell.trim()));
}

const runs = tableOf('users').map((cells) => {
  const [solve, publish, serve, mbit, light, relayServe, relayMbit] = cells.slice(2).map(Number);
  const users = Number(cells[0].replace(',', ''));
  return { users, at: cells[1], solve, publish, serve, mbit, light, relayServe, relayMbit };
});
const run = (users, at) => runs.find((each) => each.users === users && each.at === at);
const [alone, through, few] = [run(1500, 'the daemon'), run(1500, 'three relays'), run(150, 'three relays')];

/** How much later a tile came than at the daemon, ms: shares of tiles, and delays up to which they come. */
const hops = tableOf('run')
  .map((cells) => ({ run: cells[0], at: cells[1], p50: Number(cells[6]), p90: Number(cells[7]), p99: Number(cells[8]) }))
  .filter(({ at }) => at !== 'the daemon');

// a user: core and Mbit/s of its server; a relay: cores for light; a relay below: core and Mbit/s of its feeder
const user = { core: alone.serve / alone.users, mbit: through.relayMbit / through.users };
const relay = { core: few.light / 3, coreByUser: (through.light - few.light) / (through.users - few.users) };
const child = { core: through.serve / 3, mbit: through.mbit / 3 };

// ---- delays ----

/** Uniform in [0, 1): mulberry32. */
function randomOf(seed) {
  let a = seed;
  return () => {
    a = (a + 0x6d2b79f5) | 0;
    let t = Math.imul(a ^ (a >>> 15), 1 | a);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
}

/** A delay with these quantiles, linear between them; symmetric below the median. */
function delay({ p50, p90, p99 }, share) {
  const line = (x0, y0, x1, y1) => y0 + ((share - x0) / (x1 - x0)) * (y1 - y0);
  if (share < 0.1) return line(0, p50 - (p99 - p50), 0.1, p50 - (p90 - p50));
  if (share < 0.5) return line(0.1, 2 * p50 - p90, 0.5, p50);
  if (share < 0.9) return line(0.5, p50, 0.9, p90);
  return line(0.9, p90, 0.99, p99);
}

/** Quantiles of the sum over hops, of as many tiles. */
function delays(hop, count, tiles) {
  const random = randomOf(SEED);
  const sums = new Float64Array(tiles);
  for (let i = 0; i < tiles; i++) for (let k = 0; k < count; k++) sums[i] += delay(hop, random());
  sums.sort();
  const at = (share) => sums[Math.floor(share * (tiles - 1))];
  return { p50: at(0.5), p90: at(0.9), p99: at(0.99) };
}

// ---- the tree ----

/** Relays with users, and levels of relays above them, until a daemon can feed the topmost. */
function treeOf(users, leaves = 0) {
  const most = Math.floor(Math.min(SESSIONS_MAX, LINE_MBIT / user.mbit, (LOOP_MAX - relay.core) / user.core));
  const levels = [leaves || Math.ceil(users / most)];
  while (levels.at(-1) > FAN_OUT) levels.push(Math.ceil(levels.at(-1) / FAN_OUT));
  const relays = levels.reduce((sum, count) => sum + count, 0);
  const inner = relays - levels[0];
  const serve = users * user.core + (relays - levels.at(-1)) * child.core;
  const light = relays * relay.core + users * relay.coreByUser;
  return {
    users,
    leaves: levels[0],
    inner,
    hops: levels.length,
    serve,
    light,
    mbit: users * user.mbit + (relays - levels.at(-1)) * child.mbit,
    daemonServe: levels.at(-1) * child.core,
    daemonMbit: levels.at(-1) * child.mbit,
  };
}

const cores = (tree) => tree.serve + tree.light + tree.daemonServe + through.solve + through.publish;
/** Dollars an hour of one user: cores that are busy, and gigabytes that leave. */
function costOf(tree) {
  const gigabytes = ((tree.mbit + tree.daemonMbit) * 3600) / 8 / 1000;
  return { core: (cores(tree) * price.coreHour) / tree.users, egress: (gigabytes * price.gigabyte) / tree.users };
}

// ---- what it prints ----

const number = (value, digits) => value.toLocaleString('en', { maximumFractionDigits: digits });

function check() {
  const lines = [];
  const compare = (what, predicted, measured, tolerance) => {
    const off = predicted / measured - 1;
    const fails = Math.abs(off) > tolerance;
    lines.push(`| ${what} | ${number(predicted, 3)} | ${number(measured, 3)} | ${number(100 * off, 0)} % |`);
    if (fails) lines.push(`| that is off by more than ${100 * tolerance} % | | | |`);
    return !fails;
  };
  let good = true;
  for (const measured of [through, few]) {
    const tree = treeOf(measured.users, 3);
    good &= compare(`three relays serve ${measured.users} users, cores`, tree.serve, measured.relayServe, 0.15);
  }
  for (const { run: name, ...two } of hops.filter(({ at }) => at === 'a relay of it')) {
    const one = hops.find((hop) => hop.run === name && hop.at === 'a relay');
    const sum = delays(one, 2, 100000);
    good &= compare(`run ${name}, two hops, p50 ms`, sum.p50, two.p50, 0.2);
    good &= compare(`run ${name}, two hops, p99 ms`, sum.p99, two.p99, 0.2);
  }
  console.log(['| what | predicted | measured | off by |', '|---|---|---|---|', ...lines].join('\n'));
  return good;
}

function plan(counts) {
  const hop = hops.find(({ run: name, at }) => name === '2' && at === 'a relay'); // of an idle machine
  const lines = counts.map((users) => {
    const tree = treeOf(users);
    const cost = costOf(tree);
    const late = delays(hop, tree.hops, Math.min(users, 1_000_000));
    return [
      number(users, 0),
      `${number(tree.leaves, 0)} + ${number(tree.inner, 0)}`,
      number(cores(tree), 1),
      number(tree.mbit / 1000, 1),
      `${number(tree.daemonServe, 3)} / ${number(tree.daemonMbit, 1)}`,
      `${number(late.p50, 1)} / ${number(late.p99, 1)}`,
      number(100 * cost.core, 4),
      number(100 * cost.egress, 2),
    ];
  });
  console.log(
    '| users | relays with users + above | cores | Gbit/s to users | daemon: network, cores / Mbit/s | light later, ms, p50 / p99 ' +
      '| cent a user-hour: cores | egress |\n|---|---|---|---|---|---|---|---|',
  );
  for (const cells of lines) console.log(`| ${cells.join(' | ')} |`);
}

if (argv[2] === 'check') exit(check() ? 0 : 1);
plan((argv.length > 2 ? argv.slice(2) : ['1500', '100000', '1000000']).map(Number));
