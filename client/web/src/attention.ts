// attention.ts: which tiles a viewer wants: those of its picture, those around it, and those that it saw a
// moment ago; as client/view/attention.h.
import type { Survey } from './renderer.ts';
import { INTEREST_MAX } from './wire.ts';

const KEEP_MS = 2000;

export class Attention {
  private readonly seenMs = new Map<number, number>();

  /** Takes in a survey. Each looks at other places of the pixels: what one of the last found counts, and what
   * any found since the view moved. */
  list(survey: Survey, nowMs: number, movedMs: number): Uint32Array {
    for (const id of survey.inPicture) this.seenMs.set(id, nowMs);
    for (const [id, ms] of this.seenMs) if (nowMs - ms > KEEP_MS && ms < movedMs) this.seenMs.delete(id);
    const all = new Set(this.seenMs.keys());
    for (const id of survey.around) all.add(id);
    // where that is too much, what was seen a moment ago is left out first, then what lies around
    if (all.size <= INTEREST_MAX) return Uint32Array.from(all);
    const near = new Set([...survey.inPicture, ...survey.around]);
    return near.size <= INTEREST_MAX ? Uint32Array.from(near) : survey.inPicture;
  }
}
