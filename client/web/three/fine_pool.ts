// fine_pool.ts: tiles of finer levels on the GPU: a bounded pool of them as layers of a texture, a table that
// says which layer has which tile, and the lines of a shader that read both.
// Flow: tiles, what the view wants -> finer.ts -> [fine_pool] -> lightmapped materials (materials.ts)
import * as THREE from 'three';

import { type AtlasMap, TILE_SIDE } from '../src/atlas.ts';
import { FinerTiles, SHARE_WHOLE, SLOT_BITS, SLOT_SIDE } from '../src/finer.ts';
import { type AnyRenderer, layersMax, RGB9E5, sendLayer, sendTexel } from './lightmaps.ts';

/** Slots of a pool, at most. */
export const SLOTS_MAX = 1 << SLOT_BITS;
export const TABLE_BITS = 10; // the table is 2^10 entries wide
export const LEVELS_MAX = 4;
/** A texel of a finer level is this many pixels wide, or wider (common/tile/fine_choice.h). */
export const FINE_PIXELS = 4;

/** The uniforms of the materials of an object. */
export type FinerUniforms = Record<string, { value: unknown }>;

/** Reads finer levels over a texel of level 0. uv: of the lightmap, 0 to 1. It stands outside all branches,
 * for it takes differences between pixels. With LIGHTWELL_DIRECTED, lightwellFine holds the direction of the
 * light of finer levels, and the share of level 0 as its last number. */
export const FINER_SHADER = `
uniform highp sampler2DArray lightwellPool;
uniform highp usampler2D lightwellTable;
uniform highp ivec4 lightwellFiner[ ${LEVELS_MAX} ]; // first entry, columns, width, height
uniform highp vec2 lightwellAtlas;
uniform int lightwellLevels;
uniform int lightwellFarther; // layers from light to its direction; 0: not known
vec4 lightwellFine = vec4( 0.0, 0.0, 0.0, 1.0 );
vec3 lightwellFinest( vec3 light, vec2 uv ) {
  highp vec2 place = uv * lightwellAtlas, right = dFdx( place ), down = dFdy( place );
  highp float texels = ${FINE_PIXELS ** 2}.0 * abs( right.x * down.y - right.y * down.x );
  for ( int k = 1; k <= ${LEVELS_MAX}; k ++ ) {
    highp float scale = exp2( float( k ) );
    if ( k > lightwellLevels || texels * scale * scale > 1.0 ) break;
    ivec4 level = lightwellFiner[ k - 1 ];
    highp vec2 at = clamp( place * scale - 0.5, vec2( 0.0 ), vec2( level.zw ) - 1.0 );
    ivec2 tile = ivec2( at ) / ${TILE_SIDE};
    int entry = level.x + tile.y * level.y + tile.x;
    ivec2 from = ivec2( entry & ${(1 << TABLE_BITS) - 1}, entry >> ${TABLE_BITS} );
    uint word = texelFetch( lightwellTable, from, 0 ).r;
    float share = float( word >> ${SLOT_BITS} ) / ${SHARE_WHOLE}.0;
    vec3 within = vec3( ( at - vec2( ${TILE_SIDE} * tile ) + 0.5 ) / ${SLOT_SIDE}.0,
      float( word & ${SLOTS_MAX - 1}u ) );
    if ( share <= 0.0 ) continue;
    light = mix( light, textureLod( lightwellPool, within, 0.0 ).rgb, share );
#ifdef LIGHTWELL_DIRECTED
    if ( lightwellFarther == 0 ) continue;
    within.z += float( lightwellFarther );
    vec3 direction = lightwellFromTexel( textureLod( lightwellPool, within, 0.0 ).rgb );
    lightwellFine = mix( lightwellFine, vec4( direction, 0.0 ), share );
#endif
  }
  return light;
}
`;

export class FinePool {
  tiles: FinerTiles;
  private readonly texels: Uint32Array;
  private readonly entries: Uint16Array | Uint32Array;
  readonly pool: THREE.DataArrayTexture;
  readonly table: THREE.DataTexture;
  private readonly whole = new WeakMap<THREE.Texture, number>(); // version that the GPU has
  private renderer: AnyRenderer | null = null;
  private readonly entryOf = new Set<number>(); // tiles that are shown
  private readonly farther: { value: number }; // layers from light to its direction; 0: not known

  /** map: with finer levels. directed: the server says where their light comes from. wide: the table has 32
   * bits an entry, as WebGPU wants. */
  constructor(
    private readonly map: AtlasMap,
    public slots: number,
    directed: boolean,
    wide: boolean,
  ) {
    this.farther = { value: directed ? slots : 0 };
    const layers = slots + this.farther.value;
    this.texels = new Uint32Array(layers * SLOT_SIDE ** 2);
    this.pool = new THREE.DataArrayTexture(this.texels, SLOT_SIDE, SLOT_SIDE, layers);
    Object.assign(this.pool, RGB9E5);
    this.pool.magFilter = this.pool.minFilter = THREE.LinearFilter;
    const rows = Math.ceil((map.tileCount - map.plainCount) / (1 << TABLE_BITS));
    this.entries = wide ? new Uint32Array(rows << TABLE_BITS) : new Uint16Array(rows << TABLE_BITS);
    this.table = new THREE.DataTexture(this.entries, 1 << TABLE_BITS, rows);
    this.table.format = THREE.RedIntegerFormat;
    this.table.type = wide ? THREE.UnsignedIntType : THREE.UnsignedShortType;
    if (!wide) this.table.internalFormat = 'R16UI'; // WebGPURenderer takes names of WebGPU alone
    this.table.magFilter = this.table.minFilter = THREE.NearestFilter;
    for (const texture of [this.pool, this.table]) {
      texture.generateMipmaps = texture.flipY = false;
      texture.unpackAlignment = 4;
      texture.colorSpace = THREE.NoColorSpace;
      texture.needsUpdate = true;
      texture.onUpdate = () => this.whole.set(texture, texture.version);
    }
    this.tiles = this.emptySlots();
  }

  private emptySlots(): FinerTiles {
    return new FinerTiles(
      this.map,
      this.slots,
      (slot, texels, directions) => this.write(slot + (directions ? this.farther.value : 0), texels),
      (id, entry) => this.show(id, entry),
    );
  }

  /** Takes the renderer that draws the pool next. A GPU that takes fewer layers makes it smaller before it is
   * drawn first, when no tile is in it: without directions, then with fewer slots. */
  drawnBy(renderer: AnyRenderer): void {
    const isFirst = !this.renderer;
    this.renderer = renderer;
    if (!isFirst) return;
    const layers = layersMax(renderer);
    if (this.slots + this.farther.value <= layers) return;
    this.farther.value = 0;
    this.slots = Math.min(this.slots, layers);
    this.pool.image.data = this.texels.subarray(0, this.slots * SLOT_SIDE ** 2);
    this.pool.image.depth = this.slots;
    this.tiles = this.emptySlots();
  }

  /** Takes where a tile's light comes from, if there is room for that. */
  direct(id: number, texels: Uint32Array): void {
    if (this.farther.value) this.tiles.direct(id, texels);
  }

  /** How many tiles are shown. */
  get shown(): number {
    return this.entryOf.size;
  }

  private isWhole(texture: THREE.Texture): boolean {
    return this.whole.get(texture) === texture.version;
  }

  private write(layer: number, texels: Uint32Array): void {
    this.texels.set(texels, layer * texels.length);
    const { pool, renderer } = this;
    if (!(renderer && this.isWhole(pool) && sendLayer(pool, renderer, layer, SLOT_SIDE, texels)))
      pool.needsUpdate = true;
  }

  private show(id: number, entry: number): void {
    const at = id - this.map.plainCount;
    if (this.entries[at] === entry) return;
    this.entries[at] = entry;
    if (entry) this.entryOf.add(id);
    else this.entryOf.delete(id);
    const { table, renderer } = this;
    const [x, y] = [at & ((1 << TABLE_BITS) - 1), at >> TABLE_BITS];
    const one = this.entries.subarray(at, at + 1);
    if (!(renderer && this.isWhole(table) && sendTexel(table, renderer, x, y, one)))
      table.needsUpdate = true;
  }

  /** The uniforms of an object's materials, for FINER_SHADER; null: it has no lightmap. */
  uniformsOf(object: number): FinerUniforms | null {
    const { levels, finer } = this.map.of(object);
    if (!levels.length || !finer.length) return null;
    const first = this.map.firstFiner[object]! - this.map.plainCount;
    const rows = new Int32Array(4 * LEVELS_MAX);
    finer.forEach(({ firstTile, tilesX, width, height }, k) =>
      rows.set([first + firstTile, tilesX, width, height], 4 * k),
    );
    return {
      lightwellPool: { value: this.pool },
      lightwellTable: { value: this.table },
      lightwellFiner: { value: rows },
      lightwellAtlas: { value: new THREE.Vector2(levels[0]!.width, levels[0]!.height) },
      lightwellLevels: { value: finer.length },
      lightwellFarther: this.farther,
    };
  }

  dispose(): void {
    this.pool.dispose();
    this.table.dispose();
  }
}
