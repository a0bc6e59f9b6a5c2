// camera.ts: a view and how a person moves it. Upright, as client/view/flight.h.

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

/** The whole of a box, from outside. */
export function frameBox(low: Vec3, high: Vec3, aspect: number): View {
  const fovY = (50 / 180) * Math.PI;
  const centre = add(low, add(high, low, -1), 0.5);
  const radius = Math.max(1e-6, Math.hypot(...add(high, low, -1)) / 2);
  const half = Math.min(fovY / 2, Math.atan(Math.tan(fovY / 2) * aspect));
  return lookAt(add(centre, normalize([0.6, 0.45, 1]), radius / Math.sin(half)), centre, fovY);
}

/** Mouse, touch and keys turn and move a view. */
export class Flight {
  view: View = lookAt([0, 0, 0], [0, 0, -1], 0.9);
  speed = 1; // m/s
  private readonly keys = new Set<string>();
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
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      this.keys.add(event.code);
      if (!event.repeat) this.onKey(event.key);
    });
    window.addEventListener('keyup', (event) => this.keys.delete(event.code));
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

  /** Moves by the keys that are held; true if the view is another than at the last call. */
  step(seconds: number): boolean {
    const held = (...codes: string[]) => (codes.some((code) => this.keys.has(code)) ? 1 : 0);
    const by = seconds * this.speed * (held('ShiftLeft', 'ShiftRight') ? 4 : 1);
    const right = held('KeyD', 'ArrowRight') - held('KeyA', 'ArrowLeft');
    const forward = held('KeyW', 'ArrowUp') - held('KeyS', 'ArrowDown');
    const up = held('KeyE', 'PageUp') - held('KeyQ', 'PageDown');
    if (right || up || forward) this.move(right * by, up * by, forward * by);
    const changed = this.changed;
    this.changed = false;
    return changed;
  }
}
