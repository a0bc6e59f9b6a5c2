// camera.ts: a view and how a person moves it. Upright, as client/camera/flight.h.

export type Vec3 = [number, number, number];

export interface View {
  position: Vec3;
  right: Vec3;
  up: Vec3;
  forward: Vec3;
  fovY: number; // radians
  height?: number; // orthographic: of what is seen, m; else 0 or none
}

/** Along each axis of the picture: half of it over this is a length in the plane at depth 1, or at any. */
export function scaleOf(view: View, width: number, height: number): [number, number] {
  const scale = view.height ? 2 / view.height : 1 / Math.tan(view.fovY / 2);
  return [(scale * height) / width, scale];
}

const PITCH_MAX = (89 / 180) * Math.PI;

export const add = (a: Vec3, b: Vec3, s = 1): Vec3 => [a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s];
export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const normalize = (a: Vec3): Vec3 => {
  const length = Math.hypot(...a);
  return length > 1e-30 ? [a[0] / length, a[1] / length, a[2] / length] : [0, 0, 1];
};

export function lookAt(position: Vec3, target: Vec3, fovY: number): View {
  const forward = normalize(add(target, position, -1));
  const upright: Vec3 = Math.abs(forward[1]) < 0.9999 ? [0, 1, 0] : [0, 0, Math.sign(forward[1])];
  const right = normalize(cross(forward, upright));
  return { position, right, up: cross(right, forward), forward, fovY };
}

/** A camera of the scene: it looks along its node's -Z; the node may be sheared or mirrored, the view is
 * neither. */
export function viewOf(toWorld: number[], fovY: number, height = 0): View {
  const m = toWorld;
  const position: Vec3 = [m[3]!, m[7]!, m[11]!];
  const forward = normalize([-m[2]!, -m[6]!, -m[10]!]);
  const sideways = cross(forward, [m[1]!, m[5]!, m[9]!]);
  if (!(Math.hypot(...sideways) > 1e-12))
    return { ...lookAt(position, add(position, forward), fovY), height };
  const right = normalize(sideways);
  return { position, right, up: cross(right, forward), forward, fovY, height };
}

/** PX,PY,PZ:TX,TY,TZ:FOV, as lightwell-view takes it, or with 10m in place of FOV for an orthographic view
 * that is 10 m high; null: it is none. */
export function parseView(text: string): View | null {
  const parallel = text.endsWith('m');
  const parts = (parallel ? text.slice(0, -1) : text).split(':').map((part) => part.split(',').map(Number));
  const [position, target, fov] = parts;
  if (parts.length !== 3 || position!.length !== 3 || target!.length !== 3 || fov!.length !== 1) return null;
  if (parts.flat().some((value) => !Number.isFinite(value))) return null;
  const frame = fov![0]!;
  if (parallel)
    return frame > 0
      ? { ...lookAt(position as Vec3, target as Vec3, Math.PI / 4), height: frame }
      : null;
  if (!(frame >= 1 && frame <= 179)) return null;
  return lookAt(position as Vec3, target as Vec3, (frame / 180) * Math.PI);
}

export function formatView(view: View): string {
  const round = (x: number) => String(Math.round(x * 1e5) / 1e5);
  const target = add(view.position, view.forward);
  const frame = view.height ? `${round(view.height)}m` : round((view.fovY / Math.PI) * 180);
  return `${view.position.map(round)}:${target.map(round)}:${frame}`;
}

const FILL = 0.94; // of the picture, by a box that is framed
const FRAME_FOV_Y = (35 / 180) * Math.PI;

/** The whole of a box, from outside and a little above, from as near as it fits into the picture; as frame()
 * of client/paths/camera_default.c. A corner at x to the right and z towards the eye is in the picture if
 * |x - x0| <= slope (distance - z): that bounds distance + x0 / slope and distance - x0 / slope from
 * below. */
export function frameBox(low: Vec3, high: Vec3, aspect: number): View {
  const view = lookAt([0, 0, 0], [-0.45, -0.4, -0.8], FRAME_FOV_Y);
  const centre = add(low, add(high, low, -1), 0.5);
  const slope = FILL * Math.tan(FRAME_FOV_Y / 2);
  const bound = [0, 0, 0, 0];
  for (let i = 0; i < 8; i++) {
    const corner = centre.map((c, k) => (i & (1 << k) ? high : low)[k as 0] - c) as Vec3;
    const [x, y] = [dot(corner, view.right) / (slope * aspect), dot(corner, view.up) / slope];
    const z = -dot(corner, view.forward);
    [x, -x, y, -y].forEach((side, k) => (bound[k] = Math.max(bound[k]!, z + side)));
  }
  const [right, left, above, below] = bound as [number, number, number, number];
  const distance = Math.max(1e-6, (right + left) / 2, (above + below) / 2);
  let position = add(centre, view.right, (slope * aspect * (right - left)) / 2);
  position = add(position, view.up, (slope * (above - below)) / 2);
  return { ...view, position: add(position, view.forward, -distance) };
}

const HELD_MAX_MS = 1000; // of a key between two pictures

/** Whether a key is for what has the focus: text is typed, letters choose from lists, arrows move sliders. */
function isForFocus(event: KeyboardEvent): boolean {
  const { target } = event;
  if (!(target instanceof Element)) return false;
  if (target.matches('input:not([type=range]), select')) return true;
  return target.matches('input') && /^(Arrow|Page|Home|End)/.test(event.key);
}

/** Mouse, touch and keys turn and move a view. */
export class Flight {
  view: View = lookAt([0, 0, 0], [0, 0, -1], 0.9);
  speed = 1; // m/s
  /** Since when each key is held, and how long it was held since the last step before that; ms. */
  private readonly keys = new Map<string, { sinceMs: number | null; heldMs: number }>();
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private changed = true;

  constructor(
    private readonly element: HTMLElement,
    private readonly onKey: (key: string) => void,
  ) {
    element.style.touchAction = 'none';
    element.addEventListener('pointerdown', (event) => {
      element.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    for (const name of ['pointerup', 'pointercancel'] as const)
      element.addEventListener(name, (event) => this.pointers.delete(event.pointerId));
    element.addEventListener('pointermove', (event) => this.drag(event));
    element.addEventListener('contextmenu', (event) => event.preventDefault());
    element.addEventListener(
      'wheel',
      (event) => {
        event.preventDefault();
        if (this.view.height) this.zoom(Math.exp(event.deltaY / 500));
        else this.move(0, 0, (-event.deltaY * this.speed) / 500);
      },
      { passive: false },
    );
    window.addEventListener('keydown', (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || isForFocus(event)) return;
      const key = this.keys.get(event.code) ?? { sinceMs: null, heldMs: 0 };
      key.sinceMs ??= event.timeStamp;
      this.keys.set(event.code, key);
      // letters are the same by Shift and Caps Lock
      if (!event.repeat) this.onKey(event.key.toLowerCase());
    });
    window.addEventListener('keyup', (event) => {
      const key = this.keys.get(event.code);
      if (key) this.hold(key, event.timeStamp, null);
    });
    window.addEventListener('blur', () => this.keys.clear());
  }

  go(view: View): void {
    this.view = view;
    this.changed = true;
  }

  private drag(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = { x: event.clientX, y: event.clientY };
    const [dx, dy] = [now.x - before.x, now.y - before.y];
    const scale = this.view.fovY / Math.max(1, this.element.clientHeight);
    if (this.pointers.size === 1) {
      if (event.buttons & 2) this.move(-dx * scale * this.speed, dy * scale * this.speed, 0);
      else this.turn(-dx * scale, dy * scale);
    } else {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)![1];
      const apart = (p: { x: number; y: number }) => Math.hypot(p.x - other.x, p.y - other.y);
      const pinch = apart(now) - apart(before);
      this.move(
        (-dx / 2) * scale * this.speed,
        (dy / 2) * scale * this.speed,
        2 * pinch * scale * this.speed,
      );
    }
    this.pointers.set(event.pointerId, now);
  }

  private turn(right: number, up: number): void {
    const { forward, position, fovY, height } = this.view;
    const yaw = Math.atan2(this.view.right[2], this.view.right[0]) + right;
    const pitch = Math.min(
      PITCH_MAX,
      Math.max(-PITCH_MAX, Math.asin(Math.min(1, Math.max(-1, forward[1]))) + up),
    );
    const level = Math.cos(pitch);
    const ahead: Vec3 = [Math.sin(yaw) * level, Math.sin(pitch), -Math.cos(yaw) * level];
    this.go({ ...lookAt(position, add(position, ahead), fovY), height: height ?? 0 });
  }

  /** What is nearer is no larger in an orthographic view: the picture is. */
  private zoom(factor: number): void {
    this.go({ ...this.view, height: this.view.height! * factor });
  }

  private move(right: number, up: number, forward: number): void {
    const position = add(add(this.view.position, this.view.forward, forward), this.view.right, right);
    position[1] += up;
    this.go({ ...this.view, position });
  }

  private hold(key: { sinceMs: number | null; heldMs: number }, nowMs: number, sinceMs: number | null): void {
    if (key.sinceMs !== null) key.heldMs += Math.max(0, nowMs - key.sinceMs);
    key.sinceMs = sinceMs;
  }

  /** Moves by the time that keys were held since the last call, however many pictures that were; true if the
   * view is another than at the last call. */
  step(nowMs: number): boolean {
    for (const key of this.keys.values())
      if (key.sinceMs !== null) this.hold(key, nowMs, Math.max(nowMs, key.sinceMs));
    const held = (...codes: string[]) =>
      Math.min(HELD_MAX_MS, Math.max(...codes.map((code) => this.keys.get(code)?.heldMs ?? 0))) / 1000;
    const by = this.speed * (held('ShiftLeft', 'ShiftRight') ? 4 : 1);
    const right = held('KeyD', 'ArrowRight') - held('KeyA', 'ArrowLeft');
    const forward = held('KeyW', 'ArrowUp') - held('KeyS', 'ArrowDown');
    const up = held('KeyE', 'PageUp') - held('KeyQ', 'PageDown');
    for (const [code, key] of this.keys)
      if (key.sinceMs === null) this.keys.delete(code);
      else key.heldMs = 0;
    if (right || up || forward) this.move(right * by, up * by, forward * by);
    const changed = this.changed;
    this.changed = false;
    return changed;
  }
}
