// protocol.ts: what page and worker tell each other.
import type { Cluster } from './clusters.ts';
import type { SceneData } from './geometry.ts';
import type { Box } from './lights.ts';
import type { TileBatch } from './replica.ts';
import type { Frame, Waiting } from './wire.ts';

export interface CameraPlace {
  name: string;
  fovY: number;
  height: number; // of an orthographic one, m; else 0
  toWorld: number[]; // 3 x 4, row-major
}

/** Where the two WebAssembly modules are, or their bytes. */
export interface Wasm {
  tiles: string | ArrayBuffer;
  zstd: string | ArrayBuffer;
}

/** Why no more attempts are made. failed: this page cannot go on, as without its WebAssembly. */
export type End = 'forbidden' | 'refused' | 'failed';

export type ToWorker =
  | { kind: 'token'; token: string } // 64 hexadecimal digits; before connect, or in answer to 'token'
  | { kind: 'dim'; lamp: number; factor: number }
  // draws: suns, points and spots of the server's; clusters: and small emissive meshes
  | {
      kind: 'connect';
      url: string;
      draws: boolean;
      clusters: boolean;
      wasm?: Wasm;
      extras?: bigint; // three's page: features that it asks for beside these
    }
  | { kind: 'interest'; ids: Uint32Array<ArrayBuffer> }
  | { kind: 'taken'; count: number }
  | { kind: 'pause'; paused: boolean }
  | { kind: 'lost' } // what the page had of scene and light is gone
  | { kind: 'camera'; index: number; timeS: number } // go to one of the scene
  | { kind: 'tiles' }; // all light is to come in tiles from now on: a new scene follows

export type FromWorker =
  // what a person should know; '': all is well. final: no more attempts, and why
  | { kind: 'state'; text: string; final: boolean; end?: End }
  | { kind: 'token' } // the server wants one, or another one; `state` says so
  | { kind: 'lamps'; names: string[] } // that this client may change
  | { kind: 'progress'; fraction: number }
  | {
      kind: 'scene';
      data: SceneData;
      cameras: CameraPlace[];
      body: Box | null; // what a view shows where there is no camera
      draws: boolean;
      clientLights: Uint8Array;
      clusters: number; // of emissive meshes to draw as lamps
      finer: number; // levels that are finer than level 0
      directed: boolean; // tiles say where their light comes from
    }
  | { kind: 'finishes'; data: SceneData } // the last scene again, with finishes and without textures
  | { kind: 'clusters'; clusters: Cluster[] } // before the frame that they belong to
  | { kind: 'frame'; frame: Frame; visible: Uint8Array | null }
  | {
      kind: 'tiles';
      batch: TileBatch;
      mean: [number, number, number];
      visible: Uint8Array | null;
      first: boolean;
    }
  | { kind: 'camera'; place: CameraPlace }
  | { kind: 'settled' }
  | { kind: 'waiting'; waiting: Waiting } // for the first light of a session, before its frames
  // received since the page began; not decoded yet; memory of the decoder
  | { kind: 'traffic'; bytes: number; waiting: number; memory: number };
