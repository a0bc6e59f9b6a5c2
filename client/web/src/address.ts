// address.ts: which server a page asks.

/** The WebSocket beside a page: a proxy may serve both below a path of its own. */
function socketBeside(page: URL): string {
  const url = new URL('ws', page);
  url.protocol = page.protocol === 'https:' ? 'wss:' : 'ws:';
  return url.href;
}

/** given: the parameter `server`, or null. Either an address, or what is wrong with it, in a sentence. */
export function serverAddress(page: URL, given: string | null): { url: string } | { problem: string } {
  const secure = page.protocol === 'https:';
  const url = given ?? socketBeside(page);
  if (!/^wss?:\/\/[^/]+/.test(url))
    return { problem: `server=${url}: it is not ws://HOST:PORT/ws or wss://HOST:PORT/ws` };
  const local = /^ws:\/\/(localhost|127\.0\.0\.1|\[::1\])[:/]/.test(`${url}/`);
  if (!secure || !url.startsWith('ws:') || local) return { url };
  return {
    problem:
      `${url}: a page that came by https may not open a connection that is not encrypted. ` +
      "Give the server's wss:// address, or open this page by http.",
  };
}
