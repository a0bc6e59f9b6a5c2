// store.ts: compressed parts of scene packages in the browser's storage, by hash, those used last. Where
// there is none, or it is full, parts are downloaded again: no harm. IndexedDB, since the Cache API is closed
// to pages from http://HOST.
import type { PartStore } from './download.ts';

const KEPT_BYTES = 512 << 20;

function done<T>(request: IDBRequest<T>): Promise<T> {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
}

interface Row {
  hash: string;
  used: number; // ms since 1970
  bytes: Uint8Array;
}

export class Store implements PartStore {
  private constructor(private readonly db: IDBDatabase | null) {}

  static async open(): Promise<Store> {
    try {
      const request = indexedDB.open('lightwell', 1);
      request.onupgradeneeded = () => {
        request.result.createObjectStore('parts', { keyPath: 'hash' }).createIndex('used', 'used');
      };
      return new Store(await done(request));
    } catch {
      return new Store(null);
    }
  }

  async find(hash: string): Promise<Uint8Array | null> {
    if (!this.db) return null;
    try {
      const parts = this.db.transaction('parts', 'readwrite').objectStore('parts');
      const row = (await done(parts.get(hash))) as Row | undefined;
      if (!row) return null;
      parts.put({ ...row, used: Date.now() });
      return row.bytes;
    } catch {
      return null;
    }
  }

  keep(hash: string, bytes: Uint8Array): void {
    this.write({ hash, used: Date.now(), bytes }).catch(() => {});
  }

  private async write(row: Row): Promise<void> {
    if (!this.db) return;
    await done(this.db.transaction('parts', 'readwrite').objectStore('parts').put(row));
    const parts = this.db.transaction('parts', 'readwrite').objectStore('parts');
    let size = 0;
    const walk = parts.index('used').openCursor(null, 'prev');
    walk.onsuccess = () => {
      const cursor = walk.result;
      if (!cursor) return;
      size += (cursor.value as Row).bytes.length;
      if (size > KEPT_BYTES) cursor.delete();
      cursor.continue();
    };
  }
}
