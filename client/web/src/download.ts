// download.ts: a package as it comes in chunks, part by part, with the parts that the browser has
// already.
import { LimitError, ProtocolError } from './failure.ts';
import type { Tiles } from './tiles.ts';
import type { AnnouncedPackage } from './wire.ts';

/** A page has no more memory than this for a package. */
const PACKAGE_MAX = 2 ** 30;

/** Where compressed parts of packages are kept, by hash. */
export interface PartStore {
  find(hash: string): Promise<Uint8Array | null>;
  keep(hash: string, compressed: Uint8Array): void;
}

export function hex(hash: Uint8Array): string {
  return Array.from(hash, (byte) => byte.toString(16).padStart(2, '0')).join('');
}

interface Slot {
  hash: Uint8Array;
  begin: number; // in the package
  size: number;
  compressedBegin: number;
  compressedSize: number;
  held: boolean;
}

export class Download {
  private readonly bytes: Uint8Array<ArrayBuffer>;
  private readonly slots: Slot[] = [];
  private at = 0; // the slot that is being received
  private inSlot = 0; // compressed bytes of it that are there
  private chunks: Uint8Array[] = [];

  constructor(
    private readonly announced: AnnouncedPackage,
    private readonly run: bigint,
    private readonly what: string,
    private readonly tiles: Tiles,
    private readonly store: PartStore,
  ) {
    const megabytes = Math.ceil(announced.size / 2 ** 20);
    if (announced.size > PACKAGE_MAX)
      throw new LimitError(`the ${what} has ${megabytes} MB, more than a page takes`);
    try {
      this.bytes = new Uint8Array(announced.size);
    } catch {
      throw new LimitError(`this page has no memory for a ${what} of ${megabytes} MB`);
    }
    let begin = 0;
    let compressedBegin = 0;
    for (const { size, compressedSize, hash } of announced.parts) {
      this.slots.push({ hash, begin, size, compressedBegin, compressedSize, held: false });
      begin += size;
      compressedBegin += compressedSize;
    }
  }

  isOf(announced: AnnouncedPackage, run: bigint): boolean {
    return hex(announced.hash) === hex(this.announced.hash) && run === this.run && !!run;
  }

  private fail(what: string): never {
    throw new ProtocolError(`${this.what} package: ${what}`);
  }

  /** Takes the parts that the browser has kept. */
  async begin(): Promise<void> {
    for (const [i, slot] of this.slots.entries()) {
      if (i < this.at || (i === this.at && this.inSlot)) continue; // it is there, or comes
      const compressed = await this.store.find(hex(slot.hash));
      const part = compressed && this.tiles.decompress(compressed, slot.size);
      if (!part || hex(this.tiles.hash(part)) !== hex(slot.hash)) continue;
      this.bytes.set(part, slot.begin);
      slot.held = true;
    }
    this.skipHeld();
  }

  private skipHeld(): void {
    while (this.slots[this.at]?.held) this.at++;
  }

  /** The request: an offset, and the parts that are held. */
  request(): { offset: number; held: Uint8Array } {
    const held = new Uint8Array(this.slots.length > 1 ? Math.ceil(this.slots.length / 8) : 0);
    if (this.slots.length > 1)
      this.slots.forEach((slot, i) => {
        if (slot.held) held[i >> 3]! |= 1 << (i & 7);
      });
    return { offset: this.received(), held };
  }

  private received(): number {
    const slot = this.slots[this.at];
    return slot ? slot.compressedBegin + this.inSlot : this.announced.compressedSize;
  }

  /** 0 to 1. */
  progress(): number {
    return this.received() / this.announced.compressedSize;
  }

  add(offset: number, data: Uint8Array): void {
    const slot = this.slots[this.at];
    if (!slot) return this.fail('more than what was promised');
    if (offset !== this.received()) this.fail(`a chunk at ${offset} where ${this.received()} was expected`);
    if (data.length > slot.compressedSize - this.inSlot)
      this.fail('a chunk that goes over the end of its part');
    this.chunks.push(data.slice());
    this.inSlot += data.length;
    if (this.inSlot === slot.compressedSize) this.finishPart(slot);
  }

  private finishPart(slot: Slot): void {
    const compressed = new Uint8Array(slot.compressedSize);
    let at = 0;
    for (const chunk of this.chunks) {
      compressed.set(chunk, at);
      at += chunk.length;
    }
    this.chunks = [];
    this.inSlot = 0;
    const part = this.tiles.decompress(compressed, slot.size);
    if (!part) return this.fail(`a part is not the ${slot.size} bytes of zstd that were promised`);
    if (hex(this.tiles.hash(part)) !== hex(slot.hash)) this.fail('a part is not the one that was promised');
    this.bytes.set(part, slot.begin);
    this.store.keep(hex(slot.hash), compressed);
    this.at++;
    this.skipHeld();
  }

  /** The package, once all of it is there and has the hash that was announced. */
  finished(): Uint8Array<ArrayBuffer> | null {
    if (this.at < this.slots.length) return null;
    if (hex(this.tiles.hash(this.bytes)) !== hex(this.announced.hash))
      this.fail('it is not the one that was promised');
    return this.bytes;
  }
}
