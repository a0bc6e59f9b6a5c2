// waiting.ts: why there is no light yet, in words: what a server does before its first light.
import type { Waiting } from './wire.ts';

export const READY = 4;
/** By WAITING's numbers of stages; after READY there may be those of newer servers. */
const WORDS = ['', 'Placing texels', 'Looking inside objects', 'First light'];

/** 'The server is lighting the scene, 42 %: looking inside objects'; else as waitingText(). */
export function lightingText(waiting: Waiting | null): string {
  const words = waiting && WORDS[waiting.stage];
  if (!words) return waitingText(waiting);
  return `The server is lighting the scene, ${Math.round(100 * waiting.share)} %: ${words.toLowerCase()}`;
}

/** 'Looking inside objects: 42 %'; '': there is light. null: the server, which may be an older one, has not
 * said; stages of a newer one are told as that. */
export function waitingText(waiting: Waiting | null): string {
  if (waiting?.stage === READY) return '';
  const words = waiting && WORDS[waiting.stage];
  return words ? `${words}: ${Math.round(100 * waiting.share)} %` : 'Waiting for the first light';
}
