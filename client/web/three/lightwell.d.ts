import type { Camera, Object3D } from 'three';

export interface AttachOptions {
  /** Draw the server's suns, points and spots as three's own lights with shadows, where it lets clients do
   * so, and emissive surfaces are not among them. Default true. */
  keyLights?: boolean;
  /** Side of their shadow maps, texels. Default 2048. */
  shadowMapSize?: number;
  /** worker.js of this package. Default: beside lightwell.js. */
  worker?: string | URL;
  /** For a server that wants one: 64 hexadecimal digits. */
  token?: string;
  /** What a person should know: the link is lost, comes back, or why there is no light yet ("Looking inside
   * objects: 42 %"); '' for all is well. */
  onState?: (text: string) => void;
  /** The same wait in numbers, for a bar of your own: a few times a second at most, from the scene's request
   * to the first light, the last time with 'ready'. Never, if there is light already. */
  onWaiting?: (waiting: LightwellWaiting) => void;
}

/** What a server does before its first light. */
export interface LightwellWaiting {
  /** 'other': of a newer server. */
  stage: 'placing texels' | 'looking inside objects' | 'first light' | 'ready' | 'other';
  /** Of that stage, 0 to 1. */
  share: number;
}

export class Lightwell {
  private constructor();
  /** Resolves once the scene has its first light. Rejects with one line if the server cannot be used. */
  static attach(scene: Object3D, url: string, options?: AttachOptions): Promise<Lightwell>;
  /** Takes over light that has come, for 3 ms at most, and says what the camera sees: before each picture.
   * height: of the picture, pixels. */
  update(camera: Camera, height: number): void;
  /** How old the light is, in seconds. While nothing changes it grows, though the light is right. */
  ageSeconds(): number;
  /** Ends the session; what is there stays. */
  detach(): void;
  /** Number of the server's newest frame that has come. */
  readonly frame: number;
  /** Names of nodes of the server's scene that the three.js scene does not have. */
  readonly missing: string[];
}
