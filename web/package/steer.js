// Mouse, touch and keys on an element, as calls of the app.

// Radians per pixel of a drag, and per press of a key.
const TURN = 0.006, KEY_TURN = 0.1;

// Steers the app that `running` returns, if there is one yet. One finger or button turns, two fingers zoom and
// move. Pointer events are those of mouse, touch and pen alike.
export function steer(stage, running) {
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return { size: Math.hypot(a.x - b.x, a.y - b.y), x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
  };
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  stage.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    const app = running();
    if (!last || !app) return;
    const before = pointers.size === 2 ? spread() : null;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
    if (before) {
      const after = spread();
      app.zoom(before.size / Math.max(after.size, 1));
      app.fly((before.x - after.x) / 1000, (after.y - before.y) / 1000, 0);
    } else if (event.buttons & 4 || event.shiftKey) app.fly(-dx / 1000, dy / 1000, 0);
    else app.turn(-dx * TURN, dy * TURN);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    stage.addEventListener(end, (event) => pointers.delete(event.pointerId));
  }
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    running()?.zoom(Math.exp(event.deltaY / 800));
  }, { passive: false });
  const keys = (app) => ({
    ArrowLeft: () => app.turn(-KEY_TURN, 0), ArrowRight: () => app.turn(KEY_TURN, 0),
    ArrowUp: () => app.turn(0, KEY_TURN), ArrowDown: () => app.turn(0, -KEY_TURN),
    "+": () => app.zoom(0.9), "=": () => app.zoom(0.9), "-": () => app.zoom(1.1),
    w: () => app.fly(0, 0, -0.05), s: () => app.fly(0, 0, 0.05), a: () => app.fly(-0.05, 0, 0),
    d: () => app.fly(0.05, 0, 0), e: () => app.fly(0, 0.05, 0), q: () => app.fly(0, -0.05, 0),
  });
  stage.addEventListener("keydown", (event) => {
    const app = running();
    const act = app && keys(app)[event.key];
    if (!act || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    act();
  });
}
