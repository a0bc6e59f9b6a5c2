// exposure.ts: the exposure that suits a picture: lw_tonemap_auto_stops() of client/view/tonemap.c.

const BINS = 1024;
const PER_STOP = 8;
const DARKEST_SHARE = 0.05;
const BRIGHTEST_SHARE = 0.1;
const KEY = 0.18;

/** rgba: 4 a pixel, linear. Stops that put the log-average luminance at 0.18; null for a black picture. */
export function autoStops(rgba: Float32Array): number | null {
  const histogram = new Uint32Array(BINS);
  let lit = 0;
  for (let i = 0; i < rgba.length; i += 4) {
    const luminance = 0.2126 * rgba[i]! + 0.7152 * rgba[i + 1]! + 0.0722 * rgba[i + 2]!;
    if (!(luminance > 1e-18) || !Number.isFinite(luminance)) continue;
    const bin = Math.floor(Math.log2(luminance) * PER_STOP + BINS / 2);
    histogram[Math.min(BINS - 1, Math.max(0, bin))]!++;
    lit++;
  }
  if (!lit) return null;
  const first = DARKEST_SHARE * lit;
  const last = (1 - BRIGHTEST_SHARE) * lit;
  let [below, weight, sum] = [0, 0, 0];
  histogram.forEach((count, i) => {
    const inside = Math.min(below + count, last) - Math.max(below, first);
    if (inside > 0) {
      weight += inside;
      sum += (inside * (i + 0.5 - BINS / 2)) / PER_STOP;
    }
    below += count;
  });
  return Math.log2(KEY) - sum / weight;
}
