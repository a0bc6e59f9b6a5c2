// refusal.ts: why a WebSocket did not open. A browser hides the answer to the handshake from the page, so
// that a server that is down and one that forbids the page look the same: a GET of the same path tells them
// apart.

const LIMIT_MS = 5000;
const TEXT_MAX = 200;

export interface Why {
  forbidden: boolean; // trying again does not help
  text: string;
}

/** What fetch() gives, as far as it is needed. */
interface Answer {
  status: number;
  text(): Promise<string>;
}

/** The same place by HTTP. */
export function httpAddress(url: string): string {
  return url.replace(/^ws/, 'http');
}

export function whyOf(status: number, text: string): Why {
  const line = text.split('\n')[0]!.slice(0, TEXT_MAX);
  if (status === 403) return { forbidden: true, text: `the server forbids this page: ${line}` };
  if (status === 426) return { forbidden: false, text: 'the server is there and takes no connection now' };
  return { forbidden: false, text: `what answers there is no lightwelld (HTTP ${status})` };
}

/** Asks; never rejects. */
export async function askWhy(url: string, ask: typeof fetch = fetch): Promise<Why> {
  const nobody = { forbidden: false, text: 'nothing answers there' };
  const cancel = new AbortController();
  const limit = setTimeout(() => cancel.abort(), LIMIT_MS);
  try {
    const given: RequestInit = { cache: 'no-store', credentials: 'omit', signal: cancel.signal };
    const answer: Answer = await ask(httpAddress(url), given);
    return whyOf(answer.status, await answer.text());
  } catch {
    return nobody;
  } finally {
    clearTimeout(limit);
  }
}
