// attention.ts: a viewer's interest set: the tiles of its picture, those around it, and those of a moment
// ago; as client/view/compose/attention.h.
import type { Survey } from './renderer.ts';
import { INTEREST_MAX } from './wire.ts';

const KEEP_MS = 2000;

export class Attention {
  private readonly seenMs = new Map<number, number>();

  /** Takes in a survey. Each samples other places of the pixels, so the last few count together, and all
   * since the view moved. */
  list(survey: Survey, nowMs: number, movedMs: number): Uint32Array {
    for (const id of survey.inPicture) this.seenMs.set(id, nowMs);
    for (const [id, ms] of this.seenMs) if (nowMs - ms > KEEP_MS && ms < movedMs) this.seenMs.delete(id);
    const all = new Set(this.seenMs.keys());
    for (const id of survey.around) all.add(id);
    // over the limit, tiles seen a moment ago are left out first, then those around the picture
    if (all.size <= INTEREST_MAX) return Uint32Array.from(all);
    const near = new Set([...survey.inPicture, ...survey.around]);
    return near.size <= INTEREST_MAX ? Uint32Array.from(near) : survey.inPicture;
  }
}
